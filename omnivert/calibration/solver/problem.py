"""A stretch of the drive as plain arrays: what start and smoother solve."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.increments import Increments, Wheels, increments

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

GLOBALS = 6  # eta, cx, cy; time offset, wheel ratio - 1, base / configured - 1


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known of the unknowns that all keyframes share, before them; a held one stays at its mean."""

    mean: Array  # (6,)
    information: Array  # (6, 6)
    free: Flags  # (6,)
    held: Array  # (3,) the corrections where they are held


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Keyframes 0..F-1, lines 0..L-1, M bearings; ordered by frame, then by line; a pair occurs at most once."""

    stamp_s: Array  # (F,)
    broken: Flags  # (F-1,) the way to the next keyframe is unknown
    wheels: Wheels
    frame: Index  # (M,)
    line: Index  # (M,)
    beta: Array  # (M,) rad
    std: Array  # (M,) rad
    prior: Prior

    @property
    def frames(self) -> int:
        return int(self.stamp_s.size)

    @property
    def lines(self) -> int:
        return int(self.line.max()) + 1 if self.line.size else 0

    @property
    def held(self) -> Array:
        """Corrections (3,) to begin with."""
        return self.prior.held

    def increments(self, corrections: Array) -> Increments:
        return increments(self.wheels, self.stamp_s, self.broken, corrections)


@compiled
def dead_reckoned(step: Array) -> Array:
    """Poses (F, 3) from increments (F-1, 3), the first at the origin."""
    pose = np.zeros((step.shape[0] + 1, 3))
    for i in range(step.shape[0]):
        c, s = np.cos(pose[i, 2]), np.sin(pose[i, 2])
        pose[i + 1, 0] = pose[i, 0] + c * step[i, 0] - s * step[i, 1]
        pose[i + 1, 1] = pose[i, 1] + s * step[i, 0] + c * step[i, 1]
        pose[i + 1, 2] = pose[i, 2] + step[i, 2]
    return pose


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
    """Keyframes first..last-1 alone; and the lines that it still holds, those seen three times or more, (L',)."""
    stays = (problem.frame >= first) & (problem.frame < last)
    count = np.bincount(problem.line[stays], minlength=problem.lines)
    lines = np.flatnonzero(count >= 3)
    part = replace(
        problem,
        stamp_s=problem.stamp_s[first:last],
        broken=problem.broken[first : last - 1],
        frame=problem.frame[stays] - first,
        line=problem.line[stays],
        beta=problem.beta[stays],
        std=problem.std[stays],
    )
    part_lines = part.lines
    return with_lines(part, lines[lines < part_lines]), lines
