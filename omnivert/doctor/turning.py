"""Do wheels and picture turn alike? Asked without any estimate of the mount, of a few seconds of motion.

Between two frames most bearings fall by the robot's turn, whatever the lines' distance: near lines are shifted by the
way, too, but those ahead and behind, left and right by opposite amounts. So the median over the lines, c = -median
(change of bearing), is the turn as the picture has it, and the wheels tell a = (right - left) / e and, were one of
them reversed, b = (right + left) / e. What is wired as configured has c = a; a mirrored world c = -a; a left wheel
that counts backwards c = b; a right one c = -b; each times a factor near 1, if base or counts are not as configured.
A straight way alone has c = 0 and tells the first two from the last; a turn tells all four apart.

What the wheels do not count, their slip and the floor, turns the robot by sqrt(K way) / e: of a few centimetres of way
more than the turn itself. So pairs are taken together to steps of a third of a second, whatever the camera's rate, and
a wiring may leave over what that noise explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.messages import Bearings

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LONGEST_S = 1.0  # between two frames whose lines are compared
STEP_S = 0.3  # pairs are taken together until they last so long
FEWEST_LINES = 5  # of fewer the median says little: near ones pull it along
FLOOR_RAD = 0.001  # no turn is seen better
FEWEST_PAIRS = 6
ENOUGH_RAD = np.deg2rad(20.0)  # of turn, or of what one reversed wheel makes of a straight way
EXPLAINS = 2.0  # times the lines' own spread and the wheels' noise is the most that a wiring may leave over
FACTOR = (0.2, 5.0)  # of the turn, by which base or counts may be off
CLEARER = 2.0  # a wiring that leaves over so many times more than the best is out
FASTEST_M_S = 20.0  # a wheel that goes faster has not driven: its counts began anew
LAGS_S = np.arange(-1.0, 1.0001, 0.02)


class Wiring(StrEnum):
    AS_CONFIGURED = "as configured"
    MIRRORED = "mirrored"
    LEFT_BACKWARDS = "left backwards"
    RIGHT_BACKWARDS = "right backwards"


EXPECTED = {  # c = x a + y b
    Wiring.AS_CONFIGURED: (1.0, 0.0),
    Wiring.MIRRORED: (-1.0, 0.0),
    Wiring.LEFT_BACKWARDS: (0.0, 1.0),
    Wiring.RIGHT_BACKWARDS: (0.0, -1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class WheelWay:
    """What the encoders tell, in metres of the configured wheels."""

    time_s: Array  # (S,)
    right_m: Array  # (S,) cumulative
    left_m: Array  # (S,)

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Right and left at these times."""
        return np.interp(time_s, self.time_s, self.right_m), np.interp(time_s, self.time_s, self.left_m)


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """The turn from frame to frame, as the picture shows it."""

    from_s: Array  # (P,)
    to_s: Array  # (P,)
    turn_rad: Array  # (P,) counter-clockwise, where bearing_sign is right
    spread_rad: Array  # (P,) of the lines about it: a way beside near lines makes it large

    @property
    def weight(self) -> Array:
        return np.asarray(1.0 / np.hypot(self.spread_rad, FLOOR_RAD))

    def between(self, from_s: float, to_s: float) -> float:
        """The whole turn of the pairs that lie within; rad."""
        return float(self.part((self.from_s >= from_s) & (self.to_s <= to_s)).turn_rad.sum())

    def part(self, kept: Flags) -> "Turns":
        return Turns(self.from_s[kept], self.to_s[kept], self.turn_rad[kept], self.spread_rad[kept])

    def steps(self) -> "Turns":
        """Pairs that follow each other taken together, to STEP_S and a little more each."""
        first = np.zeros(self.from_s.size, dtype=np.int64)  # the pair that each one's step begins with
        for k in range(1, first.size):
            begin = first[k - 1]
            goes_on = self.from_s[k] == self.to_s[k - 1] and self.to_s[k - 1] - self.from_s[begin] < STEP_S
            first[k] = begin if goes_on else k
        at = np.unique(first)
        if not at.size:
            return self
        last = np.append(at[1:], first.size) - 1
        turn, spread = np.add.reduceat(self.turn_rad, at), np.add.reduceat(self.spread_rad, at)
        return Turns(self.from_s[at], self.to_s[last], turn, spread)


@dataclass(frozen=True, slots=True, eq=False)
class Turning:
    """Wheels and picture compared.

    wirings    those that explain what was seen; () when none does
    wheels_rad sum of |turn|, where both tell it
    driven_m   sum of |way|, right and left wheel
    scale      turn of the picture per turn of the wheels as configured, and its sigma; None without a turn
    late_s     how late the frames' stamps are against the wheels', and its sigma; None where the motion does not tell
    """

    wirings: tuple[Wiring, ...]
    wheels_rad: float
    driven_m: tuple[float, float]
    scale: tuple[float, float] | None
    late_s: tuple[float, float] | None


def turns_seen(bearings: Sequence[Bearings]) -> Turns:
    """The median change of bearing between frames that share enough lines."""
    rows = [row for before, after in pairwise(bearings) if (row := _turn(before, after))]
    return Turns(*np.array(rows, dtype=np.float64).reshape(-1, 4).T)


