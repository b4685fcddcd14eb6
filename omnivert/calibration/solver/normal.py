"""Normal equations of the whole stretch: poses, mount, corrections and lines against bearings and increments.

Unknowns: poses 1..F-1 (x, y, heading in the frame of pose 0); per line the direction u from an anchor beside the way
and its inverse distance w; and what all keyframes share: mount (eta, cx, cy) with eta = phi + psi and c the camera's
place on the robot, then the corrections (time offset, wheel ratio, base). So a line at infinity is as good as any
other (w = 0), and the mount has no singular place (rho = 0).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.solver.layout import Layout
from omnivert.calibration.solver.problem import GLOBALS, Index, Problem
from omnivert.compiled import compiled
from omnivert.increments import Increments

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

W_STD = 3.0  # 1/m: nothing is known of a line's distance, but that it is not centimetres
FLOOR = np.diag([2e-5**2, 2e-5**2, 5e-5**2])  # m, m, rad: keeps an increment's information finite


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    pose: Array  # (F, 3)
    shared: Array  # (6,) eta, cx, cy; time offset, wheel ratio - 1, base / configured - 1
    anchor: Array  # (L, 2) m, fixed
    u: Array  # (L,) rad
    w: Array  # (L,) 1/m

    @property
    def mount(self) -> Array:
        """(3,) eta, cx, cy"""
        return self.shared[:3]

    @property
    def corrections(self) -> Array:
        """(3,) time offset, wheel ratio - 1, base / configured - 1"""
        return self.shared[3:]


def stepped(x: Unknowns, layout: Layout, step: Array) -> Unknowns:
    """x moved by a step (N,) of all unknowns, in the order of their equations."""
    pose = x.pose.copy()
    pose[1:] += step[layout.pose[1:, None] + np.arange(3)]
    shared = x.shared + step[layout.shared :]
    return Unknowns(pose, shared, x.anchor, x.u + step[layout.line], x.w + step[layout.line + 1])


def increment_information(covariance: Array) -> Array:
    """(F-1, 3, 3) of covariances (F-1, 3, 3)."""
    return np.asarray(np.linalg.inv(covariance + FLOOR), dtype=np.float64)


@compiled
def bearing_errors(
    frame: Index, line: Index, beta: Array, pose: Array, mount: Array, anchor: Array, u: Array, w: Array
) -> Array:
    """Measured - predicted bearings (M,), the latter by eq. 16 in world coordinates; rad, [-pi, pi]."""
    error = np.empty(beta.size)
    eta, cx, cy = mount[0], mount[1], mount[2]
    for m in range(beta.size):
        f, k = frame[m], line[m]
        c, s = np.cos(pose[f, 2]), np.sin(pose[f, 2])
        x = np.cos(u[k]) + w[k] * (anchor[k, 0] - pose[f, 0] - c * cx + s * cy)
        y = np.sin(u[k]) + w[k] * (anchor[k, 1] - pose[f, 1] - s * cx - c * cy)
        off = beta[m] + pose[f, 2] + eta
        # The angle between the sight and the measured direction, so that no turn has to be taken off.
        a, b = np.cos(off), np.sin(off)
        error[m] = np.arctan2(b * x - a * y, a * x + b * y)
    return error


@compiled
def step_errors(pose: Array, step: Array) -> Array:
    """Increments of the poses - those told, (F-1, 3)."""
    error = np.empty(step.shape)
    for k in range(step.shape[0]):
        c, s = np.cos(pose[k, 2]), np.sin(pose[k, 2])
        x, y = pose[k + 1, 0] - pose[k, 0], pose[k + 1, 1] - pose[k, 1]
        error[k, 0] = c * x + s * y - step[k, 0]
        error[k, 1] = -s * x + c * y - step[k, 1]
        error[k, 2] = pose[k + 1, 2] - pose[k, 2] - step[k, 2]
    return error


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Gauss-Newton's equations: matrix in its spans, right side."""

    layout: Layout
    values: Array
    vector: Array  # (N,)


