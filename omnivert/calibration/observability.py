"""What the drive has shown of the mount, from the information gathered; not from the wheels' noise.

At one fixed centre of rotation (a turn on the spot, one circle) the bearings stay the same when camera and lines are
scaled and turned about that centre. A solution slides along this valley, and the jitter of the wheels then looks like
excitation. So the information is also taken on the nominal way: the simplest one that the wheels cannot be told from,
made of pieces with one centre of rotation each. The larger sigma counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from omnivert.angles import wrap

Array = NDArray[np.float64]

BRIDGE = 1.7  # a Brownian bridge of unit variance exceeds this in 1 of 160 cases


@dataclass(frozen=True, slots=True)
class Piece:
    """Part of the way with one centre of rotation, as far as the wheels tell."""

    steps: int
    right_m: float
    left_m: float
    way_m: float  # sum of |way|
    turned_rad: float  # sum of |heading change|

    @property
    def slant(self) -> float:
        """Direction in the plane of wheel displacements, mod pi: 0 straight, pi/2 on the spot, alike = same centre."""
        return float(wrap(2.0 * np.arctan2(self.right_m - self.left_m, self.right_m + self.left_m)) / 2.0)


def pieces(wheels: Array, base: float, noise_k: float, tick_m: float) -> list[Piece]:
    """The way cut where the ratio of the wheels changes by more than their noise explains.

    wheels   (S, 2)  m  right, left displacement of each step
    base             m
    noise_k          m  K
    tick_m           m  one count
    """
    found: list[Piece] = []
    first = 0
    while first < wheels.shape[0]:
        # How far one ratio holds, by doubling and halving: a step at a time would be slow on a long way.
        last, reach = first + 1, 1
        while reach and last < wheels.shape[0]:
            trial = min(last + reach, wheels.shape[0])
            if _one_ratio(wheels[first:trial], noise_k, tick_m):
                last, reach = trial, 2 * reach
            else:
                reach //= 2
        part = wheels[first:last]
        right, left = part.sum(axis=0)
        found.append(
            Piece(
                last - first,
                float(right),
                float(left),
                float(np.abs(part.sum(axis=1)).sum() / 2.0),
                float(np.abs(part[:, 0] - part[:, 1]).sum()) / base,
            )
        )
        first = last
    return found


def covariance_from_information(information: Array) -> Array:
    """Inverse (3, 3) of eta, cx, cy; what nothing is known of gets a sigma of 100 rad or m."""
    return np.asarray(np.linalg.inv(0.5 * (information + information.T) + 1e-4 * np.eye(3)), dtype=np.float64)


def larger(first: Array, second: Array) -> Array:
    """The smallest covariance that is at least as large as both in every direction that they share as axes."""
    value, vector = eigh(second, first)
    # first = V^-T V^-1 and second = V^-T diag(value) V^-1
    back = first @ vector
    return np.asarray(back @ np.diag(np.maximum(value, 1.0)) @ back.T)


def centres(found: list[Piece]) -> list[Piece]:
    """The pieces long enough to count, one for each clearly different centre of rotation."""
    kept: list[Piece] = []
    for piece in sorted(found, key=lambda p: -(p.way_m + 0.2 * p.turned_rad)):
        if piece.way_m < 0.25 and piece.turned_rad < np.deg2rad(25.0):
            continue
        if all(abs(wrap(2.0 * (piece.slant - k.slant))) / 2.0 > 0.17 for k in kept):
            kept.append(piece)
    return kept


def _one_ratio(wheels: Array, noise_k: float, tick_m: float) -> bool:
    """Whether displacements (S, 2) may be of one ratio right : left throughout."""
    total = wheels.sum(axis=0)
    length = float(np.hypot(*total))
    if length < 1e-9:
        return bool(np.abs(wheels).max() < 4.0 * tick_m)
    direction = total / length
    off = wheels[:, 0] * direction[1] - wheels[:, 1] * direction[0]
    variance = noise_k * (np.abs(wheels[:, 0]) * direction[1] ** 2 + np.abs(wheels[:, 1]) * direction[0] ** 2)
    bound = BRIDGE * np.sqrt(float(variance.sum())) + 3.0 * tick_m
    return bool(np.abs(np.cumsum(off)).max() < bound)
