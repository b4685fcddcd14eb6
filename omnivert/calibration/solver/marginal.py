"""From the most probable point to the mean of what matters: the mount, with all ways and lines that might have been.

Paper: silent. Here: the joint optimum is corrected, because it is biased. Every step of the wheels is an unknown, and
where bearings know the ratio of step and distance better than the wheels know the step, the optimum shortens all
distances, and rho with them, by the square of a step's relative error (regression dilution): 0.4 sigma at K = 2e-4 m
and steps of 5 cm. Integrated over ways and lines (Laplace), the likelihood of the mount has a factor |H|^(-1/2), H
their information given the mount; its slope moves the optimum by covariance times slope.
"""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.solver import skyline
from omnivert.calibration.solver.normal import Unknowns, normal, stepped
from omnivert.calibration.solver.problem import GLOBALS
from omnivert.calibration.solver.smoother import Search, Solution

Array = NDArray[np.float64]

REACH = 0.5  # sigmas to either side over which the slope is taken
MOST = 1.0  # sigmas that a correction moves at most: beyond, the expansion is none


def marginal_mean(search: Search, solution: Solution) -> Unknowns:
    """The solution's unknowns, moved to the mean of mount and corrections; ways and lines follow.

    raises  ArithmeticError when the equations at the solution are not positive definite
    """
    layout, free = solution.normal.layout, np.flatnonzero(search.problem.prior.free)
    begin = layout.shared
    first, start = layout.first[:begin], layout.start[: begin + 1]
    factor = solution.factor
    # How ways and lines follow what is shared.
    follow = np.zeros((begin + GLOBALS, GLOBALS))
    for k in free.tolist():
        row = int(layout.start[begin + k])
        follow[:begin, k] = -skyline.solved(first, start, factor, solution.normal.values[row : row + begin])
        follow[begin + k, k] = 1.0
    covariance = np.linalg.inv(solution.shared_information[np.ix_(free, free)])
    scale = np.sqrt(np.diag(covariance))
    value, vector = np.linalg.eigh(covariance / np.outer(scale, scale))
    total = np.zeros(begin + GLOBALS)
    for k in range(free.size):
        sigma = float(np.sqrt(max(value[k], 0.0)))
        axis = follow[:, free] @ (scale * vector[:, k])
        ahead, back = (_log_determinant(search, solution, s * REACH * sigma * axis) for s in (1.0, -1.0))
        if np.isfinite(ahead) and np.isfinite(back):
            shift = float(np.clip(-0.25 * (ahead - back) / REACH, -MOST, MOST))
            total += shift * sigma * axis
    return stepped(solution.x, layout, total)


def _log_determinant(search: Search, solution: Solution, step: Array) -> float:
    """Of the information on ways and lines, given what is shared; not a number where there is none."""
    problem = search.problem
    layout = solution.normal.layout
    x = stepped(solution.x, layout, step)
    moved = problem.increments(x.corrections)
    weight = solution.weight / problem.std**2
    n = normal(problem, layout, x, np.zeros(weight.size), weight, moved, search.information, 0.0)
    if not skyline.factored(layout.first, layout.start, n.values):
        return float("nan")
    own = float(2.0 * np.log(n.values[layout.start[1 : layout.shared + 1] - 1]).sum())
    return own + float(np.log(x.w**2 + solution.inverse_distance_std() ** 2).sum())
