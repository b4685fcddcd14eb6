"""How late the camera's stamps are, and the wheel base, from how bearings turn while the robot does.

Between two sights a far line's bearing turns against the robot, wherever the camera sits. So the wheels' turn, shifted
in time and scaled, must be that of the bearings; what near lines turn more or less is noise here, of either sign. That
asks for neither mount nor lines nor dead reckoning over more than a second, and leads the start out of the valleys
that wrong corrections open.
"""

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.solver.problem import Problem

Array = NDArray[np.float64]

APART_S = 1.0  # between two sights of a line, at most
NEAR = 2.0  # m, where a line may be: passing it by turns its bearing by way / NEAR
LATEST = 0.3  # s
STEP = 0.02  # s
ROUNDS = 10
ODD = 3.0  # sigmas from which a sight counts little
SURE = 25.0  # of robust chi-square by which the corrections found must beat those held
WORTH = np.array([0.05, 1.0, 0.04])  # s, 1, 1: nearer ones the start finds by itself, and near lines can feign them


def turning(problem: Problem, open_time: bool, open_base: bool) -> Array | None:
    """Corrections (3,) that the turning of the bearings asks for; None where it agrees with those held.

    open_time, open_base  which of them may be others than those held
    """
    line_first = np.lexsort((problem.frame, problem.line))
    frame, line = problem.frame[line_first], problem.line[line_first]
    again = (line[1:] == line[:-1]) & (problem.stamp_s[frame[1:]] - problem.stamp_s[frame[:-1]] < APART_S)
    first, second = line_first[:-1][again], line_first[1:][again]
    if first.size < 3:
        return None
    turned = wrap(problem.beta[second] - problem.beta[first])
    read = problem.std[first] ** 2 + problem.std[second] ** 2
    unbroken = np.concatenate([[0], np.cumsum(problem.broken)])
    a, b = problem.frame[first], problem.frame[second]
    known = unbroken[a] == unbroken[b]
    a, b, turned, read = a[known], b[known], turned[known], read[known]

    def fitted(late: float, free: bool) -> tuple[float, float]:
        """Robust chi-square with the stamps so late, and the base."""
        moved = problem.increments(np.array([late, *problem.held[1:]]))
        ways = np.column_stack([moved.step[:, 2], np.hypot(moved.step[:, 0], moved.step[:, 1])])
        since = np.concatenate(
            [np.zeros((1, 3)), np.cumsum(np.column_stack([ways, moved.covariance[:, 2, 2]]), axis=0)]
        )
        turn, way, noise = (since[b] - since[a]).T
        variance = read + (way / NEAR) ** 2 + noise
        share = 1.0
        for _ in range(ROUNDS if free else 0):
            weight = 1.0 / variance / (1.0 + (turned + share * turn) ** 2 / variance / ODD**2) ** 2
            share = float(-np.sum(weight * turn * turned) / max(float(np.sum(weight * turn**2)), 1e-12))
        off = (turned + share * turn) ** 2 / variance
        base = (1.0 + problem.held[2]) / min(max(share, 0.77), 1.4)
        return float(np.sum(ODD**2 * np.log1p(off / ODD**2))), base - 1.0

    times = np.arange(-LATEST, LATEST + 0.5 * STEP, STEP) if open_time else problem.held[:1]
    found = [(*fitted(late, open_base), late) for late in times.tolist()]
    best, base, late = min(found)
    corrections = np.array([late, problem.held[1], base])
    near = bool((np.abs(corrections - problem.held) < WORTH).all())
    if near or fitted(float(problem.held[0]), False)[0] - best < SURE:
        return None
    return corrections
