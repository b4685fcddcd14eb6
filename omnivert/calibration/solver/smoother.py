"""The best mount, way and lines for all that was seen of a stretch (MAP): Gauss-Newton with a robust loss."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.calibration.solver import skyline
from omnivert.calibration.solver.layout import Layout
from omnivert.calibration.solver.normal import (
    Normal,
    Unknowns,
    bearing_errors,
    cost,
    increment_information,
    normal,
    stepped,
)
from omnivert.calibration.solver.problem import GLOBALS, Index, Problem
from omnivert.calibration.solver.triangulation import triangulated
from omnivert.calibration.symmetric import evened
from omnivert.compiled import compiled
from omnivert.increments import Increments

Array = NDArray[np.float64]

OUTLIERS = 0.05  # share of bearings that point anywhere, a priori
W_RANGE = (-0.02, 5.0)  # 1/m; a little past infinity does no harm
NEW_FRAME = (0.03, 0.01, 0.004)  # rad, sigmas with which a lost keyframe finds its place
FARTHEST = 0.3  # of a correction from what is configured: s, 1, 1


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the search ended, with the equations there."""

    x: Unknowns
    weight: Array  # (M,) how likely each bearing is of its line
    score: float  # -2 log likelihood; comparable between solutions of one problem
    normal: Normal  # at x, undamped

    @property
    def inlier_share(self) -> float:
        return float(self.weight.mean()) if self.weight.size else 0.0

    @cached_property
    def factor(self) -> Array:
        """Of the equations at x, in their spans; raises ArithmeticError when they are not positive definite."""
        n = self.normal
        values = n.values.copy()
        if not skyline.factored(n.layout.first, n.layout.start, values):
            raise ArithmeticError("the equations at the solution are not positive definite")
        return values

    @property
    def shared_information(self) -> Array:
        """(6, 6) of eta, cx, cy and the corrections, all else unknown; first pose fixed. Of what is held: 1."""
        layout = self.normal.layout
        root = skyline.corner(layout.first, layout.start, self.factor, layout.shared)
        return np.asarray(root @ root.T)

    @property
    def mount_information(self) -> Array:
        """(3, 3) of eta, cx, cy, all else unknown; first pose fixed."""
        return marginal(self.shared_information, np.ones(3, dtype=np.bool_))

    @cached_property
    def spans(self) -> Array:
        """The covariance of all unknowns, inside the spans."""
        layout = self.normal.layout
        return skyline.inverse(layout.first, layout.start, self.factor)

    def inverse_distance_std(self) -> Array:
        """(L,) 1/m, all else unknown; first pose fixed."""
        layout = self.normal.layout
        return np.asarray(np.sqrt(self.spans[layout.start[layout.line + 2] - 1]))


def marginal(information: Array, free: NDArray[np.bool_]) -> Array:
    """Information on the mount (3, 3) out of that on mount and corrections (6, 6).

    free  (3,)  corrections that are unknown; the others are held
    """
    own = 3 + np.flatnonzero(free)
    across = information[:3, own]
    return np.asarray(information[:3, :3] - across @ np.linalg.solve(information[np.ix_(own, own)], across.T))


@compiled
def mixture(error: Array, std: Array) -> tuple[Array, Array]:
    """Bearings are Gaussian, or point anywhere: chance of the former (M,), and -2 log likelihood (M,)."""
    weight, loss = np.empty(error.size), np.empty(error.size)
    for m in range(error.size):
        z = error[m] / std[m]
        near = (1.0 - OUTLIERS) / (np.sqrt(TURN) * std[m]) * np.exp(-0.5 * min(z * z, 1400.0))
        both = near + OUTLIERS / TURN
        weight[m], loss[m] = near / both, -2.0 * np.log(both)
    return weight, loss


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """A point of the search."""

    x: Unknowns
    error: Array
    weight: Array
    moved: Increments
    score: float


