"""The least of what was seen in a window of time."""

from collections import deque

STRETCHES = 50  # the window slides in so many steps


class Least:
    """Remembers the least of each stretch of the window."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._stretches: deque[tuple[int, int]] = deque()  # begun, least

    def step(self, now_ns: int, value: int) -> int:
        """The least with this one."""
        newest = self._stretches[-1] if self._stretches else None
        if newest is None or now_ns - newest[0] >= self._window_ns // STRETCHES:
            self._stretches.append((now_ns, value))
        else:
            self._stretches[-1] = (newest[0], min(newest[1], value))
        while now_ns - self._stretches[0][0] > self._window_ns:
            self._stretches.popleft()
        return min(least for _, least in self._stretches)
