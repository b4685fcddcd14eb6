"""The filter's life: seeded by the smoother, carried on frame by frame, seeded again whenever a new solution comes.

A solution is of the keyframe at which its work began. What came since is kept, and driven through once more from there,
so that the smoother may take its time and the filter never waits.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.kalman.ekf import Filter, Innovation, Rules
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
        self._since: list[Motion | Sighting | _Forget] | None = None  # the mark; None before the first

    def predict(self, motion: Motion) -> None:
        self._keep(motion)
        if self.filter is not None:
            self.filter.predict(motion)

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
        return True

    def forget_lines(self) -> None:
        self._keep(_Forget())
        if self.filter is not None:
            self.filter.forget_lines()

    def mark(self) -> None:
        """A solution of what has come until now is on its way."""
        self._since = []

    def seed(self, result: Result) -> bool:
        """Go on from a solution of the last mark: its mount and lines, and then all that has come since.

        False when that loses its footing on the way; what runs then runs on.
        """
        seed = result.seed.without_loose()
        # Lines that a filter starts itself make it too sure by half within 60 frames [measured]; a watchdog that looks
        # through such a one takes their errors for knocks. The batch starts them.
        fresh = Filter(result.mount, result.covariance, Rules(enters=False))
        fresh.seed(result.mount, seed.lines, seed.covariance, list(seed.tracks))
        for told in self._since or []:
            match told:
                case Motion():
                    fresh.predict(told)
                case Sighting():
                    fresh.update(told.track, told.beta, told.std)
                case _Forget():
                    fresh.forget_lines()
        if not fresh.is_sound:
            return False
        if self.filter is None or self.filter.rules != fresh.rules:
            self.filter = fresh
            return True
        layout = fresh.layout
        pairs = np.stack([fresh.x[layout.distance], fresh.x[layout.heading]], axis=1)
        self.filter.seed(fresh.x[layout.mount], pairs, fresh.P, fresh.tracks)
        return True

    def drop(self) -> None:
        """There is nothing to go on from any more."""
        self.filter = None

    def _keep(self, told: Motion | Sighting | _Forget) -> None:
        if self._since is not None:
            self._since.append(told)
