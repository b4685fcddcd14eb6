"""Normal equations of the whole stretch: poses, mount and lines against bearings and increments.

Unknowns: poses 1..F-1 (x, y, heading in the frame of pose 0), mount (eta, cx, cy) with eta = phi + psi and c the
camera's place on the robot, and per line the direction u from an anchor beside the way and its inverse distance w. So
a line at infinity is as good as any other (w = 0), and the mount has no singular place (rho = 0).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.problem import Problem

Array = NDArray[np.float64]

W_STD = 3.0  # 1/m: nothing is known of a line's distance, but that it is not centimetres


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    pose: Array  # (F, 3)
    mount: Array  # (3,) eta, cx, cy
    anchor: Array  # (L, 2) m, fixed
    u: Array  # (L,) rad
    w: Array  # (L,) 1/m


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Predicted sights and their slopes."""

    error: Array  # (M,) measured - predicted bearing
    by_pose: Array  # (M, 3)
    by_mount: Array  # (M, 3)
    by_line: Array  # (M, 2) u, w


def sights(problem: Problem, x: Unknowns) -> Sights:
    """Bearing errors and slopes of the predicted bearings (eq. 16 in world coordinates)."""
    pose, line = x.pose[problem.frame], problem.line
    eta, cx, cy = x.mount
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    lever = np.stack([c * cx - s * cy, s * cx + c * cy], axis=1)  # robot origin -> camera, world
    back = x.anchor[line] - pose[:, :2] - lever  # camera -> anchor
    u, w = x.u[line], x.w[line]
    sight = np.stack([np.cos(u) + w * back[:, 0], np.sin(u) + w * back[:, 1]], axis=1)
    length2 = np.maximum(sight[:, 0] ** 2 + sight[:, 1] ** 2, 1e-6)
    across = np.stack([-sight[:, 1], sight[:, 0]], axis=1) / length2[:, None]
    error = wrap(problem.beta - np.arctan2(sight[:, 1], sight[:, 0]) + pose[:, 2] + eta)
    by_pose = np.stack(
        [-w * across[:, 0], -w * across[:, 1], w * (across[:, 0] * lever[:, 1] - across[:, 1] * lever[:, 0]) - 1.0],
        axis=1,
    )
    by_mount = np.stack(
        [
            np.full(line.size, -1.0),
            -w * (across[:, 0] * c + across[:, 1] * s),
            -w * (-across[:, 0] * s + across[:, 1] * c),
        ],
        axis=1,
    )
    by_line = np.stack(
        [across[:, 1] * np.cos(u) - across[:, 0] * np.sin(u), across[:, 0] * back[:, 0] + across[:, 1] * back[:, 1]],
        axis=1,
    )
    return Sights(error, by_pose, by_mount, by_line)


