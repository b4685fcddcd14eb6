"""A bus of one's own: a socket that no other test and no other robot knows."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from omnivert.config import Config, parsed


@pytest.fixture
def config() -> Iterator[Config]:
    with tempfile.TemporaryDirectory(prefix="ov-") as folder:  # a socket's path must stay below 108 bytes
        yield parsed({"bus": {"endpoint": f"unixsock-stream/{Path(folder) / 'bus'}"}}, "the test")
