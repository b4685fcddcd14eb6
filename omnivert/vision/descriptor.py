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

    gradient: Float32  # (H, W, 2) along u and along v
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
        _pixel_votes(field.gradient, *at, direction, r_a, distance, votes)
    else:
        framed = np.asarray(cv2.copyMakeBorder(field.gradient, 1, 2, 1, 2, cv2.BORDER_CONSTANT), dtype=np.float32)
        _grid_votes(framed, *at, field.scale, direction, r_a, distance, _GRID, votes)
    H = votes.reshape(angle_rad.size * distance.size, 2 * vision.bins)
    _to_unit(H)
    np.minimum(H, vision.clip, out=H)
    _to_unit(H)  # eq. 4
    return H.reshape(angle_rad.size, -1).astype(np.float32)


def area_radii(ring: MirrorRing, areas: int) -> tuple[float, Float]:
    """Radius r_a of the areas, and the distances of their middles from the ring's centre; px.

    Three areas touch each other; five have the same radius and overlap by half.
    """
    r_a = (ring.r_max_px - ring.r_min_px) / 6.0
    return r_a, ring.r_min_px + r_a * (1.0 + np.arange(areas, dtype=np.float64) * (4.0 / (areas - 1)))


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
        return Field(np.zeros((1, 1, 2), dtype=np.float32), left, top, 1.0)
    times = max(int(sigma / _COARSE_SIGMA_PX), 1) if shrink else 1
    if min(part.shape) < times:
        times = 1
    shrunk = _means(np.ascontiguousarray(part), times) if times > 1 else part.astype(np.float32)
    left_over = np.sqrt(sigma**2 - (times**2 - 1) / 12.0) / times  # shrinking has smoothed a little already
    smooth = cv2.GaussianBlur(shrunk, (0, 0), left_over, borderType=cv2.BORDER_REPLICATE)
    gu = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    gv = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    return Field(np.asarray(cv2.merge((gu, gv)), dtype=np.float32), left, top, 1.0 / times)


@compiled
def _means(grey: Grey, times: int) -> Float32:
    """The picture shrunk by a whole number, each pixel the mean of its square."""
    height, width = grey.shape[0] // times, grey.shape[1] // times
    means, row = np.empty((height, width), dtype=np.float32), np.empty(width * times, dtype=np.int32)
    share = np.float32(1.0 / (times * times))
    for v in range(height):
        row[:] = 0
        for line in range(times):
            part = grey[v * times + line]
            for u in range(row.size):
                row[u] += part[u]
        for u in range(width):
            total = np.int32(0)
            for k in range(times):
                total += row[u * times + k]
            means[v, u] = np.float32(total) * share
    return means


def _grid() -> Float32:
    """Samples of an area: along the line and counter-clockwise of it, in radii (2, P); the second half is left."""
    steps = np.arange(-1.0 + _STEP / 2.0, 1.0, _STEP)
    along, across = (a.ravel() for a in np.meshgrid(steps, steps))
    inside = along**2 + across**2 <= 1.0
    return np.stack((along[inside], across[inside])).astype(np.float32)


_GRID = _grid()


@compiled
def _pixel_votes(
    gradient: Float32,
    center_u: float,
    center_v: float,
    direction: Float,
    r_a: float,
    distance: Float,
    votes: Float,
) -> None:
    """Every pixel of every area votes, as the paper has it; pixels outside the picture have no vote."""
    height, width = gradient.shape[:2]
    for line in range(direction.shape[0]):
        for area in range(distance.size):
            cos, sin = np.cos(direction[line, area]), np.sin(direction[line, area])
            u0, v0 = center_u + distance[area] * cos, center_v - distance[area] * sin  # the area's middle
            for v in range(max(int(np.ceil(v0 - r_a)), 0), min(int(np.floor(v0 + r_a)), height - 1) + 1):
                half = np.sqrt(max(r_a * r_a - (v - v0) ** 2, 0.0))
                for u in range(max(int(np.ceil(u0 - half)), 0), min(int(np.floor(u0 + half)), width - 1) + 1):
                    left = -sin * (u - u0) - cos * (v - v0) >= 0.0
                    gu, gv = gradient[v, u]
                    along, across = cos * gu - sin * gv, -sin * gu - cos * gv
                    part = votes[line, area, 0 if left else 1]
                    _vote(part, np.sqrt(along * along + across * across), np.arctan2(across, along) / TURN)


