"""The `omnivert` command: one file for each command, `app` puts them together."""

from omnivert.cli.app import main

__all__ = ["main"]