def normal(
    problem: Problem,
    layout: Layout,
    x: Unknowns,
    error: Array,
    weight: Array,
    moved: Increments,
    information: Array,
    damping: float,
) -> Normal:
    """Gauss-Newton's equations at x; the step is their solution.

    error        (M,)         of the bearings
    weight       (M,)         1/rad^2 of each bearing
    moved                     increments at x's corrections
    information  (F-1, 3, 3)  of each increment
    damping      share by which the diagonal is raised
    """
    prior = problem.prior
    values, vector = np.zeros(int(layout.start[-1])), np.zeros(layout.shared + GLOBALS)
    _add_bearings(
        layout.pose,
        layout.line,
        layout.shared,
        layout.first,
        layout.start,
        problem.frame,
        problem.line,
        x.pose,
        x.shared,
        x.anchor,
        x.u,
        x.w,
        error,
        weight,
        values,
        vector,
    )
    _add_steps(
        layout.pose,
        layout.shared,
        layout.first,
        layout.start,
        x.pose,
        step_errors(x.pose, moved.step),
        moved.slope,
        information,
        prior.free,
        values,
        vector,
    )
    gap = prior_gap(problem, x)
    _add_priors(
        layout.line,
        layout.shared,
        layout.start,
        x.w,
        prior.information,
        prior.information @ gap,
        prior.free,
        1.0 + damping,
        values,
        vector,
    )
    return Normal(layout, values, vector)


def prior_gap(problem: Problem, x: Unknowns) -> Array:
    """Prior - x of what is shared, (6,)."""
    gap = problem.prior.mean - x.shared
    gap[0] = wrap(float(gap[0]))
    return gap


def cost(problem: Problem, x: Unknowns, moved: Increments, information: Array) -> float:
    """-2 log of the priors and increments; the bearings' share depends on their loss."""
    error = step_errors(x.pose, moved.step)
    gap = prior_gap(problem, x)
    return float(
        np.einsum("ni,nij,nj->", error, information, error)
        + gap @ problem.prior.information @ gap
        + np.sum((x.w / W_STD) ** 2)
    )


@compiled
def bearing_slope(
    pose: Array,
    shared: Array,
    anchor: Array,
    u: float,
    w: float,
    at_pose: int,
    at_line: int,
    at_shared: int,
    row: Index,
    slope: Array,
) -> None:
    """Slope (8,) of a predicted bearing by pose, line (u, w) and mount, and the rows (8,) that these stand in."""
    cx, cy = shared[1], shared[2]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    lever_x, lever_y = c * cx - s * cy, s * cx + c * cy
    back_x, back_y = anchor[0] - pose[0] - lever_x, anchor[1] - pose[1] - lever_y
    cos_u, sin_u = np.cos(u), np.sin(u)
    x, y = cos_u + w * back_x, sin_u + w * back_y
    square = max(x * x + y * y, 1e-6)
    across_x, across_y = -y / square, x / square
    slope[0], slope[1] = -w * across_x, -w * across_y
    slope[2] = w * (across_x * lever_y - across_y * lever_x) - 1.0
    slope[3] = across_y * cos_u - across_x * sin_u
    slope[4] = across_x * back_x + across_y * back_y
    slope[5] = -1.0
    slope[6] = -w * (across_x * c + across_y * s)
    slope[7] = -w * (-across_x * s + across_y * c)
    for i in range(3):
        row[i], row[5 + i] = at_pose + i, at_shared + i
    row[3], row[4] = at_line, at_line + 1


