"""The filter's life: seeded by the smoother, carried on frame by frame, seeded again whenever a new solution comes.

A solution is of the keyframe at which its work began. What came since is kept, and driven through once more from there,
so that the smoother may take its time and the filter never waits.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.kalman.ekf import Evidence, Filter, Innovation, Rules
from omnivert.calibration.sighting import Sighting
from omnivert.calibration.solver.result import Result
from omnivert.odometry import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Forget:
    """The way broke off: lines are others from there on."""


class Pulse:
    """The filter, when there is one, and what it has been told since the last mark."""

    def __init__(self, running: Filter | None = None) -> None:
        self.filter = running
        self.innovation = Innovation(0, 0, 0)
        self._scout: Filter | None = None  # what the watchdog looks through
        self._scouted: Evidence | None = None
        self._since: list[Motion | Sighting | _Forget] | None = None  # the mark; None before the first

    @property
    def watched(self) -> tuple[Filter | None, Evidence | None]:
        """A filter that knows every line there is, and what it had expected of the last frame."""
        return (self.filter, self.innovation.evidence) if self._scout is None else (self._scout, self._scouted)

    def predict(self, motion: Motion) -> None:
        self._keep(motion)
        for known in (self.filter, self._scout):
            if known is not None:
                known.predict(motion)

    def update(self, sighting: Sighting) -> bool:
        """False when the filter has lost its footing: its covariance is none any more, and it is given up."""
        self._keep(sighting)
        if self.filter is None:
            self.innovation = Innovation(0, sighting.track.size, 0)
            return True
        self.innovation = self.filter.update(sighting.track, sighting.beta, sighting.std)
        if not self.filter.is_sound:
            self.drop()
            return False
        if self._scout is not None:
            self._scouted = self._scout.update(sighting.track, sighting.beta, sighting.std).evidence
            if not self._scout.is_sound:  # the filter stands in for it until the next seed
                self._scout, self._scouted = None, None
        return True

    def forget_lines(self) -> None:
        self._keep(_Forget())
        for known in (self.filter, self._scout):
            if known is not None:
                known.forget_lines()

    def mark(self) -> None:
        """A solution of what has come until now is on its way."""
        self._since = []

    def seed(self, result: Result, is_watched: bool = False) -> bool:
        """Go on from a solution of the last mark: its mount and lines, and then all that has come since.

        False when that loses its footing on the way; what runs then runs on.

        is_watched  a watchdog looks on
        """
        # Lines that the filter starts itself make it too sure by half within 60 frames [measured]; the batch starts
        # them. That takes ten frames and more, in which they would tell of a knock: so a scout starts them, too.
        fresh = self._led_on(result, Rules(enters=False))
        if fresh is None:
            return False
        self.filter = _taken_over(self.filter, fresh)
        scout = self._led_on(result, Rules()) if is_watched else None
        if scout is None:
            self._scout, self._scouted = None, None
        else:
            self._scout = _taken_over(self._scout, scout)
            self.filter.follow(False)
        return True

    def drop(self) -> None:
        """There is nothing to go on from any more."""
        self.filter, self._scout, self._scouted = None, None, None

    def _led_on(self, result: Result, rules: Rules) -> Filter | None:
        """A new filter that has come from a solution to now; None when it has lost its footing on the way."""
        seed = result.seed.without_loose()
        fresh = Filter(result.mount, result.covariance, rules)
        fresh.seed(result.mount, seed.lines, seed.covariance, list(seed.tracks))
        for told in self._since or []:
            match told:
                case Motion():
                    fresh.predict(told)
                case Sighting():
                    fresh.update(told.track, told.beta, told.std)
                case _Forget():
                    fresh.forget_lines()
        return fresh if fresh.is_sound else None

    def _keep(self, told: Motion | Sighting | _Forget) -> None:
        if self._since is not None:
            self._since.append(told)


def _taken_over(running: Filter | None, fresh: Filter) -> Filter:
    """The running filter with the fresh one's state, so that it goes on counting and following; else the fresh one."""
    if running is None or running.rules != fresh.rules:
        return fresh
    layout = fresh.layout
    pairs = np.stack([fresh.x[layout.distance], fresh.x[layout.heading]], axis=1)
    running.seed(fresh.x[layout.mount], pairs, fresh.P, fresh.tracks)
    return running
