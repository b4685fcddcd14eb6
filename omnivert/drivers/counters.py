"""Raw counts -> cumulative counts: rollover undone, sides and signs put right, jumps refused."""

from dataclasses import dataclass

from omnivert.config import Encoder
from omnivert.drivers.protocols import counter_bits, counts_per_s

BREAK = 2**40  # counts; no wheel makes them in a silence that is short enough to be bridged
START_SPAN = 2**52  # counts; what is added to a start within it stays a number that Ticks can hold


@dataclass(frozen=True, slots=True)
class Jump:
    """Why a pair of counts cannot be what the wheels did."""

    reason: str


class CounterPair:
    """Both wheels' counters.

    It starts from the device's own counts, so that it goes on smoothly where the bridge, not the device, was restarted.
    """

    def __init__(self, config: Encoder) -> None:
        self._span = 1 << counter_bits(config)
        self._swapped = config.swap_sides
        self._signs = (config.left_sign, config.right_sign)
        self._counts_per_s = counts_per_s(config)
        self._raw: tuple[int, int] | None = None
        self._total = (0, 0)
        self._break = BREAK

    def step(self, left: int, right: int, elapsed_s: float) -> tuple[int, int] | Jump:
        """Cumulative counts, positive forward; a jump leaves the state as it was.

        left, right  raw counts, signed or unsigned, as the device calls its sides
        elapsed_s    since the last pair that was taken
        """
        left, right = (right, left) if self._swapped else (left, right)
        if not (self._fits(left) and self._fits(right)):
            return Jump("count beyond the counter's width")
        if self._raw is None:
            self._total = (_start(self._nearest(left)) * self._signs[0], _start(self._nearest(right)) * self._signs[1])
        else:
            moved = (self._nearest(left - self._raw[0]), self._nearest(right - self._raw[1]))
            # Two counts more, for where in its count a wheel stood.
            limit = self._counts_per_s * elapsed_s + 2.0
            if max(abs(moved[0]), abs(moved[1])) > limit:
                return Jump("count jumps")
            self._total = (self._total[0] + self._signs[0] * moved[0], self._total[1] + self._signs[1] * moved[1])
        self._raw = (left, right)
        return self._total

    def restart(self, left: int, right: int) -> tuple[int, int] | Jump:
        """Goes on with the device's counts as they are now, out of reach of those before.

        What was driven meanwhile is unknown, and whoever adds up the way must see that it is.
        """
        left, right = (right, left) if self._swapped else (left, right)
        if not (self._fits(left) and self._fits(right)):
            return Jump("count beyond the counter's width")
        self._raw = (left, right)
        self._total = (self._total[0] + self._break, self._total[1] + self._break)
        self._break = -self._break
        return self._total

    def _fits(self, raw: int) -> bool:
        return -self._span // 2 <= raw < self._span

    def _nearest(self, difference: int) -> int:
        """The difference with the smallest magnitude among those that the counter's width cannot tell apart."""
        half = self._span // 2
        return (difference + half) % self._span - half


def _start(count: int) -> int:
    """A first count, small enough to have room to grow; only counters of more than 52 bits are changed by it."""
    return (count + START_SPAN // 2) % START_SPAN - START_SPAN // 2
