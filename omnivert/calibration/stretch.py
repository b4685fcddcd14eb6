"""The keyframes of the present stretch of the drive, and the problem that they make."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.normal import Unknowns
from omnivert.calibration.problem import Problem
from omnivert.calibration.smoother import Solution
from omnivert.calibration.triangulation import anchors, triangulated
from omnivert.odometry import Motion, after

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RUN = 5  # rejected sights in a row that are taken for another line


@dataclass(slots=True, eq=False)
class Keyframe:
    motion: Motion  # since the one before; of the first: unused
    line: Index  # (N,) names of lines: the track's number, or a negative one where a track changed its line
    track: Index  # (N,)
    beta: Array  # (N,) rad
    std: Array  # (N,) rad


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A stretch's problem with its names."""

    problem: Problem
    names: tuple[int, ...]  # of lines, ascending


class Stretch:
    """Keyframes with their sights; knows the last solution, to start the next one from."""

    def __init__(self) -> None:
        self.keyframes: list[Keyframe] = []
        self._pose = np.zeros((0, 3))
        self._line: dict[int, tuple[Array, float, float]] = {}  # name -> anchor, u, w of the last solution
        self._renamed: dict[int, int] = {}  # track -> the line that it shows now
        self._names = 0
        self._left_behind: set[int] = set()  # tracks from before the last break that have not come again

    def cut_chain(self) -> None:
        """The way to the next keyframe is unknown: every line is another one from there on, the mount is the same.

        With no line in common, where the way goes on is a mere choice of coordinates: it goes on where it broke off.
        """
        self._left_behind.update(t for k in self.keyframes for t in k.track.tolist())

    def append(self, motion: Motion, track: Index, beta: Array, std: Array) -> None:
        order = np.argsort(track, kind="stable")
        track = track[order]
        for again in self._left_behind.intersection(track.tolist()):
            self._left_behind.remove(again)
            self._renamed[again] = self._new_name()
        line = np.array([self._renamed.get(t, t) for t in track.tolist()], dtype=np.int64)
        self.keyframes.append(Keyframe(motion, line, track, beta[order], std[order]))

    def posed(self, prior_mean: Array, prior_information: Array, most_lines: int, fewest_sights: int) -> Posed:
        """The problem of all keyframes, with the lines that are seen often enough."""
        count: dict[int, int] = {}
        for k in self.keyframes:
            for name in k.line.tolist():
                count[name] = count.get(name, 0) + 1
        often = sorted((-n, name) for name, n in count.items() if n >= fewest_sights)[:most_lines]
        names = tuple(sorted(name for _, name in often))
        number = {name: i for i, name in enumerate(names)}
        frame, line, beta, std = [], [], [], []
        for f, k in enumerate(self.keyframes):
            for name, b, s in zip(k.line.tolist(), k.beta.tolist(), k.std.tolist(), strict=True):
                if name in number:
                    frame.append(f)
                    line.append(number[name])
                    beta.append(b)
                    std.append(s)
        motions = [k.motion for k in self.keyframes[1:]]
        problem = Problem(
            np.array([m.pose for m in motions]).reshape(-1, 3),
            np.array([m.covariance for m in motions]).reshape(-1, 3, 3),
            np.array([m.wheels_m for m in motions]).reshape(-1, 2),
            np.array(frame, dtype=np.int64),
            np.array(line, dtype=np.int64),
            np.array(beta),
            np.array(std),
            prior_mean,
            prior_information,
        )
        return Posed(problem, names)

    def guess(self, posed: Posed, mount: Array) -> Unknowns:
        """The last solution, led on to the newest keyframe; lines that it did not hold are triangulated."""
        problem = posed.problem
        pose = np.zeros((problem.frames, 3))
        known = min(self._pose.shape[0], problem.frames)
        pose[:known] = self._pose[:known]
        for i in range(max(known, 1), problem.frames):
            pose[i] = after(pose[i - 1], problem.step[i - 1])
        anchor = anchors(problem, pose)
        u, w = np.zeros(len(posed.names)), np.zeros(len(posed.names))
        missing = []
        for i, name in enumerate(posed.names):
            if name in self._line:
                anchor[i], u[i], w[i] = self._line[name]
            else:
                missing.append(i)
        std = np.maximum(problem.std, 0.01)
        u, w = triangulated(problem, pose, mount, std, anchor, u, w, np.array(missing, dtype=np.int64))
        return Unknowns(pose, mount.copy(), anchor, u, w)

    def remember(self, posed: Posed, solution: Solution) -> None:
        """Start from this next time; and tracks that have changed their line get a new one from there on."""
        x = solution.x
        self._pose = x.pose.copy()
        self._line = {name: (x.anchor[i].copy(), float(x.u[i]), float(x.w[i])) for i, name in enumerate(posed.names)}
        for i, name in enumerate(posed.names):
            own = np.flatnonzero(posed.problem.line == i)
            run = _longest_run(solution.weight[own] < 0.1)
            if run is not None:
                self._rename(name, posed.problem.frame[own[run[0]]], posed.problem.frame[own[run[1] - 1]])

    def drop_first(self, count: int) -> None:
        """Forget keyframes that were solved, not all; the next one becomes the first. Poses stay relative to it."""
        del self.keyframes[:count]
        known = self._pose[count:]
        x, y, turn = known[0]
        c, s = np.cos(turn), np.sin(turn)
        back = np.array([[c, s], [-s, c]])
        self._pose = np.column_stack([(known[:, :2] - [x, y]) @ back.T, known[:, 2] - turn])
        self._line = {n: (back @ (a - [x, y]), u - turn, w) for n, (a, u, w) in self._line.items()}

    def _new_name(self) -> int:
        self._names -= 1
        return self._names

    def _rename(self, name: int, first: int, last: int) -> None:
        fresh = self._new_name()
        newest = -1
        for f, k in enumerate(self.keyframes):
            here = k.line == name
            if not here.any():
                continue
            if first <= f <= last:
                k.line[here] = fresh
            newest = f
        if newest == last:  # the track goes on with the other line
            track = int(self.keyframes[newest].track[self.keyframes[newest].line == fresh][0])
            self._renamed[track] = fresh


def _longest_run(flags: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and behind-last of the longest run of True of at least RUN, if it is not all."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    if not edges.size:
        return None
    begin, end = edges[::2], edges[1::2]
    k = int(np.argmax(end - begin))
    if end[k] - begin[k] < RUN or end[k] - begin[k] == flags.size:
        return None
    return int(begin[k]), int(end[k])
