"""A stretch of the drive as plain arrays: what start and smoother solve."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnivert.odometry import after

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FLOOR = np.diag([2e-5**2, 2e-5**2, 5e-5**2])  # m, m, rad: keeps an increment's information finite


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Keyframes 0..F-1, lines 0..L-1, M bearings; ordered by frame, then by line; a pair occurs at most once."""

    step: Array  # (F-1, 3) m, m, rad: motion from keyframe to keyframe, in the earlier one's frame
    step_covariance: Array  # (F-1, 3, 3)
    wheels_m: Array  # (F-1, 2) right, left
    frame: Index  # (M,)
    line: Index  # (M,)
    beta: Array  # (M,) rad
    std: Array  # (M,) rad
    prior_mean: Array  # (3,) eta, cx, cy
    prior_information: Array  # (3, 3)

    @property
    def frames(self) -> int:
        return int(self.step.shape[0]) + 1

    @property
    def lines(self) -> int:
        return int(self.line.max()) + 1 if self.line.size else 0

    def step_information(self) -> Array:
        """(F-1, 3, 3)"""
        return np.asarray(np.linalg.inv(self.step_covariance + FLOOR), dtype=np.float64)


def dead_reckoned(step: Array) -> Array:
    """Poses (F, 3) from increments (F-1, 3), the first at the origin."""
    pose = np.zeros((step.shape[0] + 1, 3))
    for i in range(step.shape[0]):
        pose[i + 1] = after(pose[i], step[i])
    return pose


def thinned(problem: Problem, most: int) -> tuple[Problem, Index]:
    """At most `most` of the keyframes, evenly; increments between them joined. Also the keyframes that stay, (F',)."""
    keep = np.unique(np.linspace(0, problem.frames - 1, min(most, problem.frames)).round().astype(np.int64))
    if keep.size == problem.frames:
        return problem, keep
    step = np.zeros((keep.size - 1, 3))
    covariance = np.zeros((keep.size - 1, 3, 3))
    wheels = np.zeros((keep.size - 1, 2))
    for n, (first, last) in enumerate(zip(keep[:-1].tolist(), keep[1:].tolist(), strict=True)):
        for i in range(first, last):
            c, s = np.cos(step[n, 2]), np.sin(step[n, 2])
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            moved = turn @ problem.step[i]
            carried = np.eye(3)
            carried[:2, 2] = -moved[1], moved[0]
            covariance[n] = carried @ covariance[n] @ carried.T + turn @ problem.step_covariance[i] @ turn.T
            step[n] += moved
        wheels[n] = problem.wheels_m[first:last].sum(axis=0)
    place = np.full(problem.frames, -1, dtype=np.int64)
    place[keep] = np.arange(keep.size)
    stays = place[problem.frame] >= 0
    return (
        Problem(
            step,
            covariance,
            wheels,
            place[problem.frame[stays]],
            problem.line[stays],
            problem.beta[stays],
            problem.std[stays],
            problem.prior_mean,
            problem.prior_information,
        ),
        keep,
    )


def with_lines(problem: Problem, lines: Index) -> Problem:
    """Only the bearings of some lines; these become 0..N-1 in the order given."""
    number = np.full(problem.lines, -1, dtype=np.int64)
    number[lines] = np.arange(lines.size)
    stays = number[problem.line] >= 0
    return replace(
        problem,
        frame=problem.frame[stays],
        line=number[problem.line[stays]],
        beta=problem.beta[stays],
        std=problem.std[stays],
    )


def with_frames(problem: Problem, first: int, last: int) -> tuple[Problem, Index]:
    """Keyframes first..last-1 alone, without prior; and the lines that it still holds, (L',)."""
    stays = (problem.frame >= first) & (problem.frame < last)
    count = np.bincount(problem.line[stays], minlength=problem.lines)
    lines = np.flatnonzero(count >= 3)
    part = replace(
        problem,
        step=problem.step[first : last - 1],
        step_covariance=problem.step_covariance[first : last - 1],
        wheels_m=problem.wheels_m[first : last - 1],
        frame=problem.frame[stays] - first,
        line=problem.line[stays],
        beta=problem.beta[stays],
        std=problem.std[stays],
        prior_information=np.zeros((3, 3)),
    )
    part_lines = part.lines
    return with_lines(part, lines[lines < part_lines]), lines