@compiled
def step_slope(
    before: Array,
    behind: Array,
    by_corrections: Array,
    free: Flags,
    at_before: int,
    at_behind: int,
    at_shared: int,
    row: Index,
    slope: Array,
) -> None:
    """Slope (3, 9) of an increment's error by both poses and corrections, and the rows (9,) that these stand in."""
    c, s = np.cos(before[2]), np.sin(before[2])
    x, y = behind[0] - before[0], behind[1] - before[1]
    slope[:] = 0.0
    slope[0, 0], slope[0, 1], slope[0, 2] = -c, -s, -s * x + c * y
    slope[1, 0], slope[1, 1], slope[1, 2] = s, -c, -c * x - s * y
    slope[2, 2], slope[2, 5] = -1.0, 1.0
    slope[0, 3], slope[0, 4], slope[1, 3], slope[1, 4] = c, s, -s, c
    for i in range(3):
        row[i], row[3 + i], row[6 + i] = at_before + i, at_behind + i, at_shared + 3 + i
        for k in range(3):
            slope[k, 6 + i] = -by_corrections[k, i] if free[3 + i] else 0.0


@compiled
def _add_bearings(
    at_pose: Index,
    at_line: Index,
    at_shared: int,
    first: Index,
    start: Index,
    frame: Index,
    line: Index,
    pose: Array,
    shared: Array,
    anchor: Array,
    u: Array,
    w: Array,
    error: Array,
    weight: Array,
    values: Array,
    vector: Array,
) -> None:
    row = np.empty(8, dtype=np.int64)
    slope = np.empty(8)
    for m in range(error.size):
        if weight[m] <= 0.0:
            continue
        f, k = frame[m], line[m]
        bearing_slope(pose[f], shared, anchor[k], u[k], w[k], at_pose[f], at_line[k], at_shared, row, slope)
        for i in range(0 if f else 3, 8):
            heavy = weight[m] * slope[i]
            vector[row[i]] += heavy * error[m]
            base = start[row[i]] - first[row[i]]
            for j in range(0 if f else 3, i + 1):
                values[base + row[j]] += heavy * slope[j]


@compiled
def _add_steps(
    at_pose: Index,
    at_shared: int,
    first: Index,
    start: Index,
    pose: Array,
    error: Array,
    by_corrections: Array,
    information: Array,
    free: Flags,
    values: Array,
    vector: Array,
) -> None:
    row = np.empty(9, dtype=np.int64)
    slope = np.empty((3, 9))
    heavy = np.empty((3, 9))
    for n in range(error.shape[0]):
        step_slope(pose[n], pose[n + 1], by_corrections[n], free, at_pose[n], at_pose[n + 1], at_shared, row, slope)
        for k in range(3):
            for i in range(9):
                heavy[k, i] = (
                    information[n, k, 0] * slope[0, i]
                    + information[n, k, 1] * slope[1, i]
                    + information[n, k, 2] * slope[2, i]
                )
        for i in range(0 if n else 3, 9):
            vector[row[i]] -= heavy[0, i] * error[n, 0] + heavy[1, i] * error[n, 1] + heavy[2, i] * error[n, 2]
            base = start[row[i]] - first[row[i]]
            for j in range(0 if n else 3, i + 1):
                values[base + row[j]] += (
                    slope[0, i] * heavy[0, j] + slope[1, i] * heavy[1, j] + slope[2, i] * heavy[2, j]
                )


@compiled
def _add_priors(
    at_line: Index,
    at_shared: int,
    start: Index,
    w: Array,
    information: Array,
    pull: Array,
    free: Flags,
    raised: float,
    values: Array,
    vector: Array,
) -> None:
    """Priors of lines and of what is shared; the diagonal raised by the damping; what is held, held."""
    for k in range(at_line.size):
        values[start[at_line[k] + 1] - 1] += 1e-6
        values[start[at_line[k] + 2] - 1] += 1.0 / W_STD**2
        vector[at_line[k] + 1] -= w[k] / W_STD**2
    for i in range(6):
        row = at_shared + i
        if free[i]:
            vector[row] += pull[i]
            for j in range(i + 1):
                if free[j]:
                    values[start[row] + at_shared + j] += information[i, j]
    for row in range(start.size - 1):
        values[start[row + 1] - 1] *= raised
    for i in range(6):
        if not free[i]:
            row = at_shared + i
            values[start[row] : start[row + 1]] = 0.0
            values[start[row + 1] - 1] = 1.0
            vector[row] = 0.0
            for k in range(i + 1, 6):
                values[start[at_shared + k] + row] = 0.0
