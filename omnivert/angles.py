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
    whole = np.asarray(angle, dtype=np.float64)
    wrapped = np.minimum(whole - TURN * np.ceil((whole - np.pi) / TURN), np.pi)
    # Rounding may carry an angle out of the interval, or one that is inside to its other end.
    wrapped = np.where(np.abs(whole) < np.pi, whole, np.where(wrapped <= -np.pi, np.pi, wrapped))
    return wrapped if isinstance(angle, np.ndarray) else float(wrapped)


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
