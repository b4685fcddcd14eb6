"""The keyframes of the present stretch of the drive, and the problem that they make."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.solver.noise import Noise
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.problem import Prior, Problem, dead_reckoned
from omnivert.calibration.solver.smoother import Solution
from omnivert.calibration.solver.triangulation import anchors, triangulated
from omnivert.config import Config
from omnivert.increments import Wheels
from omnivert.odometry import Samples

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

AS_TOLD = Noise()
STANDS = 0.5  # share of its sights that a line's place must explain
RUN = 5  # rejected sights in a row that are taken for another line


@dataclass(frozen=True, slots=True, eq=False)
class Keyed:
    """A keyframe as it comes."""

    stamp_s: float
    wheels: Samples | None  # since the one before; None where their way is unknown
    track: Index  # (N,)
    beta: Array  # (N,) rad
    std: Array  # (N,) rad


@dataclass(slots=True, eq=False)
class Keyframe:
    stamp_s: float
    wheels: Samples | None  # since the one before; None: the way is unknown
    line: Index  # (N,) names of lines: the track's number, or a negative one where a track changed its line
    track: Index  # (N,)
    beta: Array  # (N,) rad
    std: Array  # (N,) rad


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A stretch's problem with its names."""

    problem: Problem
    names: Index  # of lines, ascending


