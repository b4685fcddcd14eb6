"""What a solve of the drive so far has found."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.manoeuvre import Manoeuvre
from omnivert.calibration.judging.observability import Piece, Seen, larger
from omnivert.calibration.solver.noise import Component, Noise
from omnivert.calibration.solver.parts import Recent, widened
from omnivert.calibration.solver.seed import Seed
from omnivert.calibration.symmetric import evened
from omnivert.messages import Correction

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """One solution over the whole stretch, and what was joined from earlier ones."""

    mount: Array  # (3,) phi, rho, psi
    covariance: Array  # (3, 3), as the solution has it
    shown: Array  # (3, 3), as the nominal way has it
    gap: float  # -2 log likelihood to the next best, different solution
    centres: tuple[Piece, ...]  # clearly different centres of rotation in the drive
    disagreement: float  # of the parts of the drive, as a chi-square of 3 degrees of freedom
    scatter: float  # times the model's variance, by how far the parts lie apart; 1 where they agree
    doubted: bool  # parts contradict each other, or clocks and wheels what is configured
    seed: Seed
    corrections: Array  # (3,) time offset (s), wheel ratio - 1, base / configured - 1
    told: tuple[Correction, ...]  # the same for people
    residuals: tuple[Component, Component]  # of the wheels, of the bearings
    noise: Noise  # used
    recent: Recent | None  # the mount as the last part of the drive alone has it; None where that does not show it
    todo: Manoeuvre  # what to drive next, to know more

    @property
    def honest_covariance(self) -> Array:
        return evened(self.covariance) + self.excess

    def sum_sigma(self) -> float:
        """Sigma of phi + psi, rad."""
        both = np.array([1.0, 0.0, 1.0])
        return float(np.sqrt(both @ self.honest_covariance @ both))

    @property
    def excess(self) -> Array:
        """What the nominal way, and the parts' disagreement, leave open beyond the solution's own covariance (3, 3)."""
        gap = widened(self.mount, larger(self.covariance, self.shown), self.scatter, self.doubted) - self.covariance
        return evened(gap)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What one call of the solver has found."""

    result: Result | None  # None while there is no single clear solution
    centres: tuple[Piece, ...]  # clearly different centres of rotation so far, as the wheels tell
    seen: Seen | None  # what the drive shows, also where it shows no single mount; None: no line was seen
    share: float  # of the bearings that the best solution explains, clear or not
    wrong: str  # what is wired wrongly, as far as the drive tells
    keyframes: int
    broke: bool = False  # the equations were not positive definite: nothing was found in them

    @property
    def doubted(self) -> bool:
        """Whether there is a result of which sigmas are no measure."""
        return self.result is not None and self.result.doubted
