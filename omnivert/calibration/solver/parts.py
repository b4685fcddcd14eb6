"""Parts of a drive, asked alone what the whole was asked: how far apart do they lie, and what says the last one?

A covariance holds if the model does. What the model leaves out (motors that lag, wheels that slip in one turn and not
in the next) stays alike for many steps, where residuals do not show it, and differs from part to part of the drive,
where it does. So the parts' disagreement is a chi-square that must be about its degrees of freedom; where it is larger
than chance allows, all variances grow by the ratio (Birge's).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from omnivert.angles import wrap
from omnivert.calibration.judging.observability import centres, covariance_from_information, pieces
from omnivert.calibration.kalman import model
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.problem import GLOBALS, Prior, Problem, with_frames
from omnivert.calibration.solver.smoother import Search, Solution

Array = NDArray[np.float64]

Recent = tuple[float, Array, Array]  # since when (s), phi, rho, psi (3,), covariance (3, 3)

RECENT = 60  # keyframes, a last part of the drive that may show the mount alone
CHANCE = 1e-3  # of parts that agree to lie as far apart
ON_AXIS = 4.0  # sigmas of rho within which a camera may sit on it: of few parts the scatter itself is little known
PULL = 0.05  # share of the whole's information that keeps a part in its valley


@dataclass(frozen=True, slots=True)
class Parts:
    """How far apart they lie."""

    chi: float
    freedom: int

    def __add__(self, other: "Parts") -> "Parts":
        return Parts(self.chi + other.chi, self.freedom + other.freedom)

    def scatter(self, chance: float = CHANCE) -> float:
        """Times the variance that the model has; 1 where the parts' disagreement is more likely than `chance`."""
        if not self.freedom or chdtrc(self.freedom, self.chi) > chance:
            return 1.0
        return max(1.0, self.chi / self.freedom)

    @property
    def disagreement(self) -> float:
        """As a chi-square of three degrees of freedom that is as unlikely."""
        return float(chdtri(3.0, max(chdtrc(self.freedom, self.chi), 1e-300))) if self.freedom else 0.0


AGREE = Parts(0.0, 0)  # there is only one


def widened(mount: Array, covariance: Array, scatter: float, doubted: bool) -> Array:
    """The covariance (3, 3) of phi, rho, psi, so many times as large.

    Where a doubted solution may then be of a camera on the axis, phi may be anything: only phi + psi stays known.
    """
    wide = scatter * covariance
    if doubted and mount[1] ** 2 < ON_AXIS**2 * wide[1, 1]:
        turned = np.array([1.0, 0.0, -1.0])
        wide = wide + np.pi**2 / 3.0 * np.outer(turned, turned)
    return np.asarray(wide)


def from_prior(prior: Prior, shared: Array, information: Array) -> Parts:
    """A stretch against those before it, which have become its prior.

    shared       (6,)    the solution of all of them, nothing held
    information  (6, 6)  of all of them
    """
    if not prior.information[:3, :3].any():  # there was none before
        return AGREE
    moved = shared - prior.mean
    moved[0] = wrap(float(moved[0]))
    # Of the stretch alone m, H: its distance d from the prior (m0, H0) is H^-1 (H + H0) moved, and of chi-square
    # d' (H^-1 + H0^-1)^-1 d = moved' (H + H0) H^-1 H0 moved.
    own = information - prior.information
    value, vector = np.linalg.eigh(0.5 * (own + own.T))
    open_ = vector / np.maximum(value, 1e-6 * value[-1])
    chi = float((information @ moved) @ (open_ @ (vector.T @ (prior.information @ moved))))
    return Parts(max(chi, 0.0), GLOBALS)


def halves(problem: Problem, solution: Solution) -> Parts:
    """The halves of a stretch against each other."""
    middle = problem.frames // 2
    found = [part_alone(problem, solution, a, b) for a, b in ((0, middle), (middle, problem.frames))]
    if found[0] is None or found[1] is None:
        return AGREE
    off = found[0][0] - found[1][0]
    off[0] = wrap(float(off[0]))
    return Parts(float(off @ np.linalg.solve(found[0][1] + found[1][1], off)), 3)


def recent(problem: Problem, solution: Solution) -> Recent | None:
    """The mount as the last part alone has it; None where that does not show it."""
    first = problem.frames - RECENT
    if first < RECENT // 2:
        return None
    moved = problem.increments(solution.x.corrections).wheels_m[first:]
    wheels = problem.wheels
    if len(centres(pieces(moved, wheels.base_m, wheels.noise_k_m, wheels.tick_m))) < 2:
        return None
    alone = part_alone(problem, solution, first, problem.frames)
    if alone is None:
        return None
    mount, slope = model.polar_from_cartesian(alone[0])
    return float(problem.stamp_s[first]), mount, slope @ alone[1] @ slope.T


def part_alone(problem: Problem, solution: Solution, first: int, last: int) -> tuple[Array, Array] | None:
    """Mount (eta, cx, cy) and covariance (3, 3) by keyframes first..last-1 alone, from the whole's solution.

    None when they hold too little.
    """
    part, lines = with_frames(problem, first, last)
    if part.frames < 3 or not part.line.size:
        return None
    pull = np.zeros((GLOBALS, GLOBALS))
    pull[:3, :3] = PULL * solution.mount_information
    x = solution.x
    part = replace(part, prior=Prior(x.shared, pull, np.arange(GLOBALS) < 3, x.corrections))
    begin = Unknowns(x.pose[first:last], x.shared, x.anchor[lines], x.u[lines], x.w[lines])
    try:
        found = Search(part).solved(_from_origin(begin), part.std, 6, 0.1)
        return found.x.mount, covariance_from_information(found.mount_information)
    except ArithmeticError:
        return None


def _from_origin(x: Unknowns) -> Unknowns:
    """The same with the first pose at the origin."""
    px, py, turn = x.pose[0]
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, s], [-s, c]])
    pose = np.column_stack([(x.pose[:, :2] - [px, py]) @ back.T, x.pose[:, 2] - turn])
    return Unknowns(pose, x.shared, (x.anchor - [px, py]) @ back.T, x.u - turn, x.w)
