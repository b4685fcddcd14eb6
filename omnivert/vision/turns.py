"""Angles inside compiled loops: an arctangent in a third of the time, the short way round, cells of a circle."""

import numpy as np

from omnivert.angles import TURN
from omnivert.compiled import compiled


@compiled
def arctan2(y: float, x: float) -> float:
    """Right to 8e-8 rad, for a third of the time; (0, 0) gives 0."""
    a, b = abs(x), abs(y)
    t = min(a, b) / max(max(a, b), 1e-300)
    s = t * t
    rest = s * (0.09906096896 - s * (0.05936710079 - s * (0.02416618952 - s * 0.00466877331)))
    angle = t * (0.99999989775 - s * (0.33331959725 - s * (0.19969235395 - s * (0.14016585042 - rest))))
    angle = 0.5 * np.pi - angle if b > a else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@compiled
def short_way(angle: float) -> float:
    """The same direction in [-pi, pi]; `angles.wrap` for one number in a loop."""
    return float(angle - TURN * np.rint(angle / TURN))


@compiled
def cell_of(angle: float, cells: int) -> int:
    """Which of so many equal cells of the circle, the first from -pi on, an angle lies in."""
    return int((angle / TURN + 0.5) * cells) % cells
