"""Streams that no robot should send: a drive that is told well, mixed with everything that can be told badly."""

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import after, arc

Array = NDArray[np.float64]
SECOND = 1_000_000_000
STEP_NS = SECOND // 3
LINES = 8
MOUNT = np.array([0.6, 0.25, -0.4])  # phi, rho, psi
ENDS = (0, 1, -1, 2**53, -(2**53), 2**62, -(2**62), 2**63 - 1, -(2**63))


@dataclass(frozen=True, slots=True)
class Well:
    """So many frames of a robot that drives, or turns, among lines that stand."""

    frames: int
    turns: bool
    still: bool = False


@dataclass(frozen=True, slots=True)
class Odd:
    """One message that is wrong in the ways that are not None."""

    bearings: bool  # or ticks
    stamp: int | None  # ns beside the right one
    count: int | None  # in place of those counted
    beta: float | None  # rad, of every third line
    std: float | None  # rad, of every third line
    track: int | None  # of every third line
    lines: int  # that it holds


Part = Well | Odd

_numbers = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-320, 1e-12, 1e-6, 0.003, 3.0, 1e9, 1e300, -1e300])
_stamps = st.sampled_from([0, -1, 1, -SECOND, SECOND, -60 * SECOND, 60 * SECOND, 600 * SECOND, *ENDS])
_odd = st.builds(
    Odd,
    st.booleans(),
    st.none() | _stamps,
    st.none() | st.sampled_from(ENDS),
    st.none() | _numbers,
    st.none() | _numbers,
    st.none() | st.sampled_from(ENDS),
    st.sampled_from([0, 1, LINES, 3 * LINES]),
)
parts = st.lists(st.builds(Well, st.integers(1, 14), st.booleans(), st.booleans()) | _odd, min_size=1, max_size=10)


class Teller:
    """A robot that moves on with each part, and tells of it as the part says."""

    def __init__(self, config: Config, seed: int) -> None:
        self._base = config.robot.wheel_base_m
        self._scale = config.encoder.metres_per_tick
        self._rng = np.random.default_rng(seed)
        far, around = self._rng.uniform(1.3, 3.5, 3 * LINES), self._rng.uniform(-np.pi, np.pi, 3 * LINES)
        self._odd = np.random.default_rng(seed)  # a wrong message changes nothing of the right ones
        self._lines = np.stack([far * np.cos(around), far * np.sin(around)], axis=1)
        self._pose = np.zeros(3)
        self._rolled = np.zeros(2)  # right, left
        self._now_ns = SECOND

    def told(self, parts: list[Part]) -> list[Ticks | Bearings]:
        return [message for part in parts for message in self._part(part)]

    def _part(self, part: Part) -> list[Ticks | Bearings]:
        match part:
            case Well():
                out: list[Ticks | Bearings] = []
                for _ in range(part.frames):
                    self._move(part)
                    out += [self._ticks(), self._bearings(LINES, self._rng)]
                return out
            case Odd():
                return [self._wrong(part)]

    def _move(self, part: Well) -> None:
        way = np.array([0.0, 0.0] if part.still else [0.03, -0.03] if part.turns else [0.06, 0.06])
        self._pose = after(self._pose, arc(way[:1], way[1:], self._base)[0])
        self._rolled = self._rolled + way
        self._now_ns += STEP_NS

    def _ticks(self) -> Ticks:
        right, left = np.round(self._rolled / self._scale).astype(int).tolist()
        return Ticks(self._now_ns, left, right)

    def _bearings(self, count: int, rng: np.random.Generator) -> Bearings:
        x, y, heading = self._pose
        phi, rho, psi = MOUNT
        sight = self._lines[:count] - [x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi)]
        beta = wrap(np.arctan2(sight[:, 1], sight[:, 0]) - heading - phi - psi)
        return Bearings(
            self._now_ns,
            np.arange(count),
            wrap(beta + 0.003 * rng.standard_normal(count)),
            np.full(count, 0.003),
            np.zeros(count, dtype=np.int32),
            np.ones(count, dtype=np.float32),
        )

    def _wrong(self, part: Odd) -> Ticks | Bearings:
        if not part.bearings:
            right = self._ticks()
            count = part.count
            stamp = right.stamp_ns + (part.stamp or 0)
            return (
                right
                if count is None and part.stamp is None
                else replace(right, stamp_ns=stamp, left=right.left if count is None else count)
            )
        seen = self._bearings(part.lines, self._odd)
        track, beta, std = seen.track_id.copy(), seen.bearing_rad.copy(), seen.std_rad.copy()
        for values, given in ((track, part.track), (beta, part.beta), (std, part.std)):
            if given is not None:
                values[::3] = given
        return replace(seen, stamp_ns=seen.stamp_ns + (part.stamp or 0), track_id=track, bearing_rad=beta, std_rad=std)
