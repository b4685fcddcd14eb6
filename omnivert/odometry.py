"""Wheel counts -> the robot's motion between two stamps, with its covariance (eqs. 14, 15, 31)."""

from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Encoder
from omnivert.increments import Wheels, increments
from omnivert.messages import Ticks

Array = NDArray[np.float64]
SECOND = 1_000_000_000
_WHOLE = np.array([False])  # one increment, not broken


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """How the robot moved between two stamps, seen from where it was at the first."""

    pose: Array  # (3,) m, m, rad: x forward, y left, heading
    covariance: Array  # (3, 3) of pose, by the wheels' noise
    wheels_m: Array  # (2,) right, left, as the encoders tell
    driven_m: float  # way of the origin, forward or backward
    turned_rad: float  # sum of |heading change|


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What the encoders told between two stamps; both ends are the stamps themselves."""

    time_s: Array  # (S,)
    right_m: Array  # (S,) cumulative
    left_m: Array  # (S,)

    @property
    def moved_m(self) -> tuple[float, float]:
        """Way of the right and of the left wheel."""
        return float(self.right_m[-1] - self.right_m[0]), float(self.left_m[-1] - self.left_m[0])

    def __add__(self, later: "Samples") -> "Samples":
        """Both, one after the other; of a stand only its ends are kept."""
        time = np.concatenate([self.time_s, later.time_s[1:]])
        right = np.concatenate([self.right_m, later.right_m[1:] + (self.right_m[-1] - later.right_m[0])])
        left = np.concatenate([self.left_m, later.left_m[1:] + (self.left_m[-1] - later.left_m[0])])
        turns = (np.diff(right) != 0.0) | (np.diff(left) != 0.0)
        kept = np.concatenate([[True], turns[:-1] | turns[1:], [True]])
        return Samples(time[kept], right[kept], left[kept])


def nothing() -> Motion:
    return Motion(np.zeros(3), np.zeros((3, 3)), np.zeros(2), 0.0, 0.0)


def arc(right: Array, left: Array, base: float) -> Array:
    """Pose after one arc (eqs. 14, 15).

    right, left  (N,)  m    wheel displacements
    base               m    distance between the wheels, e
    returns      (N, 3)     x, y, heading; m, m, rad

    Paper: the chord is as long as the arc. Here: the chord of the arc, because it costs nothing.
    """
    turn = (right - left) / base
    way = 0.5 * (right + left) * np.sinc(turn / (2.0 * np.pi))
    return np.stack([way * np.cos(0.5 * turn), way * np.sin(0.5 * turn), turn], axis=-1)


def after(pose: Array, step: Array) -> Array:
    """The pose reached from `pose` by `step`, which is seen from `pose`; (..., 3) each."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack(
        [
            pose[..., 0] + c * step[..., 0] - s * step[..., 1],
            pose[..., 1] + s * step[..., 0] + c * step[..., 1],
            pose[..., 2] + step[..., 2],
        ],
        axis=-1,
    )


class Odometer:
    """Takes the counts as they come and tells the motion between stamps.

    A count that no wheel could have reached is refused. When the next one goes on from where the refused one was, the
    device has been restarted: the chain is broken, and no motion is told across the break. The same holds across a
    silence in which the wheels turned.
    """

    def __init__(self, encoder: Encoder, wheel_base_m: float) -> None:
        self.refused: Counter[str] = Counter()
        self._encoder = encoder
        self._base = wheel_base_m
        self._chain = 0  # grows with every break
        self._known: deque[tuple[int, int, float, float]] = deque()  # stamp, chain, right, left
        self._suspect: Ticks | None = None

    @property
    def newest_ns(self) -> int | None:
        return self._known[-1][0] if self._known else None

    def push(self, ticks: Ticks) -> None:
        if not self._known:
            self._append(ticks)
            return
        if ticks.stamp_ns <= self._known[-1][0]:
            self.refused["ticks: stamp not after the one before"] += 1
            return
        if self._reachable(ticks, *self._known[-1][::2], self._known[-1][3]):
            self._suspect = None
        else:
            suspect = self._suspect
            scale = self._encoder.metres_per_tick
            if suspect is None or not self._reachable(
                ticks, suspect.stamp_ns, suspect.right * scale, suspect.left * scale
            ):
                self.refused["ticks: a jump that no wheel can make"] += 1
                self._suspect = ticks
                return
            self._suspect = None
            self._chain += 1
            self._append(suspect)
        stamp, _, right, left = self._known[-1]
        scale = self._encoder.metres_per_tick
        moved = max(abs(ticks.right * scale - right), abs(ticks.left * scale - left))
        if ticks.stamp_ns - stamp > self._encoder.max_gap_s * SECOND and moved > 0.01:
            self.refused["ticks: silent while the wheels turned"] += 1
            self._chain += 1
        self._append(ticks)

    def samples(self, first_ns: int, last_ns: int) -> Samples | None:
        """From one stamp to a later one; None where the counts do not reach, or where the chain is broken."""
        known = self._known
        if not known or first_ns < known[0][0] or last_ns > known[-1][0]:
            return None
        stamps = np.array([k[0] for k in known], dtype=np.int64)
        i = int(np.searchsorted(stamps, first_ns, side="right")) - 1
        j = int(np.searchsorted(stamps, last_ns, side="left"))
        part = [known[k] for k in range(i, j + 1)]
        if part[0][1] != part[-1][1]:
            return None
        at = stamps[i : j + 1]
        inside = np.array([first_ns, *at[(at > first_ns) & (at < last_ns)].tolist(), last_ns], dtype=np.int64)
        since = (at - first_ns) / SECOND
        right = np.interp((inside - first_ns) / SECOND, since, [k[2] for k in part])
        left = np.interp((inside - first_ns) / SECOND, since, [k[3] for k in part])
        return Samples(inside / SECOND, right, left)

    def motion(self, samples: Samples, wheel_ratio: float = 1.0, base: float = 1.0, noise: float = 1.0) -> Motion:
        """The motion that these samples tell; true ratio of the wheels, base and K in units of those configured."""
        encoder = self._encoder
        wheels = Wheels(
            samples.time_s,
            samples.right_m,
            samples.left_m,
            self._base,
            noise * encoder.noise_k_m,
            encoder.metres_per_tick,
        )
        ends = samples.time_s[[0, -1]]
        moved = increments(wheels, ends, _WHOLE, np.array([0.0, wheel_ratio - 1.0, base - 1.0]))
        right, left = np.diff(samples.right_m), np.diff(samples.left_m)
        return Motion(
            moved.step[0],
            moved.covariance[0],
            moved.wheels_m[0],
            float(np.abs(right + left).sum()) / 2.0,
            float(np.abs(right - left).sum()) / self._base,
        )

    def forget_before(self, stamp_ns: int) -> None:
        """Counts that no motion from `stamp_ns` on needs."""
        while len(self._known) > 1 and self._known[1][0] <= stamp_ns:
            self._known.popleft()

    def _append(self, ticks: Ticks) -> None:
        scale = self._encoder.metres_per_tick
        self._known.append((ticks.stamp_ns, self._chain, ticks.right * scale, ticks.left * scale))

    def _reachable(self, ticks: Ticks, stamp_ns: int, right: float, left: float) -> bool:
        scale = self._encoder.metres_per_tick
        reach = self._encoder.max_speed_m_s * (ticks.stamp_ns - stamp_ns) / SECOND + 2.0 * scale
        return max(abs(ticks.right * scale - right), abs(ticks.left * scale - left)) <= reach