def turning(turns: Turns, wheels: WheelWay, base_m: float, noise_k_m: float) -> Turning | None:
    """None without enough frames that the wheels cover.

    noise_k_m  variance of a wheel's way, per metre of it (K of eq. 31)
    """
    if wheels.time_s.size < 2:
        return None
    covered = (turns.from_s >= wheels.time_s[0]) & (turns.to_s <= wheels.time_s[-1])
    for way in wheels.at(np.array([turns.from_s, turns.to_s])):
        covered &= np.abs(way[1] - way[0]) <= FASTEST_M_S * (turns.to_s - turns.from_s)
    seen = turns.part(covered)
    if seen.turn_rad.size < FEWEST_PAIRS:
        return None
    late = _late(seen, wheels, base_m)
    seen = seen.steps()
    told = _told(seen, wheels, base_m, late[0] if late is not None else 0.0)
    wirings = _wirings(seen, told, noise_k_m / base_m)
    right, left = wheels.at(np.array([seen.from_s, seen.to_s]))
    return Turning(
        wirings=wirings,
        wheels_rad=float(np.abs(told[:, 0]).sum()),
        driven_m=(float(np.abs(right[1] - right[0]).sum()), float(np.abs(left[1] - left[0]).sum())),
        scale=_scale(seen, told) if wirings == (Wiring.AS_CONFIGURED,) else None,
        late_s=late,
    )


def _turn(before: Bearings, after: Bearings) -> tuple[float, float, float, float] | None:
    apart_s = 1e-9 * (after.stamp_ns - before.stamp_ns)
    _, i, j = np.intersect1d(before.track_id, after.track_id, return_indices=True)
    if not 0.0 < apart_s <= LONGEST_S or i.size < FEWEST_LINES:
        return None
    change = wrap(after.bearing_rad[j] - before.bearing_rad[i])
    middle = float(np.median(change))
    spread = float(np.median(np.abs(change - middle)))
    return 1e-9 * before.stamp_ns, 1e-9 * after.stamp_ns, -middle, spread


def _told(seen: Turns, wheels: WheelWay, base_m: float, late_s: float) -> Array:
    """a and b of each pair (P, 2), the pictures taken `late_s` before their stamps."""
    right, left = wheels.at(np.array([seen.from_s, seen.to_s]) - late_s)
    right, left = right[1] - right[0], left[1] - left[0]
    return np.stack([right - left, right + left], axis=-1) / base_m


def _left_over(turn: Array, told: Array) -> dict[Wiring, float]:
    """Root mean square of what each wiring, at its best factor, does not explain; rad."""
    rest = {}
    for wiring, slopes in EXPECTED.items():
        expected = told @ np.array(slopes)
        factor = np.clip(float(turn @ expected) / max(float(expected @ expected), 1e-12), *FACTOR)
        rest[wiring] = float(np.sqrt(np.mean((turn - factor * expected) ** 2)))
    return rest


def _wirings(seen: Turns, told: Array, noise_rad: float) -> tuple[Wiring, ...]:
    """noise_rad: variance of a turn, for each radian of the larger of a and b: both wheels' way over the base"""
    if max(float(np.abs(seen.turn_rad).sum()), float(np.abs(told).sum(axis=0).max())) < ENOUGH_RAD:
        return tuple(Wiring)
    left_over = _left_over(seen.turn_rad, told)
    variance = 1.0 / seen.weight**2 + noise_rad * np.abs(told).max(axis=1)
    most = min(CLEARER * min(left_over.values()), EXPLAINS * float(np.sqrt(np.mean(variance))))
    return tuple(wiring for wiring, rest in left_over.items() if rest <= most)


def _scale(seen: Turns, told: Array) -> tuple[float, float] | None:
    slope, rest = _slopes(seen, told)
    square = float(((seen.weight * told[:, 0]) ** 2).sum())
    return (float(slope[0]), float(np.sqrt(rest / square))) if square > 0.0 else None


def _slopes(seen: Turns, told: Array) -> tuple[Array, float]:
    """x and y of c = x a + y b by weighted least squares, and the variance that is left over."""
    turn, told = seen.weight * seen.turn_rad, seen.weight[:, None] * told
    slope, *_ = np.linalg.lstsq(told, turn, rcond=None)
    return np.asarray(slope, dtype=np.float64), float(((turn - told @ slope) ** 2).sum() / max(turn.size - 2, 1))


def _late(seen: Turns, wheels: WheelWay, base_m: float) -> tuple[float, float] | None:
    """The lag at which the wheels explain the picture best; None when all do about alike, or it lies at an end."""
    begins, ends = wheels.time_s[0] + LAGS_S[-1], wheels.time_s[-1] + LAGS_S[0]
    covered = (seen.from_s >= begins) & (seen.to_s <= ends)  # at every lag, so that all are asked the same
    part = seen.part(covered)
    count = part.turn_rad.size
    if count < FEWEST_PAIRS:
        return None
    score = np.empty(LAGS_S.size)  # -2 log likelihood, slopes and noise free
    for k, lag in enumerate(LAGS_S):
        _, rest = _slopes(part, _told(part, wheels, base_m, float(lag)))
        score[k] = count * np.log(rest + 1e-12)
    best = int(np.argmin(score))
    within = score - score[best] <= 1.0
    if best in (0, LAGS_S.size - 1) or within[0] or within[-1]:
        return None
    step = float(LAGS_S[1] - LAGS_S[0])
    return float(LAGS_S[within].mean()), max(0.5 * step * int(within.sum()), step)
