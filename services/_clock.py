"""When each message of a playback is due."""

import time

_HURRY_S = 0.1  # a shorter wait is caught up


class Clock:
    """When each message is due, counted from the first one, which is due when it is asked for."""

    def __init__(self, speed: float, longest_pause_s: float) -> None:
        self._speed = speed
        self._longest_pause_s = longest_pause_s
        self._zero_s: float | None = None  # when the first message was due
        self._last_ns: int | None = None
        self._at_s = 0.0  # the last message's time in the playback

    def until(self, stamp_ns: int) -> float:
        """How long to wait until this message is due; s."""
        if self._speed == 0.0:
            return 0.0
        self._reach(stamp_ns)
        now_s = time.monotonic()
        if self._zero_s is None:
            self._zero_s = now_s
        return self._zero_s + self._at_s - now_s

    def due_now(self, stamp_ns: int) -> None:
        """This message is due now, and what follows so much later as its stamps say."""
        if self._speed > 0.0:
            self._reach(stamp_ns)
            self._zero_s = time.monotonic() - self._at_s

    def stood_still(self, duration_s: float) -> None:
        """The playback waited for its results; it does not hurry afterwards."""
        if duration_s > _HURRY_S and self._zero_s is not None:
            self._zero_s += duration_s

    def _reach(self, stamp_ns: int) -> None:
        if stamp_ns != self._last_ns:
            pause_s = (stamp_ns - self._last_ns) * 1e-9 if self._last_ns is not None else 0.0
            self._at_s += min(pause_s, self._longest_pause_s) / self._speed
            self._last_ns = stamp_ns