def step_errors(problem: Problem, pose: Array) -> tuple[Array, Array, Array]:
    """Increments: predicted - told (F-1, 3), slopes by the pose before and after (F-1, 3, 3) each."""
    c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
    d = pose[1:, :2] - pose[:-1, :2]
    x, y = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    turn = pose[1:, 2] - pose[:-1, 2]
    error = np.stack([x, y, turn], axis=1) - problem.step
    before = np.zeros((c.size, 3, 3))
    before[:, 0, 0], before[:, 0, 1], before[:, 0, 2] = -c, -s, y
    before[:, 1, 0], before[:, 1, 1], before[:, 1, 2] = s, -c, -x
    before[:, 2, 2] = -1.0
    behind = np.zeros((c.size, 3, 3))
    behind[:, 0, 0], behind[:, 0, 1] = c, s
    behind[:, 1, 0], behind[:, 1, 1] = -s, c
    behind[:, 2, 2] = 1.0
    return error, before, behind


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Reduced to poses 0..F-1 and mount; P = 3 F + 3."""

    matrix: Array  # (P, P) lines eliminated
    vector: Array  # (P,)
    coupling: Array  # (P, L, 2)
    line_matrix: Array  # (L, 2, 2)
    line_vector: Array  # (L, 2)
    line_inverse: Array  # (L, 2, 2)


def normal(problem: Problem, x: Unknowns, seen: Sights, weight: Array, information: Array, damping: float) -> Normal:
    """Gauss-Newton's equations; the step is their solution.

    weight       (M,)         1/rad^2 of each bearing
    information  (F-1, 3, 3)  of each increment
    damping      share by which the diagonal is raised
    """
    frames, lines, line = problem.frames, x.u.size, problem.line
    size = 3 * frames + 3
    raised = 1.0 + damping
    d00, d01, d11 = (
        np.bincount(line, weight * seen.by_line[:, i] * seen.by_line[:, j], lines) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    line_matrix: Array = np.empty((lines, 2, 2))
    line_matrix[:, 0, 0] = d00 * raised + 1e-6
    line_matrix[:, 1, 1] = d11 * raised + 1.0 / W_STD**2
    line_matrix[:, 0, 1] = line_matrix[:, 1, 0] = d01
    line_vector: Array = np.stack(
        [np.bincount(line, weight * seen.by_line[:, i] * seen.error, lines) for i in (0, 1)], axis=1
    )
    line_vector[:, 1] -= x.w / W_STD**2

    matrix: Array = np.zeros((size, size))
    vector = np.zeros(size)
    coupling = np.zeros((size, lines, 2))
    blocks = matrix[: 3 * frames, : 3 * frames].reshape(frames, 3, frames, 3)
    every = np.arange(frames)
    for i in range(3):
        weighted = weight * seen.by_pose[:, i]
        vector[i : 3 * frames : 3] = np.bincount(problem.frame, weighted * seen.error, frames)
        for j in range(3):
            blocks[every, i, every, j] = np.bincount(problem.frame, weighted * seen.by_pose[:, j], frames)
            shared = np.bincount(problem.frame, weighted * seen.by_mount[:, j], frames)
            matrix[i : 3 * frames : 3, 3 * frames + j] = shared
            matrix[3 * frames + j, i : 3 * frames : 3] = shared
        for j in range(2):
            coupling[3 * problem.frame + i, line, j] = weighted * seen.by_line[:, j]
            coupling[3 * frames + i, :, j] = np.bincount(line, weight * seen.by_mount[:, i] * seen.by_line[:, j], lines)
    by_mount = weight[:, None] * seen.by_mount
    matrix[3 * frames :, 3 * frames :] = by_mount.T @ seen.by_mount + problem.prior_information
    vector[3 * frames :] = by_mount.T @ seen.error + problem.prior_information @ _mount_gap(problem.prior_mean, x.mount)

    error, before, behind = step_errors(problem, x.pose)
    heavy_before = np.einsum("nki,nkl->nil", before, information)
    heavy_behind = np.einsum("nki,nkl->nil", behind, information)
    first, last = every[:-1], every[1:]
    blocks[first, :, first, :] += heavy_before @ before
    blocks[last, :, last, :] += heavy_behind @ behind
    cross = heavy_before @ behind
    blocks[first, :, last, :] += cross
    blocks[last, :, first, :] += cross.transpose(0, 2, 1)
    flat = vector[: 3 * frames].reshape(frames, 3)
    flat[:-1] -= np.einsum("nij,nj->ni", heavy_before, error)
    flat[1:] -= np.einsum("nij,nj->ni", heavy_behind, error)
    matrix[np.arange(size), np.arange(size)] *= raised

    determinant = line_matrix[:, 0, 0] * line_matrix[:, 1, 1] - line_matrix[:, 0, 1] ** 2
    inverse: Array = np.empty((lines, 2, 2))
    inverse[:, 0, 0] = line_matrix[:, 1, 1] / determinant
    inverse[:, 1, 1] = line_matrix[:, 0, 0] / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -line_matrix[:, 0, 1] / determinant
    # inverse = R R^T, so the lines' share of the matrix is a product with its own transpose.
    root = np.zeros_like(inverse)
    root[:, 0, 0] = np.sqrt(inverse[:, 0, 0])
    root[:, 1, 0] = inverse[:, 1, 0] / root[:, 0, 0]
    root[:, 1, 1] = np.sqrt(np.maximum(inverse[:, 1, 1] - root[:, 1, 0] ** 2, 0.0))
    half = np.empty_like(coupling)
    half[:, :, 0] = coupling[:, :, 0] * root[:, 0, 0] + coupling[:, :, 1] * root[:, 1, 0]
    half[:, :, 1] = coupling[:, :, 1] * root[:, 1, 1]
    flat_half = half.reshape(size, 2 * lines)
    matrix -= flat_half @ flat_half.T
    solved = np.einsum("lij,lj->li", inverse, line_vector)
    vector -= np.einsum("pli,li->p", coupling, solved)
    return Normal(matrix, vector, coupling, line_matrix, line_vector, inverse)


def cost(problem: Problem, x: Unknowns, information: Array) -> float:
    """-2 log of the priors and increments; the bearings' share depends on their loss."""
    error, _, _ = step_errors(problem, x.pose)
    gap = _mount_gap(problem.prior_mean, x.mount)
    return float(
        np.einsum("ni,nij,nj->", error, information, error)
        + gap @ problem.prior_information @ gap
        + np.sum((x.w / W_STD) ** 2)
    )


def _mount_gap(mean: Array, mount: Array) -> Array:
    gap = mean - mount
    gap[0] = wrap(float(gap[0]))
    return gap
