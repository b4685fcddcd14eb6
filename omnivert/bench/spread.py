"""Many durations in three numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, 99th percentile and count of some durations."""

    median_ms: float
    p99_ms: float
    count: int

    @classmethod
    def of_seconds(cls, seconds: Sequence[float]) -> "Spread":
        if not seconds:
            raise ValueError("nothing was measured")
        median, p99 = np.percentile(1e3 * np.asarray(seconds), (50.0, 99.0))
        return cls(float(median), float(p99), len(seconds))

    def json(self, yardstick: "Spread | None" = None) -> dict[str, Any]:
        """As an object; with a yardstick also the ratio of the medians."""
        body: dict[str, Any] = {"median_ms": self.median_ms, "p99_ms": self.p99_ms, "count": self.count}
        if yardstick is not None:
            body["sobel_pairs"] = self.median_ms / yardstick.median_ms
        return body
