"""Frames wait here, cleaned, until the wheels' counts cover them."""

from collections import Counter, deque
from collections.abc import Iterator

import numpy as np

from omnivert.calibration.choice import Choice
from omnivert.calibration.sighting import Sighting, clean_sighting, is_stamp
from omnivert.config import Calibration
from omnivert.messages import Bearings
from omnivert.odometry import SECOND

SILENCE_NS = SECOND  # a frame waits this long, by the stamps of later frames, for counts that cover it
MOST_HELD = 1000  # frames that wait for counts at once: stamps that hardly grow would else make them wait for ever


class Waiting:
    """Takes bearings as they come; gives sightings in the order of their stamps.

    refused  bad input so far, by reason
    """

    def __init__(self, settings: Calibration) -> None:
        self.refused: Counter[str] = Counter()
        self._floor = float(np.deg2rad(settings.bearing_floor_deg))
        self._choice = Choice(settings.frame_lines)
        self._held: deque[Sighting] = deque()
        self._newest_ns = -1  # frame received

    @property
    def left_out(self) -> int:
        """Lines so far that were too many in a frame."""
        return self._choice.left_out

    def append(self, bearings: Bearings) -> None:
        if not is_stamp(bearings.stamp_ns):
            self.refused["bearings: stamp out of range"] += 1
            return
        if bearings.stamp_ns <= self._newest_ns:
            self.refused["bearings: stamp not after the one before"] += 1
            return
        self._newest_ns = bearings.stamp_ns
        sighting, bad = clean_sighting(bearings, self._floor)
        if bad:
            self.refused["bearings: track repeated in a frame, or a value that is no number"] += bad
        self._held.append(self._choice.step(sighting))

    def due(self, covered_ns: int | None) -> Iterator[Sighting]:
        """Those that the counts cover, which reach to a stamp, and those that have waited long enough."""
        while self._held:
            stamp_ns = self._held[0].stamp_ns
            covered = covered_ns is not None and covered_ns >= stamp_ns
            if not covered and self._newest_ns - stamp_ns <= SILENCE_NS and len(self._held) <= MOST_HELD:
                return
            yield self._held.popleft()

    def rest(self) -> Iterator[Sighting]:
        """All of them: no more counts will come."""
        while self._held:
            yield self._held.popleft()
