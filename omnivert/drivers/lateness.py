"""How unevenly readings come: the last of them, against the fastest."""

from collections import deque

import numpy as np


class Lateness:
    """Delays of the last readings."""

    def __init__(self, readings: int = 1000) -> None:
        self._late_ns: deque[int] = deque(maxlen=readings)

    def add(self, late_ns: int) -> None:
        self._late_ns.append(late_ns)

    def __str__(self) -> str:
        """In words; "" before there is anything to tell."""
        if not self._late_ns:
            return ""
        median, p99 = np.percentile(np.asarray(self._late_ns) * 1e-6, (50.0, 99.0))
        return f"{median:.1f} ms, p99 {p99:.1f} ms"
