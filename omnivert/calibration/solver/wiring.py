"""Swapped wheels, a reversed sign, a mirrored picture: found by asking which of them explains the drive.

What cannot be told apart: both signs reversed is the same as a robot that calls its back its front, with phi half a
turn off. Swapped sides, a mirrored picture, and both signs reversed with either, are the same world in a mirror. So
there are three contradictions: a mirrored world, and one wheel or the other counting backwards.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from omnivert.calibration.solver.problem import Problem
from omnivert.calibration.solver.smoother import Solution
from omnivert.calibration.solver.start import started

BETTER = 100.0  # -2 log likelihood by which another wiring must win
MIRRORED = "camera.bearing_sign is wrong, or the wheels' sides are swapped, or both of their signs are reversed"
ONE_WHEEL = "encoder.{}_sign is wrong: the {} wheel counts backwards"


def suspicion(problem: Problem, solution: Solution, max_rho: float, clear: float, starts: int, lines: int) -> str:
    """What is wired wrongly, when that explains the drive and the configuration does not; else empty.

    clear  share of the bearings that a solution must explain
    """
    found: list[tuple[float, str]] = []
    for other, words in _wirings(problem):
        start = started(other, max_rho, starts, lines)
        if start is None or start.solution.inlier_share < max(clear, solution.inlier_share + 0.03):
            continue
        if start.solution.score < solution.score - BETTER and start.gap >= BETTER:
            found.append((start.solution.score, words))
    return min(found)[1] if found else ""


def _wirings(problem: Problem) -> Iterator[tuple[Problem, str]]:
    """The drive as it would be told, were one thing wired otherwise."""
    mirrored = replace(problem, beta=-problem.beta)
    backwards = replace(problem.wheels, right_m=-problem.wheels.right_m)
    nothing_known = replace(problem.prior, mean=np.zeros_like(problem.prior.mean))
    yield replace(mirrored, prior=nothing_known), MIRRORED
    yield replace(problem, wheels=backwards, prior=nothing_known), ONE_WHEEL.format("right", "right")
    yield replace(mirrored, wheels=backwards, prior=nothing_known), ONE_WHEEL.format("left", "left")
