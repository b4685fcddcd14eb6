"""The unwrapped panorama and the lines' patches, on pictures whose every grey value is known."""

from collections.abc import Callable
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.config import Config, Dissimilarity, MirrorRing, Vision
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.descriptor import descriptors
from omnivert.vision.dissimilarity import ssd, zncc
from omnivert.vision.frontend import FrontEnd, Work
from omnivert.vision.matching import distances
from omnivert.vision.panorama import line_rows, panorama, patches, rectangles, similarity_matrix

Scene = Callable[..., NDArray[np.uint8]]
Float = NDArray[np.float64]
Rows = NDArray[np.float32]

SIZES = [(160, 120), (320, 240), (640, 480), (1280, 960), (500, 1000)]
EDGES = np.array([-2.6, -1.1, 0.4, 2.2])
LEVELS = np.array([60.0, 200.0, 90.0, 160.0])


def _ring(width: int, height: int) -> MirrorRing:
    r_max = 0.46 * min(width, height)
    return MirrorRing(center_px=(width / 2 - 0.3, height / 2 + 0.7), r_min_px=0.3 * r_max, r_max_px=r_max)


def _blurred_noise(seed: int, width: int, height: int, sigma: float = 3.0) -> NDArray[np.uint8]:
    rough = cv2.GaussianBlur(np.random.default_rng(seed).uniform(0.0, 255.0, (height, width)), (0, 0), sigma)
    scaled = np.interp(rough, (rough.min(), rough.max()), (20.0, 235.0))
    return np.asarray(np.rint(scaled), dtype=np.uint8)


def _of_angle(grey: Callable[[Float, Float], Float], ring: MirrorRing, width: int, height: int) -> NDArray[np.uint8]:
    """The picture whose grey value is a function of image angle and radius."""
    v, u = np.mgrid[:height, :width]
    x, y = u - ring.center_px[0], -(v - ring.center_px[1])
    return np.asarray(np.rint(grey(np.arctan2(y, x), np.hypot(x, y))), dtype=np.uint8)


@pytest.mark.parametrize("bearing_sign", [1, -1])
@pytest.mark.parametrize("size", SIZES)
def test_radial_edges_stand_upright_at_their_bearings(scene: Scene, size: tuple[int, int], bearing_sign: int) -> None:
    ring = _ring(*size)
    picture = scene(EDGES, LEVELS, center=ring.center_px, r_min=0.0, r_max=1e9, size=size)
    unrolled = panorama(picture, ring.center_px, ring, 40, 720, bearing_sign)
    assert unrolled.shape == (40, 720)
    assert unrolled.dtype == np.float32
    rows = unrolled.astype(np.float64)
    step = np.abs(np.roll(rows, -3, axis=1) - np.roll(rows, 3, axis=1))  # about each column
    for edge in EDGES:
        right = bearing_sign * edge % TURN / TURN * 720 - 0.5
        near = (np.arange(-12, 13) + round(right)) % 720
        column = np.sum(step[:, near] * np.arange(-12, 13), axis=1) / np.sum(step[:, near], axis=1) + round(right)
        assert np.max(np.abs(column - right)) < 1.0  # in every row: half a degree; a pixel is 1.4 at the least
        assert abs(np.mean(column) - right) < 0.2


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("bearing_sign", [1, -1])
def test_every_cell_is_the_picture_there(size: tuple[int, int], bearing_sign: int) -> None:
    ring = _ring(*size)

    def grey(angle: Float, radius: Float) -> Float:
        return 120.0 + 60.0 * np.sin(angle + 0.7) + 40.0 * (radius - ring.r_min_px) / ring.r_max_px

    unrolled = panorama(_of_angle(grey, ring, *size), ring.center_px, ring, 30, 360, bearing_sign)
    bearing = (np.arange(360) + 0.5) * TURN / 360
    radius = ring.r_min_px + (np.arange(30) + 0.5) * (ring.r_max_px - ring.r_min_px) / 30
    assert np.max(np.abs(unrolled - grey(bearing_sign * bearing[None, :], radius[:, None]))) < 1.0  # rounding


def test_a_coarse_panorama_is_the_mean_of_a_fine_one() -> None:
    ring = _ring(640, 480)
    noise = np.random.default_rng(1).integers(0, 256, (480, 640)).astype(np.uint8)
    fine = panorama(noise, ring.center_px, ring, 160, 1440)
    coarse = panorama(noise, ring.center_px, ring, 16, 144)
    means = fine.reshape(16, 10, 144, 10).mean(axis=(1, 3))
    assert np.std(coarse) < 12.0  # of noise whose sigma is 74
    assert np.corrcoef(coarse.ravel(), means.ravel())[0, 1] > 0.95


def test_the_panorama_closes_on_itself() -> None:
    ring = _ring(640, 480)
    unrolled = panorama(_blurred_noise(2, 640, 480), ring.center_px, ring, 40, 720)
    inner = np.abs(np.diff(unrolled, axis=1)).mean(axis=0)
    seam = np.abs(unrolled[:, 0] - unrolled[:, -1]).mean()
    assert seam < 2.0 * inner.mean()


