"""Grey picture -> circles across which it falls from bright to dark, or rises, nearly all around; needs no edges.

Radial lines, texture and noise fall as often as they rise along a circle. The rim of a mirror, and the robot's own
image in its middle, do one of the two nearly everywhere, sharp or soft, whole or cut by the picture's border.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.compiled import compiled
from omnivert.vision.image import Grey

Float = NDArray[np.float64]

ANGLES = 72  # places of a circle that are asked
_LEAST_STEP = 5.0  # grey steps; less is neither a fall nor a rise


class Grid(NamedTuple):
    """Circles to try: every centre with every radius, px."""

    u_px: Float
    v_px: Float
    radius_px: Float


def falls(grey: Grey, grid: Grid, width: float) -> tuple[Float, Float]:
    """How one-sided the picture is across each circle of a grid.

    grey     (H, W)  uint8
    width    share of the radius that lies between the two points that are compared, and at least 3 px
    returns  (V, U, R) share of the places seen that fall towards the outside, less the share that rise, -1 .. 1
             (V, U, R) share of the places that lie in the picture, 0 .. 1
    """
    turn = np.linspace(0.0, TURN, ANGLES, endpoint=False)
    return _falls(np.ascontiguousarray(grey), *grid, width, _LEAST_STEP, np.cos(turn), np.sin(turn))


@compiled
def _falls(
    grey: Grey,
    centers_u: Float,
    centers_v: Float,
    radii: Float,
    width: float,
    least: float,
    cos: Float,
    sin: Float,
) -> tuple[Float, Float]:
    height, columns = grey.shape
    shape = (centers_v.size, centers_u.size, radii.size)
    net, seen = np.zeros(shape), np.zeros(shape)
    for j in range(centers_v.size):
        for i in range(centers_u.size):
            for k in range(radii.size):
                half = max(0.5 * width * radii[k], 1.5)
                inner, outer = radii[k] - half, radii[k] + half
                count = total = 0
                for a in range(cos.size):
                    outer_u = int(np.floor(centers_u[i] + outer * cos[a] + 0.5))
                    outer_v = int(np.floor(centers_v[j] + outer * sin[a] + 0.5))
                    inner_u = int(np.floor(centers_u[i] + inner * cos[a] + 0.5))
                    inner_v = int(np.floor(centers_v[j] + inner * sin[a] + 0.5))
                    if not (0 <= outer_u < columns and 0 <= outer_v < height):
                        continue
                    if not (0 <= inner_u < columns and 0 <= inner_v < height):
                        continue
                    step = np.float64(grey[inner_v, inner_u]) - np.float64(grey[outer_v, outer_u])
                    total += 1
                    count += 1 if step >= least else -1 if step <= -least else 0
                if total:
                    net[j, i, k] = count / total
                    seen[j, i, k] = total / cos.size
    return net, seen
