"""Grey picture -> thinned edge points with their gradients (II, steps 2 and 3); ring and lines both start here."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.vision.image import Grey

Array = NDArray[np.float32]

_STRIP_ROWS = 64  # worked on at a time: all of a strip stays in the cache, and no large array is made per frame


class Box(NamedTuple):
    """A rectangle of pixels: columns left .. right - 1, rows top .. bottom - 1."""

    left: int
    top: int
    right: int
    bottom: int


class Edges(NamedTuple):
    """Thinned edge points, (N,) each; u to the right, v down, pixel centres at integers."""

    u_px: Array  # below the pixel across the edge, along the picture axis nearer to the gradient
    v_px: Array
    gradient_u: Array  # Sobel, grey steps x 8
    gradient_v: Array


def box_around(center_u: float, center_v: float, reach_px: float, width: int, height: int) -> Box:
    """The part of the picture within reach of a point; right <= left or bottom <= top where there is none."""
    left, right = int(np.floor(center_u - reach_px)), int(np.ceil(center_u + reach_px)) + 1
    top, bottom = int(np.floor(center_v - reach_px)), int(np.ceil(center_v + reach_px)) + 1
    return Box(max(left, 0), max(top, 0), min(right, width), min(bottom, height))


def thinned_edges(grey: Grey, box: Box, min_magnitude: float) -> Edges:
    """Points where the gradient's magnitude (eq. 1) has a ridge across the edge.

    grey           (H, W)  uint8
    min_magnitude  grey steps x 8; weaker pixels are no edge
    """
    strips = [
        _strip_edges(
            grey[top : min(top + _STRIP_ROWS + 4, box.bottom), box.left : box.right], box.left, top, min_magnitude
        )
        for top in range(box.top, box.bottom - 4, _STRIP_ROWS)
        if box.right - box.left > 4
    ]
    if not strips:
        none = np.empty(0, dtype=np.float32)
        return Edges(none, none, none, none)
    return Edges(*(np.concatenate(column) for column in zip(*strips, strict=True)))


def _strip_edges(strip: Grey, left: int, top: int, min_magnitude: float) -> Edges:
    """The edge points of a strip, its two outermost rows and columns left out."""
    sobel_u, sobel_v = cv2.spatialGradient(np.ascontiguousarray(strip))
    gu, gv = sobel_u.astype(np.float32), sobel_v.astype(np.float32)
    magnitude = np.sqrt(gu * gu + gv * gv)  # cv2.magnitude's last bit depends on where in memory its arguments lie
    # Paper: silent on how edges are thinned. Here: along the picture axis nearer to the gradient, because an edge then
    # keeps exactly one point in each row (or column) that it crosses, and its place comes below the pixel for free.
    inner = magnitude[2:-2, 2:-2]
    across = np.abs(sobel_u[2:-2, 2:-2]) >= np.abs(sobel_v[2:-2, 2:-2])
    ridge_u = (inner >= magnitude[2:-2, 1:-3]) & (inner > magnitude[2:-2, 3:-1])
    ridge_v = (inner >= magnitude[1:-3, 2:-2]) & (inner > magnitude[3:-1, 2:-2])
    ridge = ((ridge_u & across) | (ridge_v & ~across)) & (inner > max(min_magnitude, 1e-3))
    v, u = np.divmod(np.flatnonzero(ridge), inner.shape[1])
    v, u = v + 2, u + 2
    columns = strip.shape[1]
    at = v * columns + u
    m, a_u, a_v = magnitude.ravel(), gu.ravel()[at], gv.ravel()[at]
    across_here = np.abs(a_u) >= np.abs(a_v)
    step = np.where(across_here, 1, columns)
    here, before, after = m[at], m[at - step], m[at + step]
    offset = 0.5 * (before - after) / np.minimum(before - 2.0 * here + after, np.float32(-1e-6))
    place_u = (u + left).astype(np.float32) + np.where(across_here, offset, np.float32(0.0))
    place_v = (v + top).astype(np.float32) + np.where(across_here, np.float32(0.0), offset)
    return Edges(place_u, place_v, a_u, a_v)
