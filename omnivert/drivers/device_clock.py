"""The device's clock -> the bridge's monotonic clock, without the jitter of the way between them.

A line is never early: arrival = device time + offset + delay, delay >= 0. So the offset is the lower edge of the
differences, and where the device's clock runs fast or slow that edge is slanted: it is the edge of the lower convex
hull over the middle of a window (the one that lies closest below all points together).
"""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

from omnivert.config import Encoder
from omnivert.drivers.lateness import Lateness

NS_PER_US = 1000
SPAN_US = 2**32  # where a device's clock rolls over


@dataclass(slots=True)
class _Least:
    """The line of a stretch of time that came through fastest."""

    begun_ns: int
    device_ns: int
    offset_ns: int  # arrival - device time


class DeviceClock:
    """One device's clock since it was last restarted; device times in, not rolled over, growing."""

    own = True  # a device's, which begins anew when the device does

    def __init__(self, config: Encoder) -> None:
        self._window_ns = int(config.clock_window_s * 1e9)
        self._stretch_ns = self._window_ns // 50
        self._largest_skew = config.clock_max_skew
        self._least: deque[_Least] = deque()
        self._skew = 0.0
        self._origin = (0, 0)  # a point on the edge: device time, offset
        self._lateness = Lateness()

    def step(self, device_us: int, arrival_ns: int) -> int:
        """When the device read its counters, on the bridge's clock; never after the arrival."""
        device_ns = device_us * NS_PER_US
        offset_ns = arrival_ns - device_ns
        if not self._least or device_ns - self._least[-1].begun_ns >= self._stretch_ns:
            self._least.append(_Least(device_ns, device_ns, offset_ns))
            while device_ns - self._least[0].begun_ns > self._window_ns:
                self._least.popleft()
            self._fit()
        else:
            newest = self._least[-1]
            # Compared along the edge: on a slanted one a later point may lie deeper without having been faster.
            if offset_ns - self._skew * device_ns < newest.offset_ns - self._skew * newest.device_ns:
                newest.device_ns, newest.offset_ns = device_ns, offset_ns
                self._fit()
        sent_ns = min(self._sent_ns(device_ns), arrival_ns)
        self._lateness.add(arrival_ns - sent_ns)
        return sent_ns

    def advance_us(self, before_us: int, after_us: int) -> int:
        """How far the device's clock has gone on, its rollover undone; negative when it went back; us."""
        half = SPAN_US // 2
        return (after_us - before_us + half) % SPAN_US - half

    def __str__(self) -> str:
        """Drift and jitter, in words; "" before there is anything to tell."""
        late = str(self._lateness)
        drift = f"{abs(1e6 * self._skew):.0f} ppm {'fast' if self._skew < 0 else 'slow'}"
        return late and f"runs {drift}; lines come {late} after the fastest"

    def early_ns(self, device_us: int, arrival_ns: int) -> int:
        """How long before it was sent, by this clock, a line would have arrived; negative when it came after."""
        return self._sent_ns(device_us * NS_PER_US) - arrival_ns if self._least else 0

    def _sent_ns(self, device_ns: int) -> int:
        return device_ns + round(self._origin[1] + self._skew * (device_ns - self._origin[0]))

    def _fit(self) -> None:
        """The lower hull's edge over the middle of the window."""
        hull: list[tuple[int, int]] = []
        for least in self._least:
            point = (least.device_ns, least.offset_ns)
            while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        span_ns = hull[-1][0] - hull[0][0]
        if span_ns < self._window_ns // 10:  # too short to tell a slant from jitter
            self._skew, self._origin = 0.0, min(hull, key=lambda point: point[1])
            return
        middle_ns = hull[0][0] + span_ns // 2
        right = min(bisect_right(hull, middle_ns, key=lambda point: point[0]), len(hull) - 1)
        (u, a), (v, b) = hull[right - 1], hull[right]
        self._skew = max(-self._largest_skew, min(self._largest_skew, (b - a) / (v - u)))
        self._origin = (u, a)


def _turns_down(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])


class BridgeClock:
    """In place of a device's clock where the device tells no time: readings are stamped by the bridge's own."""

    own = False

    def step(self, time_us: int, arrival_ns: int) -> int:
        return min(time_us * NS_PER_US, arrival_ns)

    def advance_us(self, before_us: int, after_us: int) -> int:
        return after_us - before_us

    def early_ns(self, time_us: int, arrival_ns: int) -> int:
        return time_us * NS_PER_US - arrival_ns
