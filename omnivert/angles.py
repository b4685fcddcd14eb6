"""Angles in radians: the only place that knows 2 pi."""

from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

TURN = 2.0 * np.pi


@overload
def wrap(angle: float) -> float: ...
@overload
def wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]: ...
def wrap(angle: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The same direction in (-pi, pi]; rad, any shape."""
    if not isinstance(angle, np.ndarray):
        wrapped = angle - TURN * float(np.rint(angle / TURN))  # half a turn is rounded to none
        return np.pi if wrapped <= -np.pi else min(wrapped, np.pi)
    whole = np.asarray(angle, dtype=np.float64)
    turned = whole - TURN * np.rint(whole / TURN)
    return np.where(turned <= -np.pi, np.pi, np.minimum(turned, np.pi))


def mean(angles: ArrayLike, weights: ArrayLike | None = None) -> float:
    """The direction of the summed unit vectors, in (-pi, pi]; rad.

    angles   (N,)  rad
    weights  (N,)  not negative; equal when left out
    raises   ValueError when there is no angle, or when the vectors cancel out
    """
    a = np.asarray(angles, dtype=np.float64)
    w = np.ones_like(a) if weights is None else np.asarray(weights, dtype=np.float64)
    resultant = complex(np.sum(w * np.exp(1j * a)))
    if not abs(resultant) > 1e-12 * max(float(np.sum(w)), 1e-300):
        raise ValueError("these angles have no mean direction")
    return wrap(float(np.angle(resultant)))
