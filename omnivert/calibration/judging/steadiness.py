"""Whether a result has stood the test of the drive that followed it."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.kalman.model import mount_difference
from omnivert.calibration.solver.result import Outcome, Result
from omnivert.config import Calibration

Array = NDArray[np.float64]

CONTRADICTED = 16.3  # chi-square of 3, 1 in 1000
HOLD = 1.25  # times its limit: a sigma that may soon be claimed


class Steadiness:
    """Counts the keyframes for which results have agreed with the first of them.

    Only those count that might be claimed: a wrong optimum of a short drive can be
    clear, and small its sigma; what comes next moves it by many of these.
    """

    def __init__(self, limits: Calibration) -> None:
        angle = np.deg2rad(limits.sigma_limit_deg)
        self._limit = np.array([angle, limits.sigma_limit_m, angle])
        self.keyframes = 0
        self._first: tuple[Array, Array, int] | None = None  # mount, covariance, keyframes until then

    def step(self, outcome: Outcome) -> None:
        result = outcome.result
        if result is None or len(result.centres) < 2 or (_sigma(result) > HOLD * self._limit).any():
            self.keyframes, self._first = 0, None
            return
        if self._first is not None:
            mount, covariance, since = self._first
            off = mount_difference(result.mount, mount)
            if off @ np.linalg.solve(covariance, off) <= CONTRADICTED:
                self.keyframes = outcome.keyframes - since
                return
        self._first = result.mount, result.honest_covariance, outcome.keyframes
        self.keyframes = 0


def _sigma(result: Result) -> Array:
    return np.sqrt(np.diag(result.honest_covariance))
