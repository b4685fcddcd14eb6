"""What the drive would have shown without the wheels' noise.

At one fixed centre of rotation (a turn on the spot, one circle) the bearings stay the same when camera and lines are
scaled and turned about that centre. A solution slides along this valley, and the jitter of the wheels then looks like
excitation. So the information is also taken on the nominal way: the simplest one that the wheels cannot be told from,
made of pieces with one centre of rotation each. The larger sigma counts.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import Piece, pieces
from omnivert.calibration.solver.normal import Unknowns, bearing_errors, increment_information, normal
from omnivert.calibration.solver.problem import GLOBALS, Problem, dead_reckoned
from omnivert.calibration.solver.smoother import Solution
from omnivert.calibration.solver.triangulation import sights_by_line
from omnivert.increments import Increments
from omnivert.odometry import arc

Array = NDArray[np.float64]

CAUTION = 1.0  # sigmas of a line's inverse distance that do not count, beside what chance gives the best of all lines


def nominal_steps(problem: Problem, moved: Increments, corrections: Array) -> tuple[Array, list[Piece]]:
    """Increments (F-1, 3) of the nominal way, and its pieces."""
    wheels = problem.wheels
    found = pieces(moved.wheels_m, wheels.base_m, wheels.noise_k_m, wheels.tick_m)
    told = np.empty_like(moved.wheels_m)
    at = 0
    for piece in found:
        part = moved.wheels_m[at : at + piece.steps]
        direction = np.array([piece.right_m, piece.left_m])
        length = float(np.hypot(*direction))
        direction = direction / length if length > 0.0 else np.zeros(2)
        told[at : at + piece.steps] = (part @ direction)[:, None] * direction
        at += piece.steps
    share = 0.5 * corrections[1]
    base = wheels.base_m * (1.0 + corrections[2])
    return arc(told[:, 0] * (1.0 + share), told[:, 1] * (1.0 - share), base), found


def nominal_information(problem: Problem, solution: Solution) -> tuple[Array, list[Piece]]:
    """Information (6, 6) on what is shared, nothing held, had the robot driven the nominal way among the same lines.

    Also the pieces of that way. The problem's prior is not in it.
    """
    x = solution.x
    moved = problem.increments(x.corrections)
    step, found = nominal_steps(problem, moved, x.corrections)
    pose = dead_reckoned(step)
    order, bounds = sights_by_line(problem, x.u.size)
    middle = problem.frame[order[np.minimum((bounds[:-1] + bounds[1:]) // 2, order.size - 1)]]
    old, new = x.pose[middle], pose[middle]
    turn = new[:, 2] - old[:, 2]
    # A far line's distance is fitted to noise, and would then seem to show parallax, which goes by its square: w^2 is
    # on average too large by its variance, and more than that is taken off:
    # of L lines one is fitted sqrt(2 log L) sigmas too near.
    caution = CAUTION + np.sqrt(2.0 * np.log(max(x.w.size, 2)))
    w = np.sqrt(np.maximum(x.w**2 - (caution * solution.inverse_distance_std()) ** 2, 0.0))
    sight = np.stack([np.cos(x.u), np.sin(x.u)], axis=1) + w[:, None] * (x.anchor - old[:, :2])
    c, s = np.cos(turn), np.sin(turn)
    length = np.hypot(sight[:, 0], sight[:, 1])
    direction = np.arctan2(s * sight[:, 0] + c * sight[:, 1], c * sight[:, 0] - s * sight[:, 1])
    anchored = Unknowns(pose, x.shared, new[:, :2].copy(), direction, w / length)
    open_prior = replace(problem.prior, information=np.zeros((GLOBALS, GLOBALS)), free=np.ones(GLOBALS, dtype=np.bool_))
    opened = replace(problem, prior=open_prior)
    p = problem
    error = bearing_errors(p.frame, p.line, p.beta, pose, x.mount, anchored.anchor, direction, anchored.w)
    told = replace(moved, step=step)
    n = normal(
        opened,
        solution.normal.layout,
        anchored,
        error,
        solution.weight / problem.std**2,
        told,
        increment_information(moved.covariance),
        0.0,
    )
    for row in range(n.layout.shared, n.layout.shared + GLOBALS):  # may not be seen at all
        n.values[n.layout.start[row + 1] - 1] += 1e-6
    return Solution(anchored, solution.weight, solution.score, n).shared_information, found
