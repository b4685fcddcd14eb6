"""The `omnivert` command: one file for each command, `app` puts them together."""

import signal

__all__ = ["main"]


def main() -> None:
    """The console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # While it only loads, there is nothing to put in order at ctrl-c, and nothing to tell.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from omnivert.cli import app

    app.main()
