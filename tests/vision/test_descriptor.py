"""The descriptor against a slow, literal re-implementation that shares nothing with it but OpenCV's filters."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import MirrorRing, Vision
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.descriptor import descriptors
from omnivert.vision.edges import everywhere, thinned_edges
from omnivert.vision.image import grey_from_frame
from omnivert.vision.lines import Lines, lines_from_edges
from omnivert.vision.matching import distances, matches

Grey = NDArray[np.uint8]
RING = MirrorRing()
ANGLES = np.array([0.0, 0.7, -1.234, 3.0, math.pi, -2.2])


def _literal(grey: Grey, cu: float, cv: float, theta: float, areas: int, bins: int, clip: float) -> list[float]:
    """Section III of the paper, one pixel after the other."""
    r_a = (RING.r_max_px - RING.r_min_px) / 6.0
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), r_a / 3.0, borderType=cv2.BORDER_REPLICATE)
    Ix = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    Iy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    H: list[float] = []
    for area in range(areas):
        distance = RING.r_min_px + r_a + area * (2.0 * r_a if areas == 3 else r_a)
        u0, v0 = cu + distance * math.cos(theta), cv - distance * math.sin(theta)
        left, right = [0.0] * bins, [0.0] * bins
        for v in range(math.floor(v0 - r_a), math.ceil(v0 + r_a) + 1):
            for u in range(math.floor(u0 - r_a), math.ceil(u0 + r_a) + 1):
                if math.hypot(u - u0, v - v0) > r_a or not (0 <= u < grey.shape[1] and 0 <= v < grey.shape[0]):
                    continue
                x, y = u - u0, -(v - v0)
                m = math.hypot(Ix[v, u], Iy[v, u])
                phi = math.atan2(-Iy[v, u], Ix[v, u]) - theta
                while phi <= -math.pi:
                    phi += 2.0 * math.pi
                while phi > math.pi:
                    phi -= 2.0 * math.pi
                b = math.floor(bins * phi / (2.0 * math.pi))
                w = bins * phi / (2.0 * math.pi) - b
                part = left if math.cos(theta) * y - math.sin(theta) * x >= 0.0 else right
                part[b % bins] += m * (1.0 - w)
                part[(b + 1) % bins] += m * w
        values = left + right
        for limit in (clip, math.inf):
            norm = math.sqrt(sum(x * x for x in values))
            values = [min(x / norm, limit) for x in values] if norm > 0.0 else values
        H += values
    return H


@pytest.mark.parametrize(("areas", "bins", "clip"), [(3, 32, 0.1), (5, 16, 0.2), (3, 8, 1.0)])
def test_every_number_is_the_literal_ones(textured: Grey, areas: int, bins: int, clip: float) -> None:
    center = (320.3, 240.8)
    vision = Vision.model_validate({"mode": "paper", "areas": areas, "bins": bins, "clip": clip})
    fast = descriptors(textured, center, ANGLES, RING, vision)
    slow = np.array([_literal(textured, *center, theta, areas, bins, clip) for theta in ANGLES])
    assert fast.shape == (ANGLES.size, areas * 2 * bins)
    # A pixel that lies on the radial line itself may fall to either side by rounding; one vote is about 1e-3.
    assert np.max(np.abs(fast - slow)) < 5e-3
    assert np.mean(np.abs(fast - slow)) < 1e-5


def test_the_papers_descriptor_has_192_numbers_of_length_root_three(textured: Grey) -> None:
    for mode in ("paper", "default"):
        H = descriptors(textured, (321.5, 239.0), ANGLES, RING, Vision.model_validate({"mode": mode}))
        assert H.shape == (ANGLES.size, 192)
        assert np.allclose(np.linalg.norm(H, axis=1), np.sqrt(3.0), atol=1e-5)
        assert np.all(H >= 0.0)


def test_a_flat_picture_gives_zeros_not_nan() -> None:
    flat = np.full((480, 640), 128, dtype=np.uint8)
    for mode in ("paper", "default"):
        H = descriptors(flat, (321.5, 239.0), ANGLES, RING, Vision.model_validate({"mode": mode}))
        assert np.all(H == 0.0)


@pytest.mark.parametrize("mode", ["paper", "default"])
@pytest.mark.parametrize("center", [(5.0, 5.0), (-300.0, 240.0), (1e4, 1e4)])
def test_areas_outside_the_picture_do_no_harm(textured: Grey, mode: str, center: tuple[float, float]) -> None:
    H = descriptors(textured, center, ANGLES, RING, Vision.model_validate({"mode": mode}))
    assert np.all(np.isfinite(H))


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_the_descriptor_turns_with_the_picture(textured: Grey, mode: str) -> None:
    vision = Vision.model_validate({"mode": mode})
    center = (321.5, 239.0)
    before = descriptors(textured, center, ANGLES, RING, vision)
    for turn in (0.3, np.pi / 2.0, -2.0):
        matrix = cv2.getRotationMatrix2D(center, np.rad2deg(turn), 1.0)
        turned = cv2.warpAffine(textured, matrix, (640, 480), flags=cv2.INTER_CUBIC).astype(np.uint8)
        after = descriptors(turned, center, wrap(ANGLES + turn), RING, vision)
        assert np.all(np.linalg.norm(after - before, axis=1) < 0.35)
        other = distances(before, after) + 10.0 * np.eye(ANGLES.size)
        assert np.min(other) > 0.6


def test_the_fast_samples_stay_close_to_the_papers(textured: Grey) -> None:
    angles = np.linspace(-3.0, 3.0, 60)
    exact = descriptors(textured, (321.5, 239.0), angles, RING, Vision(mode="paper"))
    fast = descriptors(textured, (321.5, 239.0), angles, RING, Vision())
    assert np.max(np.linalg.norm(exact - fast, axis=1)) < 0.4  # of other lines: about 1.2


def test_the_fast_descriptor_matches_nearly_as_well_as_the_papers(shared_data: Path) -> None:
    folder = shared_data / "corridor"
    truth = np.loadtxt(folder / "truth/lines.csv", delimiter=",", skiprows=1)
    centers = np.loadtxt(folder / "truth/centers.csv", delimiter=",", skiprows=1)[:, 1:]
    wrong, right = {"paper": 0, "default": 0}, {"paper": 0, "default": 0}
    before: tuple[dict[str, NDArray[np.float32]], Lines, int] | None = None
    for index in (0, 1, 2, 70, 71, 72, 73, 110, 111):
        data = np.fromfile(folder / f"frames/{index:06d}.jpg", dtype=np.uint8)
        grey = grey_from_frame(Frame(0, PixelFormat.JPEG, 640, 480, data))
        center = (float(centers[index, 0]), float(centers[index, 1]))
        lines = lines_from_edges(thinned_edges(grey, everywhere(grey), 30.0), center, 0.02, RING, Vision())
        H = {m: descriptors(grey, center, lines.angle_rad, RING, Vision.model_validate({"mode": m})) for m in wrong}
        if before is not None and before[2] == index - 1:
            for mode in wrong:
                match = matches(distances(before[0][mode], H[mode]), 1.05, 0.75, 0.8)
                pair = np.flatnonzero(match >= 0)
                good = _same_line(truth, index, before[1].angle_rad[pair], lines.angle_rad[match[pair]])
                right[mode] += int(np.sum(good))
                wrong[mode] += int(np.sum(~good))
        before = (H, lines, index)
    assert right["paper"] > 150
    assert right["default"] > 0.97 * right["paper"]
    share = {mode: wrong[mode] / (wrong[mode] + right[mode]) for mode in wrong}
    assert share["default"] < share["paper"] + 0.015


def _same_line(
    truth: NDArray[np.float64], index: int, before: NDArray[np.float64], now: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether one true edge lies at both angles, within 0.7 deg, in frame index - 1 and in frame index."""
    near = np.deg2rad(0.7)
    first, second = truth[truth[:, 0] == index - 1], truth[truth[:, 0] == index]
    _, i, j = np.intersect1d(first[:, 1], second[:, 1], return_indices=True)
    at_first = np.abs(wrap(before[:, None] - first[i, 3])) < near
    at_second = np.abs(wrap(now[:, None] - second[j, 3])) < near
    return np.asarray(np.any(at_first & at_second, axis=1))
