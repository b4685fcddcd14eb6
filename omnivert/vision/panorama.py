"""Grey picture -> unwrapped panorama, and the rectangle around each line in it (V, Fig. 9)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.config import MirrorRing, Vision
from omnivert.vision.descriptor import descriptors
from omnivert.vision.dissimilarity import PATCHES, dissimilarity, minkowski
from omnivert.vision.image import Grey

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_ACROSS = 8  # cells of a patch across its line
_SAMPLES = 16  # in a cell at most, each way
_DEGREES = 360  # lines of a similarity matrix, one a degree


def panorama(
    grey: Grey, center: tuple[float, float], ring: MirrorRing, rows: int, columns: int, bearing_sign: int = 1
) -> Float32:
    """The ring unrolled, (rows, columns) float32: radius downwards, bearing to the right, each cell its own mean.

    The middle of column x lies at the bearing (x + 1/2) 2 pi / columns, the middle of row y at the radius
    Rmin + (y + 1/2) (Rmax - Rmin) / rows. Outside the picture its nearest pixel goes on.

    center        px
    bearing_sign  +1: the bearing is the image angle atan2(-(v - cv), u - cu); -1: it is the negative
    """
    # Sampled a pixel apart, then averaged: a coarse panorama must not pick out single pixels.
    length = ring.r_max_px - ring.r_min_px
    times_rows = min(max(int(np.ceil(length / rows)), 1), _SAMPLES)
    times_columns = min(max(int(np.ceil(TURN * ring.r_max_px / columns)), 1), _SAMPLES)
    angle = bearing_sign * (np.arange(columns * times_columns) + 0.5) * (TURN / (columns * times_columns))
    radius = ring.r_min_px + (np.arange(rows * times_rows) + 0.5) * (length / (rows * times_rows))
    r, cos, sin = (a.astype(np.float32) for a in (radius[:, None], np.cos(angle), np.sin(angle)))
    u, v = np.float32(center[0]) + r * cos, np.float32(center[1]) - r * sin
    fine = cv2.remap(grey.astype(np.float32), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.resize(fine, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def rectangles(
    grey: Grey,
    center: tuple[float, float],
    angle_rad: Float,
    ring: MirrorRing,
    across: int,
    along: int,
    slant_px: Float | None = None,
) -> Float32:
    """The rectangle of width 2 r_a around each line in the panorama, (N, along * across) grey values.

    center         px
    angle_rad      (N,)  image angle
    across, along  cells of a rectangle: tangential, radial
    slant_px       (N,)  how the lines lean, see `lines.Lines`; the rectangle leans with them; None: not at all

    # Paper: 2 r_a wide [at which radius is not said]. Here: 2 r_a of arc half way between Rmin and Rmax, where panorama
    # and picture are equally large.
    """
    if angle_rad.size == 0:
        return np.empty((0, along * across), dtype=np.float32)
    length, middle = ring.r_max_px - ring.r_min_px, 0.5 * (ring.r_max_px + ring.r_min_px)
    columns = round(TURN * middle / (length / 3.0) * across)
    unrolled = panorama(grey, center, ring, along, columns)
    direction = np.repeat(angle_rad[:, None], along, axis=1)
    if slant_px is not None:
        radius = ring.r_min_px + (np.arange(along) + 0.5) * (length / along)
        direction += slant_px[:, None] * (1.0 / radius - 1.0 / ring.horizon)
    # The line is in the middle, wherever it lies within a column: each cell is interpolated between two columns.
    place = direction[:, :, None] / TURN * columns - 0.5 + (np.arange(across) + 0.5 - 0.5 * across)
    left = np.floor(place).astype(np.intp)
    share = (place - left).astype(np.float32)
    row = np.arange(along)[None, :, None]
    cells = unrolled[row, left % columns] * (1.0 - share) + unrolled[row, (left + 1) % columns] * share
    return np.asarray(cells.reshape(angle_rad.size, along * across), dtype=np.float32)


def patches(
    grey: Grey,
    center: tuple[float, float],
    angle_rad: Float,
    ring: MirrorRing,
    vision: Vision,
    slant_px: Float | None = None,
) -> Float32:
    """Small rectangles to match lines by, (N, areas * 2 * bins): as many numbers as a descriptor has.

    # Paper: single pixels. Here: 8 cells across and, with the paper's 192 numbers, 24 along, because means stay the
    # same from frame to frame where pixels do not. On the corridor, 95 % of equal lines ten frames apart are within a
    # ZNCC that 2.9 % of different lines reach; with 16 x 48 cells 4.3 % do.
    """
    along = vision.areas * 2 * vision.bins // _ACROSS
    return rectangles(grey, center, angle_rad, ring, _ACROSS, along, slant_px)


def line_rows(
    grey: Grey,
    center: tuple[float, float],
    angle_rad: Float,
    ring: MirrorRing,
    vision: Vision,
    slant_px: Float | None = None,
) -> Float32:
    """What `vision.dissimilarity` compares: the lines' descriptors or their patches; (N, areas * 2 * bins)."""
    rows = patches if vision.dissimilarity in PATCHES else descriptors
    return rows(grey, center, angle_rad, ring, vision, slant_px)


def similarity_matrix(grey: Grey, center: tuple[float, float], ring: MirrorRing, vision: Vision) -> Float:
    """S(i, j) = d(H_i, H_j) of lines at 1, 2 .. 360 deg of image angle, (360, 360) (eqs. 11 to 13; Figs. 10 to 12).

    d is `vision.dissimilarity` as its equation gives it; SSD and ZNCC compare whole rectangles, pixel by pixel.
    """
    angle = wrap(np.deg2rad(np.arange(1.0, _DEGREES + 1.0)))
    kind = vision.dissimilarity
    if kind in PATCHES:
        length = ring.r_max_px - ring.r_min_px
        rows = rectangles(grey, center, angle, ring, round(length / 3.0), round(length))
    else:
        rows = descriptors(grey, center, angle, ring, vision)
    if kind == "l2":
        return minkowski(rows, rows, 2.0)  # exactly 0 from a line to itself
    return dissimilarity(rows, rows, kind, vision.bins)