class Search:
    """One problem, searched from many places: what does not depend on the place is worked out once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._layout = Layout.of(problem)
        held = problem.increments(problem.held)
        self._held = None if problem.prior.free[3:].any() else held
        # Covariances hardly change with the corrections; kept, the score of all places compares.
        self.information = increment_information(held.covariance)

    def solved(self, x: Unknowns, std: Array, iterations: int, tolerance: float = 1e-3) -> Solution:
        """Gauss-Newton from x, damped where a step does not help.

        std         (M,)  rad; larger than the true one while far from the solution
        tolerance   of the score, below which it is done
        """
        damping = 1e-9  # small: weak directions are what this is about
        at = self._state(x, std)
        for _ in range(iterations):
            trial_x = self._stepped(at, std, damping)
            if trial_x is None:
                damping *= 100.0
                if damping > 1.0:
                    break
                continue
            trial = self._state(trial_x, std)
            gain = at.score - trial.score
            if not gain >= 0.0:
                damping *= 100.0
                if gain > -tolerance or damping > 1.0:
                    break
                continue
            at = trial
            damping = max(damping * 0.01, 1e-9)
            if gain < tolerance:
                break
        return Solution(at.x, at.weight, at.score, self._normal(at, std, 0.0))

    def annealed(self, x: Unknowns, stages: tuple[float, ...], iterations: int, last: float | None = None) -> Solution:
        """From a rough x: large bearing sigmas first, lost lines placed anew at each stage.

        last  sigma to end with, where it is not yet to be the true one
        """
        std = self.problem.std
        for sigma in stages:
            wide = np.maximum(std, sigma)
            x = self.solved(self.replaced(x, wide), wide, iterations, 0.5).x
        if last is not None:
            wide = np.maximum(std, last)
            return self.solved(self.replaced(x, wide), wide, iterations, 0.5)
        return self.polished(self.solved(self.replaced(x, std), std, 3 * iterations, 0.02))

    def continued(self, x: Unknowns, iterations: int) -> Solution:
        """From the solution of almost the same problem: keyframes that are new, or were lost, find their place first.

        Dead reckoning misses a keyframe by many sigmas of its bearings; taken at once, all of them would be rejected.
        """
        problem, std = self.problem, self.problem.std
        for sigma in NEW_FRAME:
            lost = self._lost_frames(x)
            if not lost.any():
                break
            x = self.solved(x, np.where(lost[problem.frame], np.maximum(std, sigma), std), 4, 0.5).x
        return self.polished(self.solved(self.replaced(x, std), std, iterations, 0.01), 2)

    def _lost_frames(self, x: Unknowns) -> NDArray[np.bool_]:
        """Keyframes with most of their bearings rejected (F,)."""
        frame = self.problem.frame
        weight, _ = mixture(self.bearing_errors(x), self.problem.std)
        count = np.bincount(frame, minlength=self.problem.frames)
        return np.asarray((np.bincount(frame, weight, self.problem.frames) < 0.6 * count) & (count > 1))

    def polished(self, solution: Solution, rounds: int = 3) -> Solution:
        """Lines that some of their sights miss are placed anew and everything solved again, as long as that helps."""
        std = self.problem.std
        for _ in range(rounds):
            x = self.replaced(solution.x, std)
            if x is solution.x:
                return solution
            trial = self.solved(x, std, 10, 0.01)
            if trial.score > solution.score - 0.5:
                return solution if trial.score > solution.score else trial
            solution = trial
        return solution

    def replaced(self, x: Unknowns, std: Array) -> Unknowns:
        """x with the lines placed anew that some of their sights miss, where that is better; x itself when none is."""
        problem, lines = self.problem, x.u.size
        weight, loss = mixture(self.bearing_errors(x), std)
        count = np.bincount(problem.line, minlength=lines)
        missed = np.bincount(problem.line, 1.0 - weight, lines)
        lost: Index = np.flatnonzero((missed > 0.7) & (count > 1))
        if not lost.size:
            return x
        u, w = triangulated(problem, x.pose, x.mount, std, x.anchor, x.u, x.w, lost)
        _, trial_loss = mixture(self.bearing_errors(replace(x, u=u, w=w)), std)
        better = np.bincount(problem.line, trial_loss, lines) < np.bincount(problem.line, loss, lines) - 2.0
        if not better.any():
            return x
        return replace(x, u=np.where(better, u, x.u), w=np.where(better, w, x.w))

    def opened(self, solution: Solution) -> tuple[Array, Array]:
        """Were nothing held: information (6, 6) on what is shared at a solution, and the step that it asks for (6,).

        raises  ArithmeticError when the equations are not positive definite
        """
        problem, layout, x = self.problem, self._layout, solution.x
        prior = replace(problem.prior, free=np.ones(GLOBALS, dtype=np.bool_))
        moved = problem.increments(x.corrections)
        n = normal(
            replace(problem, prior=prior),
            layout,
            x,
            self.bearing_errors(x),
            solution.weight / problem.std**2,
            moved,
            self.information,
            0.0,
        )
        whole = replace(solution, normal=n)
        step = skyline.solved(layout.first, layout.start, whole.factor, n.vector)
        return whole.shared_information, step[layout.shared : layout.shared + GLOBALS]

    def bearing_errors(self, x: Unknowns) -> Array:
        """Measured - predicted (M,) rad."""
        p = self.problem
        return bearing_errors(p.frame, p.line, p.beta, x.pose, x.mount, x.anchor, x.u, x.w)

    def _state(self, x: Unknowns, std: Array) -> _State:
        error = self.bearing_errors(x)
        weight, loss = mixture(error, std)
        moved = self._held or self.problem.increments(x.corrections)
        return _State(x, error, weight, moved, float(loss.sum()) + cost(self.problem, x, moved, self.information))

    def _normal(self, at: _State, std: Array, damping: float) -> Normal:
        return normal(
            self.problem, self._layout, at.x, at.error, at.weight / std**2, at.moved, self.information, damping
        )

    def _stepped(self, at: _State, std: Array, damping: float) -> Unknowns | None:
        """After Gauss-Newton's step; None when the matrix is not positive definite."""
        n, layout, x = self._normal(at, std, damping), self._layout, at.x
        if not skyline.factored(layout.first, layout.start, n.values):
            return None
        step = skyline.solved(layout.first, layout.start, n.values, n.vector)
        if not np.isfinite(step).all():
            return None
        trial = stepped(x, layout, step)
        trial.shared[0] = wrap(float(trial.shared[0]))
        trial.shared[3:] = np.clip(trial.shared[3:], -FARTHEST, FARTHEST)
        return replace(trial, w=np.clip(trial.w, *W_RANGE))


def joint(solution: Solution, lines: Index) -> Array:
    """Covariance (6 + 2 N) of last pose, mount and the lines' (u, w), in this order; first pose fixed.

    lines  (N,)  of those that the last keyframe sees
    """
    layout = solution.normal.layout
    begin = int(layout.pose[-1])
    root = skyline.corner(layout.first, layout.start, solution.factor, begin)
    covariance = np.linalg.inv(root @ root.T)
    rows = np.concatenate(
        [np.arange(3), layout.shared - begin + np.arange(3), (layout.line[lines, None] - begin + np.arange(2)).ravel()]
    )
    picked = covariance[np.ix_(rows, rows)]
    return evened(picked)
