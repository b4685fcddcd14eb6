"""Somebody who follows what is told on the bus, beside a command that is not on it."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from omnivert.config import Config

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus


@contextmanager
def guest(config: Config, name: str, follow: Callable[["Bus"], None]) -> Iterator[None]:
    """In here `follow` runs on a bus of its own, in a thread of its own, which has ended when it is left.

    It leaves signals to others.
    """
    from omnivert.wire.bus import Bus

    bus = Bus(config, name, f"{name[0]}{os.getpid()}")

    def run() -> None:
        with bus:
            follow(bus)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        bus.stop()
        thread.join()