@compiled
def _grid_votes(
    gradient: Float32,
    center_u: float,
    center_v: float,
    scale: float,
    direction: Float,
    r_a: float,
    distance: Float,
    grid: Float32,
    votes: Float,
) -> None:
    """A grid in each area that turns with the line votes, on a picture that may have been shrunk.

    # Paper: every pixel, at full size. Here: about 200 samples an area, because after a Gaussian of r_a / 3 the pixels
    # between them say little new.
    """
    sample = np.empty((2, grid.shape[1]), dtype=np.float32)
    half = grid.shape[1] // 2
    for line in range(direction.shape[0]):
        for area in range(distance.size):
            cos, sin = np.cos(direction[line, area]), np.sin(direction[line, area])
            u = (center_u + distance[area] * cos + 0.5) * scale + 0.5  # the frame's cell more
            v = (center_v - distance[area] * sin + 0.5) * scale + 0.5
            r = r_a * scale
            # Three loops, each of one kind of work, in single precision: the compiler works on many at a time.
            _samples(gradient, np.float32(u), np.float32(v), np.float32(r * cos), np.float32(r * sin), grid, sample)
            _to_polar(sample, np.float32(cos), np.float32(sin))
            for k in range(half):
                _vote(votes[line, area, 1], sample[0, k], sample[1, k])
            for k in range(half, 2 * half):
                _vote(votes[line, area, 0], sample[0, k], sample[1, k])


@compiled
def _samples(
    gradient: Float32, u: np.float32, v: np.float32, cos: np.float32, sin: np.float32, grid: Float32, sample: Float32
) -> None:
    """The gradient, bilinear, at a grid about (u, v) with axes (cos, -sin) and (-sin, -cos); outside, the border's."""
    height, width = np.int32(gradient.shape[0]), np.int32(gradient.shape[1])
    flat = gradient.reshape(-1)
    zero, one = np.float32(0.0), np.float32(1.0)
    last_u, last_v = np.float32(width - 2), np.float32(height - 2)
    for k in range(sample.shape[1]):
        x = min(max(u + cos * grid[0, k] - sin * grid[1, k], zero), last_u)
        y = min(max(v - sin * grid[0, k] - cos * grid[1, k], zero), last_v)
        left, top = np.int32(x), np.int32(y)
        a, b = x - np.float32(left), y - np.float32(top)
        i = np.int32(2) * (top * width + left)
        j = i + np.int32(2) * width
        p, q, r, s = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
        sample[0, k] = p * flat[i] + q * flat[i + 2] + r * flat[j] + s * flat[j + 2]
        sample[1, k] = p * flat[i + 1] + q * flat[i + 3] + r * flat[j + 1] + s * flat[j + 3]


@compiled
def _to_polar(sample: Float32, cos: np.float32, sin: np.float32) -> None:
    """Gradients along u and v -> magnitudes, and orientations from the line's, turns from -0.5 to 0.5.

    The arctangent is right to 1.4e-5 of a turn, far below a bin, for a fifth of the time.
    """
    c0, c1, c2, c3 = np.float32(0.15903795), np.float32(0.05115495), np.float32(0.02333101), np.float32(0.0062267)
    quarter, half, tiny = np.float32(0.25), np.float32(0.5), np.float32(1e-30)
    for k in range(sample.shape[1]):
        gu, gv = sample[0, k], sample[1, k]
        x, y = cos * gu - sin * gv, -sin * gu - cos * gv
        a, b = abs(x), abs(y)
        t = min(a, b) / max(max(a, b), tiny)
        s = t * t
        turn = t * (c0 - s * (c1 - s * (c2 - s * c3)))  # least greatest error on 0 .. 1
        turn = quarter - turn if b > a else turn
        turn = half - turn if x < 0.0 else turn
        sample[0, k] = np.sqrt(x * x + y * y)
        sample[1, k] = -turn if y < 0.0 else turn


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
def _to_unit(H: Float) -> None:
    """Brings each area's histograms, a row, to unit length; an area without any gradient stays zero."""
    for i in range(H.shape[0]):
        square = 0.0
        for k in range(H.shape[1]):
            square += H[i, k] * H[i, k]
        length = np.sqrt(square)
        for k in range(H.shape[1]):
            H[i, k] = H[i, k] / length if length > 1e-9 else 0.0
