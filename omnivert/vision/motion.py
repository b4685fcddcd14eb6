"""Where lines known from before should be now: the turn common to all, and the flow that driving gives each of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap

Float = NDArray[np.float64]

DESCRIPTOR_STD = (
    0.3  # of two views of one line; those of the corridor differ by 0.34 (median), of two lines by 1.0 (1 %)
)
_TURN_CELLS = 720
_TURN_EVIDENCE = 0.15  # of one sure pair, after smoothing
_TURN_WIDTH_RAD = np.deg2rad(2.0)
_FLOW_STD = np.array((np.deg2rad(2.0), 0.7, np.deg2rad(2.0), np.deg2rad(2.0)))  # prior of its four numbers
_LEAST_SPREAD_RAD = np.deg2rad(0.1)
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
    table = np.stack((np.ones_like(angle), drift, np.cos(angle), np.sin(angle)))
    rest = wrap(moved - turn - drift)
    x, spread = np.zeros(4), np.deg2rad(2.0)
    for _ in range(6):
        off = rest - x @ table
        weight = np.maximum(1.0 - (off / (3.0 * spread)) ** 2, 0.0) ** 2
        normal = (table * weight) @ table.T + np.diag(spread**2 / _FLOW_STD**2)
        x = np.linalg.solve(normal, table @ (weight * rest))
        spread = max(1.4826 * float(np.median(np.abs(rest - x @ table))), _LEAST_SPREAD_RAD)
    return Flow(wrap(turn + float(x[0])), 1.0 + float(x[1]), float(x[2]), float(x[3]), spread)


def sine_of(angle: Float, drift: Float) -> tuple[float, float]:
    """The cos and the sin part of the drifts of many lines, robustly: what a new line there is likely to do."""
    if angle.size < _FLOW_PAIRS:
        return 0.0, 0.0
    table = np.stack((np.cos(angle), np.sin(angle)))
    x, spread = np.zeros(2), np.deg2rad(2.0)
    for _ in range(4):
        weight = np.maximum(1.0 - ((drift - x @ table) / (3.0 * spread)) ** 2, 0.0) ** 2
        normal = (table * weight) @ table.T + np.eye(2) * (spread / np.deg2rad(2.0)) ** 2
        x = np.linalg.solve(normal, table @ (weight * drift))
        spread = max(1.4826 * float(np.median(np.abs(drift - x @ table))), _LEAST_SPREAD_RAD)
    return float(x[0]), float(x[1])


def common_turn(ahead: Float, D: Float, same_side: NDArray[np.bool_]) -> float | None:
    """How far all lines have turned together: where the differences of look-alike pairs pile up, rad; None: unclear.

    ahead      (N, T)  rad  bearing of line i less that of track j
    D          (N, T)       distance of their descriptors
    same_side  (N, T)       whether their polarities agree
    """
    weight = np.exp(-0.5 * (D / DESCRIPTOR_STD) ** 2) * same_side
    pair = weight > 0.01
    delta, weight = ahead[pair], weight[pair]
    cell = ((delta / TURN + 0.5) * _TURN_CELLS).astype(np.intp) % _TURN_CELLS
    pile = np.bincount(cell, weights=weight, minlength=_TURN_CELLS)
    for _ in range(3):
        pile = 0.5 * pile + 0.25 * (np.roll(pile, 1) + np.roll(pile, -1))
    peak = int(np.argmax(pile))
    if pile[peak] < _TURN_EVIDENCE:
        return None
    turn = (peak + 0.5) / _TURN_CELLS * TURN - np.pi
    for _ in range(2):
        off = wrap(delta - turn)
        near = weight * np.maximum(1.0 - (off / _TURN_WIDTH_RAD) ** 2, 0.0)
        if np.sum(near) > 0.0:
            turn = wrap(turn + float(np.sum(near * off) / np.sum(near)))
    return turn
