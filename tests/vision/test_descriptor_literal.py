"""Section III once more, pixel by pixel in plain Python, from the equations alone."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.config import MirrorRing, Vision
from omnivert.vision.descriptor import descriptors

Picture = list[list[float]]


def _within(i: int, n: int) -> int:
    """Index into n pixels whose first and last go on for ever [the paper is silent on the picture's border]."""
    return min(max(i, 0), n - 1)


def _smoothed(picture: Picture, sigma: float) -> Picture:
    """Gaussian, first along the rows, then along the columns, cut off at four sigma [the paper is silent on that]."""
    reach = round(4.0 * sigma)
    weight = [math.exp(-0.5 * (k / sigma) ** 2) for k in range(-reach, reach + 1)]
    total = sum(weight)
    height, width = len(picture), len(picture[0])
    rows = [
        [sum(w * row[_within(u + k - reach, width)] for k, w in enumerate(weight)) / total for u in range(width)]
        for row in picture
    ]
    return [
        [sum(w * rows[_within(v + k - reach, height)][u] for k, w in enumerate(weight)) / total for u in range(width)]
        for v in range(height)
    ]


def _gradient(picture: Picture, u: int, v: int) -> tuple[float, float]:
    """(Ix, Iy) by the two 3x3 Sobel masks, x to the right and y upwards."""
    height, width = len(picture), len(picture[0])

    def at(du: int, dv: int) -> float:
        return picture[_within(v + dv, height)][_within(u + du, width)]

    right = (at(1, -1) + 2.0 * at(1, 0) + at(1, 1)) - (at(-1, -1) + 2.0 * at(-1, 0) + at(-1, 1))
    down = (at(-1, 1) + 2.0 * at(0, 1) + at(1, 1)) - (at(-1, -1) + 2.0 * at(0, -1) + at(1, -1))
    return right, -down


def _unit(values: list[float]) -> list[float]:
    length = math.sqrt(sum(x * x for x in values))
    return [x / length for x in values] if length > 0.0 else values


def _area(
    smooth: Picture, u0: float, v0: float, radius: float, theta: float, bins: int, clip: float
) -> tuple[list[float], float]:
    """H_i of one circular area, and how near its decisions are to turning over (px)."""
    left, right = [0.0] * bins, [0.0] * bins
    margin = math.inf
    for v in range(len(smooth)):
        for u in range(len(smooth[0])):
            x, y = u - u0, -(v - v0)
            side = math.cos(theta) * y - math.sin(theta) * x  # > 0: left of somebody who looks outwards
            margin = min(margin, abs(math.hypot(x, y) - radius))
            if math.hypot(x, y) > radius:
                continue
            margin = min(margin, abs(side))
            ix, iy = _gradient(smooth, u, v)
            m, phi = math.hypot(ix, iy), math.atan2(iy, ix) - theta
            b = math.floor(bins * phi / (2.0 * math.pi))
            w = bins * phi / (2.0 * math.pi) - b  # eq. 2
            part = left if side > 0.0 else right
            part[b % bins] += m * (1.0 - w)
            part[(b + 1) % bins] += m * w
    return _unit([min(x, clip) for x in _unit(left + right)]), margin  # eq. 3


def _descriptor(
    smooth: Picture, center: tuple[float, float], theta: float, ring: MirrorRing, vision: Vision
) -> tuple[list[float], float]:
    """H (eqs. 4, 5) of one line, and how near any decision on a pixel is to turning over (px)."""
    radius = _radius(ring)
    step = 2.0 * radius if vision.areas == 3 else radius  # five areas overlap by half
    H: list[float] = []
    margin = math.inf
    for i in range(vision.areas):
        distance = ring.r_min_px + radius + i * step
        u0, v0 = center[0] + distance * math.cos(theta), center[1] - distance * math.sin(theta)
        part, near = _area(smooth, u0, v0, radius, theta, vision.bins, vision.clip)
        H, margin = H + part, min(margin, near)
    return H, margin


def _radius(ring: MirrorRing) -> float:
    return (ring.r_max_px - ring.r_min_px) / 6.0


def _greatest_difference(
    picture: NDArray[np.uint8], center: tuple[float, float], ring: MirrorRing, **settings: object
) -> float:
    """Of any number of any of nine lines all around."""
    vision = Vision.model_validate({"mode": "paper", **settings})
    fast = descriptors(picture, center, ANGLES, ring, vision)
    assert fast.shape == (ANGLES.size, vision.areas * 2 * vision.bins)
    smooth = _smoothed([[float(x) for x in row] for row in picture], _radius(ring) / 3.0)
    difference = []
    for row, theta in zip(fast, ANGLES, strict=True):
        H, margin = _descriptor(smooth, center, float(theta), ring, vision)
        if margin > 1e-4:  # a pixel nearer than this to a border may rightly go either way
            difference.append(float(np.max(np.abs(row - np.array(H)))))
    assert len(difference) > ANGLES.size // 2
    return max(difference)


def _random(
    seed: int, center: tuple[float, float], r_max: float, size: tuple[int, int] = (64, 60)
) -> NDArray[np.uint8]:
    """A picture of noise within the rim, black outside, as a camera with a mirror sees it."""
    picture = np.random.default_rng(seed).integers(0, 256, size[::-1])
    v, u = np.mgrid[: size[1], : size[0]]
    return np.where(np.hypot(u - center[0], v - center[1]) <= r_max, picture, 0).astype(np.uint8)


RING = MirrorRing(center_px=(32.0, 30.0), r_min_px=5.0, r_max_px=26.0)
CENTER = (31.37, 29.81)
ANGLES = np.linspace(-3.1, 3.0, 9)  # about the centre CENTER all areas are whole


@pytest.mark.parametrize("bins", [8, 16, 32])
@pytest.mark.parametrize("areas", [3, 5])
def test_the_descriptor_is_the_literal_one(areas: int, bins: int) -> None:
    picture = _random(areas + bins, CENTER, RING.r_max_px)
    assert _greatest_difference(picture, CENTER, RING, areas=areas, bins=bins) < 1e-4


@pytest.mark.parametrize("clip", [0.02, 0.05, 0.2, 0.4, 1.0])
def test_the_descriptor_is_the_literal_one_wherever_it_is_clipped(clip: float) -> None:
    assert _greatest_difference(_random(1, CENTER, RING.r_max_px), CENTER, RING, clip=clip) < 1e-4


@pytest.mark.parametrize("r_max", [22.0, 24.5, 29.0, 35.0])
def test_the_descriptor_is_the_literal_one_for_areas_of_any_size(r_max: float) -> None:
    center, ring = (40.2, 38.1), MirrorRing(center_px=(40.0, 38.0), r_min_px=5.5, r_max_px=r_max)
    assert _greatest_difference(_random(3, center, r_max, (80, 76)), center, ring) < 1e-4


@pytest.mark.parametrize("center", [(25.4, 24.2), (12.3, 30.2), (52.6, 29.1), (31.2, 8.3), (31.2, 52.3), (-5.0, -4.0)])
def test_the_descriptor_is_the_literal_one_where_the_ring_leaves_the_picture(center: tuple[float, float]) -> None:
    assert _greatest_difference(_random(2, center, RING.r_max_px), center, RING) < 1e-4


@pytest.mark.parametrize("center", [CENTER, (25.4, 24.2), (52.6, 29.1)])
def test_what_lies_far_outside_the_rim_hardly_matters(center: tuple[float, float]) -> None:
    """With noise there as strong as inside: of it the outermost area's Gaussian may be cut off at three sigma."""
    assert _greatest_difference(_random(2, center, 1e9), center, RING) < 0.02  # measured 0.010