@pytest.mark.parametrize("center", [(20.0, 240.0), (630.0, 470.0), (-150.0, 240.0), (320.0, -2000.0)])
def test_a_ring_that_leaves_the_picture_still_gives_numbers(center: tuple[float, float]) -> None:
    ring, picture = _ring(640, 480), _blurred_noise(3, 640, 480, sigma=12.0)
    unrolled = panorama(picture, center, ring, 40, 360)
    angle = (np.arange(360) + 0.5) * TURN / 360
    radius = ring.r_max_px - (ring.r_max_px - ring.r_min_px) / 80
    u, v = center[0] + radius * np.cos(angle), center[1] - radius * np.sin(angle)
    inside = (u > 0) & (u < 639) & (v > 0) & (v < 479)
    assert np.all((unrolled >= picture.min()) & (unrolled <= picture.max()))
    at = picture[np.clip(np.rint(v), 0, 479).astype(int), np.clip(np.rint(u), 0, 639).astype(int)]
    assert np.max(np.abs(unrolled[-1] - at)[inside], initial=0.0) < 6.0  # up to a pixel apart


@settings(max_examples=20)
@given(turn=st.floats(-10.0, 10.0))
def test_patches_turn_with_the_picture(turn: float) -> None:
    ring = _ring(640, 480)

    def picture(by: float) -> NDArray[np.uint8]:
        def grey(angle: Float, radius: Float) -> Float:
            return 128.0 + 50.0 * np.sin(3.0 * (angle - by)) + 30.0 * np.cos(7.0 * (angle - by) + radius / 40.0)

        return _of_angle(grey, ring, 640, 480)

    before = patches(picture(0.0), ring.center_px, EDGES, ring, Vision())
    after = patches(picture(turn), ring.center_px, wrap(EDGES + turn), ring, Vision())
    assert np.max(np.abs(before - after)) < 6.0
    assert np.max(zncc(before, after).diagonal()) < 2e-3


@pytest.mark.parametrize("angle", [0.0, np.pi, -np.pi / 2, 1e-9, -1e-9, TURN - 1e-9, 5.0 * TURN])
def test_a_line_has_one_patch_whatever_its_turn_and_wherever_the_seam_lies(angle: float) -> None:
    ring, picture = _ring(640, 480), _blurred_noise(4, 640, 480)
    angles = np.array([angle, angle + TURN, angle - TURN, angle + 1e-6])
    P = patches(picture, ring.center_px, angles, ring, Vision())
    assert np.allclose(P, P[0], atol=1e-2)


def test_the_line_is_in_the_middle_of_its_patch_two_areas_wide(scene: Scene) -> None:
    ring = MirrorRing()
    r_a, middle = (ring.r_max_px - ring.r_min_px) / 6.0, (ring.r_max_px + ring.r_min_px) / 2.0
    edges = np.array([-0.9, 0.3, 0.3 + 0.8 * r_a / middle])  # the last at 9/10 of the second's patch
    picture = scene(edges, np.array([50.0, 100.0, 200.0]), center=ring.center_px, r_min=0.0, r_max=1e9)
    profile = rectangles(picture, ring.center_px, edges[1:2], ring, 100, 30).reshape(30, 100).mean(axis=0)
    assert np.max(np.abs(profile[:46] - 50.0)) < 1.0
    assert np.max(np.abs(profile[54:86] - 100.0)) < 1.0
    assert np.max(np.abs(profile[94:] - 200.0)) < 1.0
    assert abs(profile[50] + profile[49] - 150.0) < 5.0


@pytest.mark.parametrize("slant", [-15.0, 15.0])
def test_a_patch_leans_with_its_line(slant: float) -> None:
    ring = _ring(640, 480)
    upright = 0.4

    def grey(angle: Float, radius: Float) -> Float:
        at = upright + slant * (1.0 / np.maximum(radius, 1.0) - 1.0 / ring.horizon)
        return 128.0 + 100.0 * np.tanh(wrap(angle - at) * radius / 3.0)

    picture = _of_angle(grey, ring, 640, 480)
    P = rectangles(picture, ring.center_px, np.array([upright]), ring, 40, 40, np.array([slant])).reshape(40, 40)
    assert np.all((P[:, 18] < 128.0) & (P[:, 21] > 128.0))  # in every row the edge is in the middle
    straight = rectangles(picture, ring.center_px, np.array([upright]), ring, 40, 40).reshape(40, 40)
    assert np.all(straight[:2, 18:22] > 128.0) != np.all(straight[:2, 18:22] < 128.0)  # which takes leaning


@pytest.mark.parametrize(("areas", "bins"), [(3, 8), (3, 16), (3, 32), (5, 8), (5, 16), (5, 32)])
@pytest.mark.parametrize("size", SIZES[:3])
def test_a_patch_has_as_many_numbers_as_a_descriptor(size: tuple[int, int], areas: int, bins: int) -> None:
    ring, picture = _ring(*size), _blurred_noise(5, *size)
    vision = Vision.model_validate({"areas": areas, "bins": bins})
    for angle in (EDGES, np.empty(0)):
        P = patches(picture, ring.center_px, angle, ring, vision)
        assert P.shape == descriptors(picture, ring.center_px, angle, ring, vision).shape
        assert P.dtype == np.float32
        assert P.flags.c_contiguous


