"""A bar on the terminal that moves with a playback."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from omnivert.cli import say
from omnivert.cli.guest import guest
from omnivert.config import Config
from omnivert.messages import Playback
from omnivert.wire.channels import PLAYBACK

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus

_PERIOD_S = 0.1


@contextmanager
def followed(bus: "Bus", label: Callable[[], str] = lambda: "playing") -> Iterator[None]:
    """In here, what the bus tells of a playback; in a thread that has ended before the bus closes.

    In zenoh the thread would break the exit.
    """
    over = threading.Event()
    thread = threading.Thread(target=_follow, args=(bus, label, over), name="progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def followed_from_outside(config: Config) -> AbstractContextManager[None]:
    """The same for who is not on the bus: on a terminal as a guest there."""
    if not say.err().is_terminal:
        return nullcontext()
    return guest(config, "progress", lambda bus: _follow(bus, lambda: "playing", threading.Event()))


def _follow(bus: "Bus", label: Callable[[], str], over: threading.Event) -> None:
    """Until the playback is finished, or over for us; the bar appears with the first that is told."""
    listening = bus.listen(PLAYBACK, period_s=_PERIOD_S)
    for first in listening:
        if over.is_set():
            return
        if first is not None:
            break
    else:
        return
    with say.progress(label(), None) as bar:
        for received in listening:
            if over.is_set():
                return
            bar.label(label())
            if received is not None and isinstance(received.message, Playback):
                bar.reach(received.message.played, received.message.total or None)
                if received.message.finished:
                    return
