"""Where lines known from before should be now: the turn common to all, and the flow that driving gives each of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.compiled import compiled
from omnivert.vision.cholesky import factored, solved
from omnivert.vision.turns import cell_of, short_way

Float = NDArray[np.float64]
Int = NDArray[np.int64]

DESCRIPTOR_STD = 0.3  # of two views of one line; those of the corridor differ by 0.34 (median), two lines' by 1.0 (1 %)
_TURN_CELLS = 720
_TURN_EVIDENCE = 0.15  # of one sure pair, after smoothing
_TURN_WIDTH_RAD = np.deg2rad(2.0)
_FLOW_STD = np.array((np.deg2rad(2.0), 0.7, np.deg2rad(2.0), np.deg2rad(2.0)))  # prior of its four numbers
_LEAST_SPREAD_RAD = np.deg2rad(0.1)
_FIRST_SPREAD_RAD = np.deg2rad(2.0)
_FLOW_PAIRS = 6


class Flow(NamedTuple):
    """How lines move in a frame, image angle: turn + scale x own drift + cos_part cos angle + sin_part sin angle."""

    turn: float
    scale: float
    cos_part: float
    sin_part: float
    spread: float  # what lines do beyond it, rad

    def of(self, angle: Float, drift: Float) -> Float:
        """The flow without the turn, rad."""
        return self.scale * drift + self.cos_part * np.cos(angle) + self.sin_part * np.sin(angle)


def common_flow(turn: float, angle: Float, drift: Float, moved: Float) -> Flow:
    """The flow that explains how the lines of some pairs have moved, robustly.

    turn    rad   that is known already
    angle   (P,)  before
    drift   (P,)  the lines' own motion a frame, as it was so far
    moved   (P,)  from before to now

    Driving shows a line at distance D and bearing b from the way ahead turned by (way / D) sin b: on the whole a sine
    of the angle. When the robot speeds up, stops or turns in, all drifts change at once, by one factor and one sine.
    """
    if moved.size < _FLOW_PAIRS:
        return Flow(turn, 1.0, 0.0, 0.0, _LEAST_SPREAD_RAD)
    table = np.empty((4, angle.size))
    table[0], table[1], table[2], table[3] = 1.0, drift, np.cos(angle), np.sin(angle)
    x, spread = _robust(table, wrap(moved - turn - drift), _FLOW_STD, _LEAST_SPREAD_RAD, 6)
    more, scale, cos_part, sin_part = x.tolist()
    return Flow(wrap(turn + more), 1.0 + scale, cos_part, sin_part, float(spread))


def sine_of(angle: Float, drift: Float) -> tuple[float, float]:
    """The cos and the sin part of the drifts of many lines, robustly: what a new line there is likely to do."""
    if angle.size < _FLOW_PAIRS:
        return 0.0, 0.0
    table = np.empty((2, angle.size))
    table[0], table[1] = np.cos(angle), np.sin(angle)
    x, _ = _robust(table, drift, _FLOW_STD[2:], _LEAST_SPREAD_RAD, 4)
    return float(x[0]), float(x[1])


@compiled
def _robust(table: Float, value: Float, prior_std: Float, least_spread: float, steps: int) -> tuple[Float, float]:
    """Robust least squares of value (P,) on the rows of table (K, P); the solution (K,) and the spread about it."""
    rows, pairs = table.shape
    x: Float = np.zeros(rows)
    spread, off = _FIRST_SPREAD_RAD, value.copy()
    for _ in range(steps):
        normal, right = np.zeros((rows, rows)), np.zeros(rows)
        for i in range(rows):
            normal[i, i] = (spread / prior_std[i]) ** 2
        for k in range(pairs):
            weight = max(1.0 - (off[k] / (3.0 * spread)) ** 2, 0.0) ** 2
            for i in range(rows):
                right[i] += weight * table[i, k] * value[k]
                for j in range(rows):
                    normal[i, j] += weight * table[i, k] * table[j, k]
        x = solved(factored(normal), right)
        for k in range(pairs):
            off[k] = value[k]
            for i in range(rows):
                off[k] -= x[i] * table[i, k]
        spread = max(1.4826 * _middle(np.abs(off)), least_spread)
    return x, spread


@compiled
def _middle(values: Float) -> float:
    """The upper median, by counting: of a hundred values that is quick, and no sort has to be compiled."""
    for value in values:
        below = same = 0
        for other in values:
            below += other < value
            same += other == value
        if below <= values.size // 2 < below + same:
            return float(value)
    return np.nan


def common_turn(angle: Float, predicted: Float, D: Float, polarity: Int, track_polarity: Int) -> float | None:
    """How far all lines have turned together: where the differences of look-alike pairs pile up, rad; None: unclear.

    angle, polarity            (N,)    of the lines
    predicted, track_polarity  (T,)    rad, where their tracks would be without the turn
    D                          (N, T)  distances of their descriptors
    """
    delta, weight = _look_alikes(angle, predicted, D, polarity, track_polarity)
    turn = _piled_up(delta, weight)
    return None if np.isnan(turn) else turn


@compiled
def _piled_up(delta: Float, weight: Float) -> float:
    """The angle about which most weight lies; NaN when that is too little."""
    pile, smooth = np.zeros(_TURN_CELLS), np.zeros(_TURN_CELLS)
    for k in range(delta.size):
        pile[cell_of(delta[k], _TURN_CELLS)] += weight[k]
    for _ in range(3):
        for k in range(_TURN_CELLS):
            smooth[k] = 0.5 * pile[k] + 0.25 * (pile[k - 1] + pile[(k + 1) % _TURN_CELLS])
        pile, smooth = smooth, pile
    peak = np.argmax(pile)
    if pile[peak] < _TURN_EVIDENCE:
        return np.nan
    turn = float((peak + 0.5) / _TURN_CELLS * TURN - np.pi)
    for _ in range(2):
        total = moved = 0.0
        for k in range(delta.size):
            off = short_way(delta[k] - turn)
            near = weight[k] * max(1.0 - (off / _TURN_WIDTH_RAD) ** 2, 0.0)
            total, moved = total + near, moved + near * off
        if total > 0.0:
            turn = short_way(turn + moved / total)
    return turn


@compiled
def _look_alikes(angle: Float, predicted: Float, D: Float, polarity: Int, track_polarity: Int) -> tuple[Float, Float]:
    """Differences and weights of the pairs that may be one line."""
    delta, weight = np.empty(D.size), np.empty(D.size)
    count = 0
    for i in range(D.shape[0]):
        for j in range(D.shape[1]):
            if polarity[i] == track_polarity[j] and D[i, j] < 3.0 * DESCRIPTOR_STD:
                delta[count] = short_way(angle[i] - predicted[j])
                weight[count] = np.exp(-0.5 * (D[i, j] / DESCRIPTOR_STD) ** 2)
                count += 1
    return delta[:count], weight[:count]
