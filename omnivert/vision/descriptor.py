"""Grey picture and lines -> descriptors: orientation histograms beside the line (III, eqs. 2 to 5)."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.compiled import compiled
from omnivert.config import MirrorRing, Vision
from omnivert.vision.image import Grey

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

_COARSE_SIGMA_PX = 2.25  # after its smoothing a picture may be shrunk until the Gaussian's sigma is this
_STEP = 1.0 / 8.0  # spacing of the fast descriptor's samples, in radii of the area
_ROUNDING = 1e-3  # gradients of a flat area come out this large; they must not be scaled to unit length


class Field(NamedTuple):
    """The gradient of the smoothed picture around the ring."""

    gradient_u: Float32  # (H, W)
    gradient_v: Float32
    left: int  # the picture's pixel that the field begins at
    top: int
    scale: float  # field cells a pixel


def descriptors(
    grey: Grey,
    center: tuple[float, float],
    angle_rad: Float,
    ring: MirrorRing,
    vision: Vision,
    slant_px: Float | None = None,
) -> Float32:
    """One descriptor a line, (N, areas x 2 x bins); with three areas of 32 bins the paper's 192 numbers (eq. 5).

    center     px           of the ring
    angle_rad  (N,)  rad    image angle of the lines
    slant_px   (N,)  px     how the lines lean, see `lines.Lines`; None: not at all
    """
    if angle_rad.size == 0:
        return np.empty((0, vision.areas * 2 * vision.bins), dtype=np.float32)
    r_a, distance = area_radii(ring, vision.areas)
    exact = vision.mode == "paper"
    field = gradient_field(grey, center, ring.r_max_px + 1.5 * r_a + 2.0, r_a / 3.0, shrink=not exact)
    direction = np.repeat(angle_rad[:, None], distance.size, axis=1)  # of the areas' middles
    if slant_px is not None:
        direction += slant_px[:, None] * (1.0 / distance - 1.0 / ring.horizon)
    votes = np.zeros((angle_rad.size, distance.size, 2, vision.bins))
    at = center[0] - field.left, center[1] - field.top
    if exact:
        _pixel_votes(field.gradient_u, field.gradient_v, *at, direction, r_a, distance, votes)
    else:
        _grid_votes(field.gradient_u, field.gradient_v, *at, field.scale, direction, r_a, distance, _grid(), votes)
    H = votes.reshape(angle_rad.size, distance.size, 2 * vision.bins)
    return _unit(np.minimum(_unit(H), vision.clip)).reshape(angle_rad.size, -1).astype(np.float32)  # eq. 4


def area_radii(ring: MirrorRing, areas: int) -> tuple[float, Float]:
    """Radius r_a of the areas, and the distances of their middles from the ring's centre; px.

    Three areas touch each other; five have the same radius and overlap by half.
    """
    r_a = (ring.r_max_px - ring.r_min_px) / 6.0
    return r_a, ring.r_min_px + r_a * np.linspace(1.0, 5.0, areas)


def gradient_field(grey: Grey, center: tuple[float, float], reach: float, sigma: float, *, shrink: bool) -> Field:
    """Smoothed by a Gaussian, then Sobel, as in section II [the paper is silent on the kernel].

    reach, sigma  px
    shrink        first make the picture as small as the Gaussian allows
    All around the ring is smoothed, so that an area's border sees beyond it; the picture's border is repeated.
    """
    left, right = max(int(np.floor(center[0] - reach)), 0), int(np.ceil(center[0] + reach)) + 1
    top, bottom = max(int(np.floor(center[1] - reach)), 0), int(np.ceil(center[1] + reach)) + 1
    part = grey[top : max(bottom, 0), left : max(right, 0)]
    if part.size == 0:
        flat = np.zeros((1, 1), dtype=np.float32)
        return Field(flat, flat, left, top, 1.0)
    times = max(int(sigma / _COARSE_SIGMA_PX), 1) if shrink else 1
    height, width = (max(length // times, 1) for length in part.shape)
    if times > 1:  # by whole cells, which is quick
        part = part[: height * times, : width * times]
        part = np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    left_over = np.sqrt(sigma**2 - (times**2 - 1) / 12.0) / times  # shrinking has smoothed a little already
    smooth = cv2.GaussianBlur(part.astype(np.float32), (0, 0), left_over, borderType=cv2.BORDER_REPLICATE)
    gu = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
    gv = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
    return Field(gu, gv, left, top, 1.0 / times)


def _grid() -> Float:
    """Samples of an area: along the line and counter-clockwise of it, in radii (2, P)."""
    steps = np.arange(-1.0 + _STEP / 2.0, 1.0, _STEP)
    along, across = (a.ravel() for a in np.meshgrid(steps, steps))
    return np.stack((along, across))[:, along**2 + across**2 <= 1.0]


@compiled
def _pixel_votes(
    gradient_u: Float32,
    gradient_v: Float32,
    center_u: float,
    center_v: float,
    direction: Float,
    r_a: float,
    distance: Float,
    votes: Float,
) -> None:
    """Every pixel of every area votes, as the paper has it; pixels outside the picture have no vote."""
    height, width = gradient_u.shape
    for line in range(direction.shape[0]):
        for area in range(distance.size):
            cos, sin = np.cos(direction[line, area]), np.sin(direction[line, area])
            u0, v0 = center_u + distance[area] * cos, center_v - distance[area] * sin  # the area's middle
            for v in range(max(int(np.ceil(v0 - r_a)), 0), min(int(np.floor(v0 + r_a)), height - 1) + 1):
                half = np.sqrt(max(r_a * r_a - (v - v0) ** 2, 0.0))
                for u in range(max(int(np.ceil(u0 - half)), 0), min(int(np.floor(u0 + half)), width - 1) + 1):
                    left = -sin * (u - u0) - cos * (v - v0) >= 0.0
                    gu, gv = gradient_u[v, u], gradient_v[v, u]
                    along, across = cos * gu - sin * gv, -sin * gu - cos * gv
                    part = votes[line, area, 0 if left else 1]
                    _vote(part, np.sqrt(along * along + across * across), np.arctan2(across, along) / TURN)


@compiled
def _grid_votes(
    gradient_u: Float32,
    gradient_v: Float32,
    center_u: float,
    center_v: float,
    scale: float,
    direction: Float,
    r_a: float,
    distance: Float,
    grid: Float,
    votes: Float,
) -> None:
    """A grid in each area that turns with the line votes, on a picture that may have been shrunk.

    # Paper: every pixel, at full size. Here: about 200 samples an area, because after a Gaussian of r_a / 3 the pixels
    # between them say little new.
    """
    height, width = gradient_u.shape
    samples = grid.shape[1]
    along, across, magnitude, turn = np.empty((4, samples))
    for line in range(direction.shape[0]):
        for area in range(distance.size):
            cos, sin = np.cos(direction[line, area]), np.sin(direction[line, area])
            for k in range(samples):
                radial, tangential = distance[area] + r_a * grid[0, k], r_a * grid[1, k]
                u = (center_u + cos * radial - sin * tangential + 0.5) * scale - 0.5
                v = (center_v - sin * radial - cos * tangential + 0.5) * scale - 0.5
                along[k] = across[k] = 0.0
                if not (0.0 <= u < width - 1.0 and 0.0 <= v < height - 1.0):
                    continue
                left, top = int(u), int(v)
                a, b = u - left, v - top
                p, q, r, s = (1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b
                gu = p * gradient_u[top, left] + q * gradient_u[top, left + 1]
                gu += r * gradient_u[top + 1, left] + s * gradient_u[top + 1, left + 1]
                gv = p * gradient_v[top, left] + q * gradient_v[top, left + 1]
                gv += r * gradient_v[top + 1, left] + s * gradient_v[top + 1, left + 1]
                along[k], across[k] = cos * gu - sin * gv, -sin * gu - cos * gv
            for k in range(samples):  # by itself, so that the compiler works on many at a time
                magnitude[k] = np.sqrt(along[k] * along[k] + across[k] * across[k])
                turn[k] = _turn(across[k], along[k])
            for k in range(samples):
                _vote(votes[line, area, 0 if grid[1, k] >= 0.0 else 1], magnitude[k], turn[k])


@compiled
def _vote(histogram: Float, magnitude: float, turn: float) -> None:
    """Adds a gradient to the two bins nearest to its orientation (eqs. 2 and 3); turn -0.5 .. 0.5, from the line's."""
    if magnitude <= _ROUNDING:
        return
    bins = histogram.size
    place = (turn + 1.0) * bins
    b = int(place)
    w = place - b  # eq. 2
    lower = b - bins if b >= bins else b
    histogram[lower] += magnitude * (1.0 - w)
    histogram[lower + 1 if lower + 1 < bins else 0] += magnitude * w


@compiled
def _turn(y: float, x: float) -> float:
    """arctan2(y, x) in turns, right to 1.4e-5 of a turn, far below a bin, for a fifth of the time."""
    a, b = abs(x), abs(y)
    steep = b > a
    t = (a if steep else b) / max(a, b, 1e-30)
    s = t * t
    turn = t * (0.15903795 - s * (0.05115495 - s * (0.02333101 - s * 0.0062267)))  # least greatest error on 0 .. 1
    turn = 0.25 - turn if steep else turn
    turn = 0.5 - turn if x < 0.0 else turn
    return -turn if y < 0.0 else turn


def _unit(H: Float) -> Float:
    """Each area's histograms at unit length; an area without any gradient stays zero."""
    length = np.linalg.norm(H, axis=-1, keepdims=True)
    return np.asarray(np.divide(H, length, out=np.zeros_like(H), where=length > 1e-9))
