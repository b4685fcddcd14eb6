"""Single key strokes from a terminal, which is given back as it was, whatever happens."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from omnivert.errors import UseError

_ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_WAIT_S = 0.05  # for the rest of what an arrow key sends


def check_terminal() -> None:
    """raises UseError when standard input is no terminal"""
    if not sys.stdin.isatty():
        raise UseError("OV214", "there is no terminal to take keys from", "standard input is none")


@contextmanager
def strokes() -> Iterator["Keys"]:
    """The terminal gives each key at once, and shows none, until the end of the `with`."""
    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)
    try:
        tty.setcbreak(number)
        yield Keys(number)
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


class Keys:
    """The keys of a terminal."""

    def __init__(self, number: int) -> None:
        self._number = number

    def pressed(self, timeout_s: float) -> str | None:
        """The next key, as a letter or as up, down, left, right, escape, end (nothing comes any more); None: no key."""
        first = self._read(timeout_s)
        match first:
            case None:
                return None
            case b"":
                return "end"
            case b"\x1b":
                return self._after_escape()
            case _:
                return first.decode("latin-1").lower()

    def _after_escape(self) -> str | None:
        if self._read(_WAIT_S) not in (b"[", b"O"):
            return "escape"
        return _ARROWS.get(self._read(_WAIT_S) or b"")

    def _read(self, timeout_s: float) -> bytes | None:
        """One byte; None when none comes in time."""
        if not select.select([self._number], [], [], timeout_s)[0]:
            return None
        try:
            return os.read(self._number, 1)
        except OSError:  # the terminal has gone
            return b""
