"""One sensor's messages as they came: how often, how evenly, by which clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Int = NDArray[np.int64]

PAUSE_NS = 5 * 10**9  # a longer step is a pause, or a clock that was set; the rhythm is told without it


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """
    stamp_ns    (N,)  of the sensor
    sent_ns     (N,)  when it was published, on the publisher's monotonic clock; of a recording (0,)
    lost        messages between these that did not arrive, by their sequence numbers
    """

    stamp_ns: Int
    sent_ns: Int
    lost: int = 0

    @classmethod
    def recorded(cls, stamps_ns: Sequence[int]) -> "Stream":
        return cls(np.array(stamps_ns, dtype=np.int64), np.empty(0, dtype=np.int64))

    @property
    def count(self) -> int:
        return int(self.stamp_ns.size)

    @property
    def rate_hz(self) -> float:
        """As published, by the stamps; 0 where they do not tell."""
        steps = self._steps()
        if not steps.size:
            return 0.0
        return float(1e9 / np.median(steps)) * (self.count + self.lost) / self.count

    @property
    def repeated(self) -> int:
        """Stamps that are not after the one before."""
        return int((np.diff(self.stamp_ns) <= 0).sum())

    @property
    def lacking(self) -> float:
        """Messages that the rhythm of the others lacks."""
        steps = self._steps()
        if not steps.size:
            return 0.0
        return float((np.maximum(np.round(steps / np.median(steps)), 1.0) - 1.0).sum())

    @property
    def missing(self) -> float:
        """The same as a share of all."""
        return self.lacking / (self.lacking + self.count) if self.count else 0.0

    @property
    def longest_gap_s(self) -> float:
        return 1e-9 * float(self._steps().max(initial=0))

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp of at least one message."""
        return int(self.stamp_ns.min()), int(self.stamp_ns.max())

    @property
    def seconds(self) -> float:
        """From the first stamp to the last of at least one message, pauses left out."""
        return 1e-9 * float(self._steps().sum())

    @property
    def age_s(self) -> float | None:
        """From the stamp to publication, mostly; None where that is not known."""
        return 1e-9 * float(np.median(self.sent_ns - self.stamp_ns)) if self.sent_ns.size else None

    def jumps(self) -> list[tuple[int, float]]:
        """The stamp before each pause, and how long it was; s."""
        steps = np.diff(self.stamp_ns)
        return [(int(self.stamp_ns[i]), 1e-9 * float(steps[i])) for i in np.flatnonzero(steps > PAUSE_NS)]

    def clock_steps(self) -> list[float]:
        """By how much the stamps went on otherwise than the publisher's clock, where that is much; s."""
        if not self.sent_ns.size:
            return []
        off = 1e-9 * (np.diff(self.stamp_ns) - np.diff(self.sent_ns))
        return [float(value) for value in off if abs(value) > 1.0]

    def _steps(self) -> Int:
        steps = np.diff(self.stamp_ns)
        return steps[(steps > 0) & (steps <= PAUSE_NS)]


NOTHING = Stream.recorded(())