class Stretch:
    """Keyframes with their sights; knows the last solution, to start the next one from."""

    def __init__(self, config: Config) -> None:
        self.keyframes: list[Keyframe] = []
        self._config = config
        self._pose = np.zeros((0, 3))
        self._line: dict[int, tuple[Array, float, float]] = {}  # name -> anchor, u, w of the last solution
        self._renamed: dict[int, int] = {}  # track -> the line that it shows now
        self._names = 0
        self._moving: set[int] = set()  # lines that do not stand still
        self._left_behind: set[int] = set()  # tracks from before the last break that have not come again

    def append(self, stamp_s: float, wheels: Samples | None, track: Index, beta: Array, std: Array) -> None:
        """One more keyframe, and the wheels since the one before.

        Where their way is unknown, every line is another one from there on, the mount is the same: with no line in
        common, where the way goes on is a mere choice of coordinates, and it goes on where it broke off.
        """
        if wheels is None and self.keyframes:
            self._left_behind.update(t for k in self.keyframes for t in k.track.tolist())
        order = np.argsort(track, kind="stable")
        track = track[order]
        for again in self._left_behind.intersection(track.tolist()):
            self._left_behind.remove(again)
            self._renamed[again] = self._new_name()
        line = np.array([self._renamed.get(t, t) for t in track.tolist()], dtype=np.int64)
        self.keyframes.append(Keyframe(stamp_s, wheels, line, track, beta[order], std[order]))

    def posed(self, prior: Prior, most_lines: int, fewest_sights: int, noise: Noise = AS_TOLD) -> Posed:
        """The problem of all keyframes, with the lines that are seen often enough."""
        frames = self.keyframes
        name = np.concatenate([k.line for k in frames])
        frame = np.repeat(np.arange(len(frames)), [k.line.size for k in frames])
        names, number, count = np.unique(name, return_inverse=True, return_counts=True)
        often = np.flatnonzero((count >= fewest_sights) & ~np.isin(names, sorted(self._moving)))
        if often.size > most_lines:
            often = np.sort(often[np.argsort(-count[often], kind="stable")[:most_lines]])
        place = np.full(names.size, -1, dtype=np.int64)
        place[often] = np.arange(often.size)
        line = place[number]
        stays = line >= 0
        problem = Problem(
            np.array([k.stamp_s for k in frames]),
            np.array([k.wheels is None for k in frames[1:]], dtype=np.bool_),
            self._wheels(noise.wheels),
            frame[stays],
            line[stays],
            np.concatenate([k.beta for k in frames])[stays],
            np.sqrt(noise.bearings) * np.concatenate([k.std for k in frames])[stays],
            prior,
        )
        return Posed(problem, names[often])

    def guess(self, posed: Posed, shared: Array) -> Unknowns:
        """The last solution, led on to the newest keyframe; lines that it did not hold are triangulated."""
        problem = posed.problem
        pose = dead_reckoned(problem.increments(shared[3:]).step)
        known = min(self._pose.shape[0], problem.frames)
        if known:
            pose = _led_on(self._pose[:known], pose)
        anchor = anchors(problem, pose)
        u, w = np.zeros(posed.names.size), np.zeros(posed.names.size)
        missing = []
        for i, name in enumerate(posed.names.tolist()):
            if name in self._line:
                anchor[i], u[i], w[i] = self._line[name]
            else:
                missing.append(i)
        std = np.maximum(problem.std, 0.01)
        u, w = triangulated(problem, pose, shared[:3], std, anchor, u, w, np.array(missing, dtype=np.int64))
        return Unknowns(pose, shared.copy(), anchor, u, w)

    def remember(self, posed: Posed, solution: Solution, clear: bool) -> None:
        """Start from this next time; if it is clear, tracks that have changed their line get a new one from there."""
        x = solution.x
        self._pose = x.pose.copy()
        names = posed.names.tolist()
        self._line = {name: (x.anchor[i].copy(), float(x.u[i]), float(x.w[i])) for i, name in enumerate(names)}
        if not clear:
            return
        lost = solution.weight < 0.1
        moving = restless(posed.problem, solution)
        self._moving.update(names[i] for i in np.flatnonzero(moving).tolist())
        runs = np.bincount(posed.problem.line, lost, len(names)) >= RUN
        for i in np.flatnonzero(runs & ~moving).tolist():
            own = np.flatnonzero(posed.problem.line == i)
            run = _longest_run(lost[own])
            if run is not None:
                self._rename(names[i], posed.problem.frame[own[run[0]]], posed.problem.frame[own[run[1] - 1]])

    def drop_first(self, count: int) -> None:
        """Forget keyframes that were solved, not all; the next one becomes the first. Poses stay relative to it."""
        del self.keyframes[:count]
        tracks = {t for k in self.keyframes for t in k.track.tolist()}
        self._renamed = {track: line for track, line in self._renamed.items() if track in tracks}
        self._moving.intersection_update(n for k in self.keyframes for n in k.line.tolist())
        # What is neither seen in here nor remembered has no name that a track that comes again could take.
        self._left_behind.intersection_update(tracks.union(self._line))
        known = self._pose[count:]
        if not known.size:
            self._pose, self._line = np.zeros((0, 3)), {}
            return
        x, y, turn = known[0]
        c, s = np.cos(turn), np.sin(turn)
        back = np.array([[c, s], [-s, c]])
        self._pose = np.column_stack([(known[:, :2] - [x, y]) @ back.T, known[:, 2] - turn])
        self._line = {n: (back @ (a - [x, y]), u - turn, w) for n, (a, u, w) in self._line.items()}

    def _wheels(self, noise: float) -> Wheels:
        """What the encoders told since the first keyframe, without a jump where the way is unknown."""
        encoder = self._config.encoder
        parts = [k.wheels for k in self.keyframes[1:] if k.wheels is not None]
        if not parts:
            stamp = self.keyframes[0].stamp_s
            parts = [Samples(np.array([stamp, stamp + 1.0]), np.zeros(2), np.zeros(2))]
        time = np.concatenate([parts[0].time_s[:1], *(p.time_s[1:] for p in parts)])
        ways = []
        for side in ("right_m", "left_m"):
            steps = [np.diff(getattr(p, side)) for p in parts]
            ways.append(np.concatenate([[0.0], np.cumsum(np.concatenate(steps))]))
        return Wheels(
            time, ways[0], ways[1], self._config.robot.wheel_base_m, noise * encoder.noise_k_m, encoder.metres_per_tick
        )

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


def restless(problem: Problem, solution: Solution) -> Flags:
    """Lines (L,) of which one place explains less than half: what they are, they do not stand still."""
    lines = solution.x.u.size
    count = np.bincount(problem.line, minlength=lines)
    explained = np.bincount(problem.line, solution.weight, lines)
    return np.asarray((explained < STANDS * count) & (count >= 2 * RUN))


def _led_on(known: Array, reckoned: Array) -> Array:
    """Known poses (K, 3), and behind the last of them the dead-reckoned way (F, 3) goes on."""
    turn = known[-1, 2] - reckoned[known.shape[0] - 1, 2]
    c, s = np.cos(turn), np.sin(turn)
    rest = reckoned[known.shape[0] :, :2] - reckoned[known.shape[0] - 1, :2]
    tail = np.column_stack([rest @ np.array([[c, s], [-s, c]]) + known[-1, :2], reckoned[known.shape[0] :, 2] + turn])
    return np.concatenate([known, tail])


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
