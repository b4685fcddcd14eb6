"""How a command is ended from outside: SIGTERM ends it as ctrl-c does, and some steps are not cut short by either."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = (signal.SIGINT, signal.SIGTERM)
INTERRUPTED = 128 + signal.SIGINT  # exit code
TERMINATED = 128 + signal.SIGTERM


@contextmanager
def interruptible(came: list[int]) -> Iterator[None]:
    """In here ctrl-c and SIGTERM raise KeyboardInterrupt; after it, and before, they end the process at once.

    came  gets, at the end, the numbers of the signals that came, whoever took them
    """
    told, tells = os.pipe()
    os.set_blocking(told, False)
    os.set_blocking(tells, False)
    before = signal.set_wakeup_fd(tells, warn_on_full_buffer=False)
    taken = [number for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)
        signal.set_wakeup_fd(before)
        os.close(tells)
        came += os.read(told, 64)
        os.close(told)


@contextmanager
def held_back() -> Iterator[None]:
    """In here ctrl-c and SIGTERM wait; they come at its end."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])
