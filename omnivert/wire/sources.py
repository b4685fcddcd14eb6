"""Whose sensor data a consumer takes: one drive at a time, so that no stray publisher spoils it."""

from collections import deque
from collections.abc import Callable
from enum import StrEnum

from omnivert.wire.received import Received


class Admission(StrEnum):
    FRESH = "fresh"  # the first message of another drive: begin anew
    SAME = "same"  # goes on
    REFUSED = "refused"  # not of this drive


class Sources:
    """
    A playback is one drive, named by its player's process; a new one begins anew. Live, a source that comes back as
    another process goes on with the same drive. While the process that a drive comes from is alive, no other one is
    heard.

    alive  whether the process of this name is on the bus
    """

    def __init__(self, alive: Callable[[bytes], bool]) -> None:
        self._alive = alive
        self._playback: bytes | None = None  # run of the playback that is taken; None: live
        self._live: dict[str, bytes] = {}  # key -> run
        self._past: deque[bytes] = deque(maxlen=100)  # earlier playbacks, of which results may still be on the way

    def admission(self, received: Received) -> Admission:
        if received.replay:
            return self._of_playback(received.run)
        return self._of_live(received.key, received.run)

    def _of_playback(self, run: bytes) -> Admission:
        if run == self._playback:
            return Admission.SAME
        if run in self._past or any(map(self._alive, [self._playback or b"", *self._live.values()])):
            return Admission.REFUSED
        self._past.append(run)
        self._playback = run
        self._live.clear()
        return Admission.FRESH

    def _of_live(self, key: str, run: bytes) -> Admission:
        now = self._live.get(key)
        if run == now:
            return Admission.SAME
        if self._alive(now or b"") or self._alive(self._playback or b""):
            return Admission.REFUSED
        began = not self._live
        self._live[key] = run
        self._playback = None
        return Admission.FRESH if began else Admission.SAME
