"""Where each unknown of a stretch stands in its equations, so that these stay thin."""

from dataclasses import dataclass

import numpy as np

from omnivert.calibration.solver.problem import GLOBALS, Index, Problem
from omnivert.calibration.solver.skyline import starts


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where the unknowns stand: each pose, then the lines that it is the last to see; at the end what is shared."""

    pose: Index  # (F,) its first row; -1 for pose 0, which is fixed
    line: Index  # (L,)
    shared: int
    first: Index  # (N,) column of each row's first entry
    start: Index  # (N + 1,) where each row begins

    @classmethod
    def of(cls, problem: Problem) -> "Layout":
        frames, lines = problem.frames, problem.lines
        earliest = np.full(lines, frames, dtype=np.int64)
        np.minimum.at(earliest, problem.line, np.maximum(problem.frame, 1))
        latest = np.zeros(lines, dtype=np.int64)
        np.maximum.at(latest, problem.line, problem.frame)
        latest = np.maximum(latest, 1)
        behind = np.argsort(latest, kind="stable")  # lines in their order
        before = np.searchsorted(latest[behind], np.arange(frames))  # lines that were gone before each pose
        pose = 3 * (np.arange(frames) - 1) + 2 * before
        pose[0] = -1
        line = np.empty(lines, dtype=np.int64)
        line[behind] = 3 * latest[behind] + 2 * np.arange(lines)
        shared = 3 * (frames - 1) + 2 * lines
        first = np.zeros(shared + GLOBALS, dtype=np.int64)
        if frames > 1:
            of_pose = np.maximum(pose[np.maximum(np.arange(1, frames) - 1, 1)], 0)
            for k in range(3):
                first[pose[1:] + k] = of_pose
            for k in range(2):
                first[line + k] = pose[np.minimum(earliest, frames - 1)]
        return cls(pose, line, shared, first, starts(first))
