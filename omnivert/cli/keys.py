"""Single keys of the terminal that a command is typed at, while it runs; a pipe has none."""

import os
import select
import signal
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from omnivert.cli.interrupts import ENDING

UP, DOWN, RIGHT, LEFT = (b"\x1b[" + letter for letter in (b"A", b"B", b"C", b"D"))
ESCAPE = b"\x1b"
HUNG_UP = b""  # the terminal has gone, no key will come
_LOOK_S = 0.2  # how often it is looked whose the terminal is
_APPLICATION = b"\x1bO"  # how terminals begin the same arrows in their other mode


@contextmanager
def keys(actions: Mapping[bytes, Callable[[], None]]) -> Iterator[bool]:
    """In here a key calls its action, from a thread; ctrl-c stays what it is. Tells whether there are keys."""
    if not _has_keys():
        yield False
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    over, tell_over = os.pipe()
    thread = threading.Thread(target=_listen, args=(terminal, over, actions), name="keys", daemon=True)
    try:
        tty.setcbreak(terminal, termios.TCSANOW)
        thread.start()
        yield True
    finally:
        os.close(tell_over)
        if thread.is_alive():
            thread.join()
        os.close(over)
        if _is_in_front(terminal):
            with suppress(termios.error):  # it has gone
                termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _has_keys() -> bool:
    """Whether a person sits there: in the background, to touch the terminal would stop this process."""
    try:
        return sys.stdin.isatty() and sys.stderr.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError, AttributeError):  # closed
        return False


def _is_in_front(terminal: int) -> bool:
    """Whether keys are for this process: after ctrl-z they are the shell's. True for one that has gone, which tells."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return True


def _listen(terminal: int, over: int, actions: Mapping[bytes, Callable[[], None]]) -> None:
    # Between the look whose the terminal is and its use, the shell may take it back: that must fail, not stop us. And
    # what ends the process must come to the main thread: taken here, it would not end what that one waits for.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGTTIN, signal.SIGTTOU, *ENDING))
    while True:
        if in_front := _is_in_front(terminal):
            _take_single_keys(terminal)
        ready, _, _ = select.select([terminal, over] if in_front else [over], [], [], _LOOK_S)
        if over in ready:
            return
        if not ready or not _is_in_front(terminal):
            continue
        try:
            typed = os.read(terminal, 64)
        except OSError:
            if not _is_in_front(terminal):
                continue
            typed = HUNG_UP
        for key in _parted(typed):
            if key in actions:
                actions[key]()
        if typed == HUNG_UP:
            return


def _take_single_keys(terminal: int) -> None:
    """Again after ctrl-z and fg, between which the shell has set the terminal as it was before."""
    with suppress(termios.error):
        if termios.tcgetattr(terminal)[3] & termios.ICANON:
            tty.setcbreak(terminal, termios.TCSANOW)


def _parted(typed: bytes) -> Iterator[bytes]:
    """What came at once, key by key."""
    if typed == HUNG_UP:
        yield HUNG_UP
    while typed:
        length = 3 if typed[:2] in (b"\x1b[", _APPLICATION) else 1
        yield typed[:length].replace(_APPLICATION, b"\x1b[")
        typed = typed[length:]
