"""How a process that is on the bus ends: at a signal, and by force when zenoh hangs."""

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

FORCED = 75  # exit code


class Signals:
    """Calls `stop` at the first SIGTERM or SIGINT that nobody else takes; the next one does what it did before."""

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._before: dict[int, Any] = {}

    def watch(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        for number in (signal.SIGTERM, signal.SIGINT):
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                self._before[number] = signal.signal(number, self._came)

    def release(self) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        self._before.clear()

    def _came(self, number: int, frame: FrameType | None) -> None:
        signal.signal(number, self._before.pop(number, signal.SIG_DFL))
        # Not here: the main thread may hold one of the locks that stop takes.
        threading.Thread(target=self._stop, name="stop", daemon=True).start()


@contextmanager
def ended_by_force_after(limit_s: float) -> Iterator[None]:
    """What hangs in here ends the process: zenoh's threads would keep it from ending by itself."""
    guard = threading.Timer(limit_s, _give_up, (limit_s,))
    guard.daemon = True
    guard.start()
    try:
        yield
    finally:
        guard.cancel()


def _give_up(limit_s: float) -> None:
    logging.getLogger("omnivert.bus").error("zenoh did not close within %g s", limit_s)
    logging.shutdown()
    os._exit(FORCED)
