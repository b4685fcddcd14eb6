"""The start that needs no guess.

With the sum eta = phi + psi held, every sight says that line, camera and direction are collinear, which is linear in
the lines' and the camera's position. So: one linear least squares for each eta on a circle, angular errors as score;
then Gauss-Newton on everything from the best few, with bearing sigmas that shrink; then a look at how clearly the best
one wins. Paper: start from hand measurement. Here: this, because the filter diverges unless D is known to about 10 %.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.normal import Unknowns
from omnivert.calibration.problem import Index, Problem, dead_reckoned, thinned, with_lines
from omnivert.calibration.smoother import Solution, annealed
from omnivert.calibration.triangulation import anchors, triangulated

Array = NDArray[np.float64]

ETAS = 60  # on the circle
FINALISTS = 3  # of the starts, that are annealed to the end
ROUGH = 0.1  # rad: what dead reckoning may be off by
STAGES = (0.3, 0.15, 0.08, 0.04, 0.02, 0.01, 0.005)  # rad, the annealing


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    solution: Solution
    gap: float  # -2 log likelihood by which the next best, different solution is worse; inf when there is none


def started(problem: Problem, max_rho: float, starts: int, keyframes: int, lines: int) -> Start | None:
    """The best mount for a whole stretch, from nothing; None when no start leads anywhere.

    starts     values of eta that are followed up
    keyframes  at most this many for the rough part
    lines      at most this many for the rough part, those seen most often
    """
    rough, _ = thinned(problem, keyframes)
    count = np.bincount(rough.line, minlength=problem.lines) if rough.line.size else np.zeros(0)
    often = np.sort(np.argsort(-count, kind="stable")[:lines])
    rough = with_lines(rough, often[count[often] >= 3])
    if rough.frames < 3 or rough.beta.size < 6:
        return None
    pose = dead_reckoned(rough.step)
    half = len(STAGES) // 2
    warm = [
        annealed(rough, unknowns(rough, pose, mount), STAGES[:half], 5, STAGES[half])
        for mount in candidates(rough, pose, max_rho, starts)
    ]
    warm.sort(key=lambda s: s.score)
    found = [annealed(rough, s.x, STAGES[half:], 5) for s in warm[:FINALISTS]]
    found = [s for s in found if float(np.hypot(*s.x.mount[1:])) <= 1.5 * max_rho]
    if not found:
        return None
    found.sort(key=lambda s: s.score)
    best = found[0]
    information = best.mount_information()
    gap = float("inf")
    for other in found[1:]:
        off = other.x.mount - best.x.mount
        off[0] = wrap(float(off[0]))
        if float(off @ information @ off) > 16.0:
            gap = min(gap, other.score - best.score)
    return Start(refined(problem, rough, best), gap)


def refined(problem: Problem, rough: Problem, found: Solution) -> Solution:
    """A solution of the thinned problem, on all keyframes."""
    # Between the solved keyframes the increments lead on; their few errors are Gauss-Newton's to remove.
    pose = dead_reckoned(problem.step)
    keep = np.unique(np.linspace(0, problem.frames - 1, rough.frames).round().astype(np.int64))
    shift = _between(pose, keep, found.x.pose)
    x = unknowns(problem, shift, found.x.mount)
    return annealed(problem, x, STAGES[-3:], 5)


def unknowns(problem: Problem, pose: Array, mount: Array) -> Unknowns:
    """All lines triangulated from the given poses and mount, with a sigma that forgives dead reckoning."""
    anchor = anchors(problem, pose)
    lines = problem.lines
    std = np.maximum(problem.std, 0.3 * ROUGH)
    empty = np.zeros(lines)
    u, w = triangulated(problem, pose, mount, std, anchor, empty, empty, np.arange(lines))
    return Unknowns(pose, mount, anchor, u, w)


def candidates(problem: Problem, pose: Array, max_rho: float, count: int) -> list[Array]:
    """The best mounts (eta, cx, cy) of the scan over eta, best first."""
    half = np.arange(ETAS // 2) * (2.0 * np.pi / ETAS)
    found = [linear_position(problem, pose, eta, max_rho) for eta in half.tolist()]
    # The equation does not tell a sight from its opposite: eta and eta + pi share a solution, the score decides.
    eta = wrap(np.concatenate([half, half + np.pi]))
    score = np.array([f[1] for f in found] + [f[2] for f in found])
    lowest = (score <= np.roll(score, 1)) & (score <= np.roll(score, -1))
    order = np.argsort(np.where(lowest, score, score + 1e9), kind="stable")
    return [np.array([eta[k], *found[k % half.size][0]]) for k in order[:count].tolist()]


def linear_position(problem: Problem, pose: Array, eta: float, max_rho: float) -> tuple[Array, float, float]:
    """The camera's place on the robot that fits best for one eta, the lines free; robust by reweighting.

    returns  place (2,) m, then how badly the sights miss the lines' places if they look there, and if they look away
    """
    lines, line = problem.lines, problem.line
    at = pose[problem.frame]
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    g = at[:, 2] + eta + problem.beta
    n = np.stack([-np.sin(g), np.cos(g)], axis=1)
    local = np.stack([n[:, 0] * c + n[:, 1] * s, -n[:, 0] * s + n[:, 1] * c], axis=1)  # n in the robot's frame
    told = np.einsum("ni,ni->n", n, at[:, :2])
    weight = np.full(line.size, 1.0 / (2.0 * ROUGH) ** 2)
    position = np.zeros(2)
    place = np.zeros((lines, 2))
    pairs = [(i, j) for i in (0, 1) for j in (0, 1)]
    for _ in range(5):
        a = np.stack([np.bincount(line, weight * n[:, i] * n[:, j], lines) for i, j in pairs], axis=1)
        b = np.stack([np.bincount(line, weight * n[:, i] * local[:, j], lines) for i, j in pairs], axis=1)
        v = np.stack([np.bincount(line, weight * n[:, i] * told, lines) for i in (0, 1)], axis=1)
        b = b.reshape(lines, 2, 2)
        by = np.linalg.solve(a.reshape(lines, 2, 2) + 0.01 * np.eye(2), np.concatenate([b, v[:, :, None]], axis=2))
        matrix = (weight[:, None] * local).T @ local - np.einsum("lij,lik->jk", b, by[:, :, :2])
        vector = -(weight * told) @ local + np.einsum("lij,li->j", b, by[:, :, 2])
        position = np.linalg.solve(matrix + np.eye(2) / max_rho**2, vector)
        place = by[:, :, 2] + by[:, :, :2] @ position
        sight = place[line] - at[:, :2]
        error = np.einsum("ni,ni->n", n, sight) - local @ position
        distance = np.clip(np.hypot(sight[:, 0], sight[:, 1]), 0.5, 20.0)
        weight = 1.0 / (ROUGH * distance) ** 2 / (1.0 + (error / distance / ROUGH) ** 2) ** 2
    x, y = (
        place[line].T - at[:, :2].T - np.array([c * position[0] - s * position[1], s * position[0] + c * position[1]])
    )
    off = wrap(np.arctan2(y, x) - g)
    scores = [float(np.minimum((e / ROUGH) ** 2, 9.0).sum()) for e in (off, wrap(off + np.pi))]
    return position, scores[0], scores[1]


def _between(pose: Array, keep: Index, solved_pose: Array) -> Array:
    """Dead-reckoned poses, corrected so that they pass through the solved ones; corrections interpolated."""
    turn = solved_pose[:, 2] - pose[keep, 2]
    every = np.arange(pose.shape[0])
    heading = np.interp(every, keep, turn)
    c, s = np.cos(turn), np.sin(turn)
    moved = solved_pose[:, :2] - np.stack(
        [c * pose[keep, 0] - s * pose[keep, 1], s * pose[keep, 0] + c * pose[keep, 1]], axis=1
    )
    shift = np.stack([np.interp(every, keep, moved[:, k]) for k in (0, 1)], axis=1)
    c, s = np.cos(heading), np.sin(heading)
    x = c * pose[:, 0] - s * pose[:, 1] + shift[:, 0]
    y = s * pose[:, 0] + c * pose[:, 1] + shift[:, 1]
    return np.stack([x, y, pose[:, 2] + heading], axis=1)
