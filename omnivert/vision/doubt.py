"""Lines -> lines that allow for what a fit to their points cannot know."""

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.compiled import compiled
from omnivert.config import MirrorRing
from omnivert.vision.image import Grey
from omnivert.vision.lines import Lines

Float = NDArray[np.float64]

_LEAN_SHARE = 0.22  # of a line's lean that may be an error of its place at the horizon
_HORIZON_GUESSED, _HORIZON_KNOWN = 0.03, 0.01  # shares of the horizon's radius that it may be off
_WHITE = 250  # grey; JPEG leaves this of a sensor that is full
_BESIDE_PX = 2.5  # how far beside an edge its brighter side is looked at
_SAMPLES = 16  # along a line
_CLIPPED_PX = (0.3, 0.45)  # an edge whose brighter side is clipped all along has moved by this; give or take


def doubted(lines: Lines, grey: Grey, center: tuple[float, float], ring: MirrorRing) -> Lines:
    """The lines with sigmas that allow for lean, tilt and clipping, and with what clipping moves, on the mean, undone.

    center  px  of the ring
    """
    return _allowed_for_clipping(_allowed_for_tilt(_allowed_for_lean(lines, ring), ring), grey, center, ring)


def _allowed_for_lean(lines: Lines, ring: MirrorRing) -> Lines:
    """One that does not run to where lines meet is no single clean edge.

    Of bearings more than 4 sigma off on the corridor, the median line leans by 0.42 px, of the others by 0.19 px.
    """
    return lines._replace(std_rad=np.hypot(lines.std_rad, _LEAN_SHARE * np.abs(lines.lean_px) / ring.horizon))


def _allowed_for_tilt(lines: Lines, ring: MirrorRing) -> Lines:
    """Where the axis leans, bearings are read at the horizon, which may be off; and to the first order of the tilt.

    A line that passes the centre at a distance s turns by s dh / h^2 when the horizon is off by dh; the tilt is s / h.
    """
    share = _HORIZON_KNOWN if ring.horizon_px else _HORIZON_GUESSED
    tilt = np.abs(lines.slant_px) / ring.horizon
    return lines._replace(std_rad=np.sqrt(lines.std_rad**2 + (share * tilt) ** 2 + (0.5 * tilt**2) ** 2))


def _allowed_for_clipping(lines: Lines, grey: Grey, center: tuple[float, float], ring: MirrorRing) -> Lines:
    """A sensor that is full cuts off the upper part of an edge, and what is left of it lies too far in the dark.

    By how much depends on what was cut off: a mean is corrected, and the rest is doubt. Overexposed by a factor of two,
    the corridor's robust sigma falls from 1.58 to 1.10 mrad so, and the normalised one from 2.1 to about 1.
    """
    ends = lines.inner_px, lines.outer_px
    share = _clipped_share(grey, *center, lines.angle_rad, lines.polarity, lines.slant_px, *ends, ring.horizon)
    middle = np.maximum(0.5 * (lines.inner_px + lines.outer_px), 1.0)
    moved, give_or_take = _CLIPPED_PX
    return lines._replace(
        angle_rad=wrap(lines.angle_rad + lines.polarity * moved * share / middle),
        std_rad=np.hypot(lines.std_rad, give_or_take * share / middle),
    )


@compiled
def _clipped_share(
    grey: Grey,
    center_u: float,
    center_v: float,
    angle: Float,
    polarity: NDArray[np.int64],
    slant: Float,
    inner: Float,
    outer: Float,
    horizon: float,
) -> Float:
    """The share of each line, (N,), beside which the picture is white; its brighter side."""
    height, width = grey.shape
    share = np.zeros(angle.size)
    for i in range(angle.size):
        cos, sin = np.cos(angle[i]), np.sin(angle[i])
        for k in range(_SAMPLES):
            radius = inner[i] + (outer[i] - inner[i]) * (k + 0.5) / _SAMPLES
            across = slant[i] * (1.0 - radius / horizon) + polarity[i] * _BESIDE_PX
            u, v = center_u + radius * cos - across * sin, center_v - radius * sin - across * cos
            if -0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5 and grey[int(v + 0.5), int(u + 0.5)] >= _WHITE:
                share[i] += 1.0 / _SAMPLES
    return share
