"""A bus of one's own: a socket and a store that no other test and no other robot knows."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from omnivert.config import Config, parsed


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="ov-") as name:  # a socket's path must stay below 108 bytes
        yield Path(name)


@pytest.fixture
def config(folder: Path) -> Config:
    given = {"bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"}, "storage": {"path": str(folder / "store.db")}}
    return parsed(given, "the test")