@given(gain=st.floats(0.3, 1.0), offset=st.floats(0.0, 50.0))
def test_light_moves_ssd_but_not_zncc(gain: float, offset: float) -> None:
    ring, picture = _ring(320, 240), _blurred_noise(6, 320, 240)
    lit = np.rint(gain * 0.75 * picture + offset).astype(np.uint8)
    P, Q = (patches(p, ring.center_px, EDGES, ring, Vision()) for p in (picture, lit))
    assert np.max(zncc(P, Q).diagonal()) < 1e-3
    assert np.all(ssd(P, P).diagonal() == 0.0)
    assert np.all(np.argmin(zncc(P, Q), axis=1) == np.arange(EDGES.size))
    assert np.allclose(ssd(P, Q).diagonal(), np.sum((P - (gain * 0.75 * P + offset)) ** 2, axis=1), rtol=0.1, atol=200)


@pytest.mark.parametrize("kind", ["l2", "l1", "jeffrey", "ssd", "zncc"])
def test_the_dissimilarity_chooses_the_rows_that_lines_are_compared_by(kind: Dissimilarity) -> None:
    ring, picture = _ring(320, 240), _blurred_noise(7, 320, 240)
    vision = Vision(dissimilarity=kind)
    rows = patches if kind in ("ssd", "zncc") else descriptors
    for slant in (None, np.array([0.0, 3.0, -9.0, 20.0])):
        given_rows = line_rows(picture, ring.center_px, EDGES, ring, vision, slant)
        assert np.array_equal(given_rows, rows(picture, ring.center_px, EDGES, ring, vision, slant))


@pytest.mark.parametrize("kind", ["l2", "ssd", "zncc"])
def test_a_similarity_matrix_is_symmetric_with_a_dark_diagonal(kind: Dissimilarity) -> None:
    ring, picture = _ring(320, 240), _blurred_noise(8, 320, 240)
    S = similarity_matrix(picture, ring.center_px, ring, Vision(mode="paper", dissimilarity=kind))
    assert S.shape == (360, 360)
    assert np.allclose(S, S.T, rtol=1e-12, atol=1e-12)
    assert np.max(np.abs(S.diagonal())) < 1e-12
    neighbours = S[np.arange(360), (np.arange(360) + 1) % 360]  # round the end, too
    far = S[np.arange(360), (np.arange(360) + 90) % 360]
    assert np.max(neighbours) < 0.5 * np.min(far)


def test_a_similarity_matrix_begins_at_one_degree() -> None:
    ring, picture = _ring(320, 240), _blurred_noise(9, 320, 240)
    vision = Vision(mode="paper")
    two = descriptors(picture, ring.center_px, np.deg2rad([1.0, 91.0]), ring, vision)
    S = similarity_matrix(picture, ring.center_px, ring, vision)
    assert S[0, 90] == pytest.approx(np.linalg.norm(two[0] - two[1]), abs=1e-5)


def test_the_largest_ring_that_can_be_set_needs_no_more_than_its_cells_do() -> None:
    ring = MirrorRing(r_min_px=5000.0, r_max_px=1e4)
    assert panorama(np.full((48, 64), 7, dtype=np.uint8), (32.0, 24.0), ring, 24, 134).tolist() == [[7.0] * 134] * 24


@pytest.fixture(scope="module")
def frames(shared_data: Path) -> list[Frame]:
    """On the straight and on the spot."""
    names = [shared_data / f"corridor/frames/{k:06d}.jpg" for k in (*range(12), *range(70, 90))]
    return [Frame(k, PixelFormat.JPEG, 640, 480, np.fromfile(path, dtype=np.uint8)) for k, path in enumerate(names)]


def test_the_same_line_is_equally_far_from_itself_by_every_distance(frames: list[Frame]) -> None:
    """Over consecutive frames of the corridor, as `matching` says of it: the median is that of l2."""
    config = Config()
    front = FrontEnd(config)
    before: dict[Dissimilarity, Rows] = {}
    then: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    found: dict[Dissimilarity, list[Float]] = {kind: [] for kind in get_args(Dissimilarity)}
    for frame in frames:
        work = Work(frame)
        for stage in front.stages:
            stage.run(work)
        assert work.grey is not None
        assert work.found is not None
        assert work.tracked is not None
        at, lines = work.tracked.line, work.lines
        now = work.tracked.track_id
        _, i, j = np.intersect1d(then, now, return_indices=True)
        for kind, values in found.items():
            vision = config.vision.model_copy(update={"dissimilarity": kind})
            rows = line_rows(work.grey, work.found.circle[:2], lines.angle_rad[at], config.ring, vision)
            if kind in before:
                values.append(distances(before[kind], rows, kind)[i, j])
            before[kind] = rows
        then = now
    median = {kind: float(np.median(np.concatenate(values))) for kind, values in found.items()}
    assert all(0.8 < value / median["l2"] < 1.25 for value in median.values()), median
