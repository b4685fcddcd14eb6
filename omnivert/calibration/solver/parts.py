"""A part of a drive, asked alone what the whole was asked."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import covariance_from_information
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.problem import GLOBALS, Prior, Problem, with_frames
from omnivert.calibration.solver.smoother import Search, Solution

Array = NDArray[np.float64]

PULL = 0.05  # share of the whole's information that keeps a part in its valley


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
