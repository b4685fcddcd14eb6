"""The best mount, way and lines for all that was seen of a stretch (MAP): Gauss-Newton with a robust loss."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from omnivert.angles import TURN, wrap
from omnivert.calibration.normal import Normal, Unknowns, cost, normal, sights
from omnivert.calibration.problem import Index, Problem
from omnivert.calibration.triangulation import triangulated

Array = NDArray[np.float64]

OUTLIERS = 0.05  # share of bearings that point anywhere, a priori
W_RANGE = (-0.02, 5.0)  # 1/m; a little past infinity does no harm


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    x: Unknowns
    weight: Array  # (M,) how likely each bearing is of its line
    score: float  # -2 log likelihood; comparable between solutions of one problem
    normal: Normal  # at x, undamped

    def inlier_share(self) -> float:
        return float(self.weight.mean()) if self.weight.size else 0.0

    def mount_information(self) -> Array:
        """(3, 3) of eta, cx, cy, all else unknown; first pose fixed."""
        m = self.normal.matrix[3:, 3:]
        factor = cho_factor(m[:-3, :-3])
        return np.asarray(m[-3:, -3:] - m[-3:, :-3] @ cho_solve(factor, m[:-3, -3:]))

    def inverse_distance_std(self) -> Array:
        """(L,) 1/m, all else unknown; first pose fixed."""
        n = self.normal
        through = np.einsum("pli,li->pl", n.coupling[3:], n.line_inverse[:, :, 1])
        shared = np.sum(through * cho_solve(cho_factor(n.matrix[3:, 3:]), through), axis=0)
        return np.asarray(np.sqrt(n.line_inverse[:, 1, 1] + shared))


def mixture(error: Array, std: Array) -> tuple[Array, Array]:
    """Bearings are Gaussian, or point anywhere: chance of the former (M,), and -2 log likelihood (M,)."""
    near = (1.0 - OUTLIERS) / (np.sqrt(TURN) * std) * np.exp(-0.5 * np.minimum((error / std) ** 2, 1400.0))
    both = near + OUTLIERS / TURN
    return near / both, -2.0 * np.log(both)


def solved(problem: Problem, x: Unknowns, std: Array, iterations: int, tolerance: float = 1e-3) -> Solution:
    """Gauss-Newton from x, damped where a step does not help.

    std         (M,)  rad; larger than the true one while far from the solution
    tolerance   of the score, below which it is done
    """
    information = problem.step_information()
    damping = 1e-9  # small: weak directions are what this is about
    seen = sights(problem, x)
    weight, loss = mixture(seen.error, std)
    score = float(loss.sum()) + cost(problem, x, information)
    for _ in range(iterations):
        trial = moved(x, normal(problem, x, seen, weight / std**2, information, damping))
        if trial is None:
            damping *= 100.0
            continue
        trial_seen = sights(problem, trial)
        trial_weight, loss = mixture(trial_seen.error, std)
        trial_score = float(loss.sum()) + cost(problem, trial, information)
        gain = score - trial_score
        if gain < 0.0:
            damping *= 100.0
            if gain > -tolerance or damping > 1.0:
                break
            continue
        x, seen, weight, score = trial, trial_seen, trial_weight, trial_score
        damping = max(damping * 0.01, 1e-9)
        if gain < tolerance:
            break
    return Solution(x, weight, score, normal(problem, x, seen, weight / std**2, information, 0.0))


def annealed(
    problem: Problem, x: Unknowns, stages: tuple[float, ...], iterations: int, last: float | None = None
) -> Solution:
    """From a rough x: large bearing sigmas first, lost lines placed anew at each stage.

    last  sigma to end with, where it is not yet to be the true one
    """
    for sigma in stages:
        std = np.maximum(problem.std, sigma)
        x = solved(problem, replaced(problem, x, std), std, iterations, 0.5).x
    if last is not None:
        std = np.maximum(problem.std, last)
        return solved(problem, replaced(problem, x, std), std, iterations, 0.5)
    return polished(problem, solved(problem, replaced(problem, x, problem.std), problem.std, 3 * iterations, 0.02))


def polished(problem: Problem, solution: Solution, rounds: int = 3) -> Solution:
    """Lines that some of their sights miss are placed anew and everything solved again, as long as that helps."""
    for _ in range(rounds):
        x = replaced(problem, solution.x, problem.std)
        if x is solution.x:
            return solution
        trial = solved(problem, x, problem.std, 10, 0.01)
        if trial.score > solution.score - 0.5:
            return solution if trial.score > solution.score else trial
        solution = trial
    return solution


def replaced(problem: Problem, x: Unknowns, std: Array) -> Unknowns:
    """x with the lines placed anew that some of their sights miss, where that is better; x itself when none is."""
    weight, loss = mixture(sights(problem, x).error, std)
    count = np.bincount(problem.line, minlength=x.u.size)
    missed = np.bincount(problem.line, 1.0 - weight, x.u.size)
    lost: Index = np.flatnonzero((missed > 0.7) & (count > 1))
    if not lost.size:
        return x
    u, w = triangulated(problem, x.pose, x.mount, std, x.anchor, x.u, x.w, lost)
    trial = Unknowns(x.pose, x.mount, x.anchor, u, w)
    _, trial_loss = mixture(sights(problem, trial).error, std)
    better = np.bincount(problem.line, trial_loss, x.u.size) < np.bincount(problem.line, loss, x.u.size) - 2.0
    if not better.any():
        return x
    return Unknowns(x.pose, x.mount, x.anchor, np.where(better, u, x.u), np.where(better, w, x.w))


def moved(x: Unknowns, n: Normal) -> Unknowns | None:
    """x after Gauss-Newton's step; None when the matrix is not positive definite."""
    try:
        factor = cho_factor(n.matrix[3:, 3:], lower=True, check_finite=True)
    except (np.linalg.LinAlgError, ValueError):
        return None
    step = np.concatenate([np.zeros(3), cho_solve(factor, n.vector[3:])])
    line = np.einsum("lij,lj->li", n.line_inverse, n.line_vector - np.einsum("pli,p->li", n.coupling, step))
    mount = x.mount + step[-3:]
    mount[0] = wrap(float(mount[0]))
    return Unknowns(
        x.pose + step[:-3].reshape(-1, 3), mount, x.anchor, x.u + line[:, 0], np.clip(x.w + line[:, 1], *W_RANGE)
    )


def joint(solution: Solution, lines: Index) -> Array:
    """Covariance (6 + 2 N) of last pose, mount and the lines' (u, w), in this order; first pose fixed."""
    n = solution.normal
    size = n.matrix.shape[0]
    picked = np.zeros((size - 3, 6 + 2 * lines.size))
    picked[np.arange(size - 9, size - 3), np.arange(6)] = 1.0
    through = -np.einsum("pli,lij->plj", n.coupling[3:, lines], n.line_inverse[lines])
    picked[:, 6:] = through.reshape(size - 3, 2 * lines.size)
    covariance = picked.T @ cho_solve(cho_factor(n.matrix[3:, 3:]), picked)
    for k, line in enumerate(lines.tolist()):
        covariance[6 + 2 * k : 8 + 2 * k, 6 + 2 * k : 8 + 2 * k] += n.line_inverse[line]
    return np.asarray(0.5 * (covariance + covariance.T))
