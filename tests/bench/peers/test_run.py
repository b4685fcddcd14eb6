"""The peers' own parts: radial segments, their merging, and identities by descriptors alone."""

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.bench.peers.run import (
    LOOKBACK,
    Matcher,
    Ring,
    Segments,
    cropped,
    merged,
    on_radial_edges,
    radial_segments,
)

RING = Ring(320.0, 240.0, 60.0, 220.0)


def segment(angle_deg: float, start_px: float, end_px: float, tilt_deg: float = 0.0) -> Any:
    """A segment about its middle at this image angle, tilted against the direction to the centre."""
    a, t = np.deg2rad(angle_deg), np.deg2rad(angle_deg + tilt_deg)
    middle, half = 0.5 * (start_px + end_px), 0.5 * (end_px - start_px)
    u, v = RING.u_px + middle * np.cos(a), RING.v_px - middle * np.sin(a)
    return SimpleNamespace(
        startPointX=u - half * np.cos(t),
        startPointY=v + half * np.sin(t),
        endPointX=u + half * np.cos(t),
        endPointY=v - half * np.sin(t),
    )


@pytest.fixture
def half_bright() -> NDArray[np.uint8]:
    """Bright above the ring's centre, dark below: one edge to the right, one to the left."""
    grey = np.zeros((480, 640), dtype=np.uint8)
    grey[:240] = 200
    return grey


def test_only_radial_segments_inside_the_ring_stay(half_bright: NDArray[np.uint8]) -> None:
    given = [segment(10, 100, 160), segment(20, 100, 160, 19), segment(30, 100, 160, 21), segment(40, 10, 50)]
    given += [segment(50, 225, 300), segment(60, 160, 100)]
    found = radial_segments(given, half_bright, RING)
    assert np.rad2deg(found.angle_rad) == pytest.approx([10, 20, 60])
    assert found.length_px == pytest.approx([60, 60, 60])


def test_polarity_is_the_step_counter_clockwise(half_bright: NDArray[np.uint8]) -> None:
    found = radial_segments([segment(0.2, 100, 160), segment(179.8, 100, 160)], half_bright, RING)
    assert found.polarity.tolist() == [1, -1]


def test_pieces_of_one_line_are_one_and_short_lines_none() -> None:
    angle = np.deg2rad([10.0, 10.2, 10.1, 30.0, 30.1, 50.0])
    length = np.array([40.0, 20.0, 20.0, 30.0, 25.0, 15.0])
    polarity = np.array([1, 1, -1, 1, 1, 1])
    found = merged(Segments(angle, length, polarity, list("abcdef")), 18.0, np.deg2rad(0.35))
    assert found.key_line == ["a", "d", "c"]
    assert np.rad2deg(found.angle_rad) == pytest.approx([10.0 + 0.2 / 3, 30.0 + 0.1 * 25 / 55, 10.1])
    assert found.length_px == pytest.approx([60.0, 55.0, 20.0])


def test_pieces_are_merged_across_the_cut_at_pi() -> None:
    angle = np.array([np.pi - 0.001, -np.pi + 0.001])
    found = merged(Segments(angle, np.array([50.0, 40.0]), np.array([1, 1]), ["a", "b"]), 60.0, 0.006)
    assert found.key_line == ["a"]


def test_key_points_stay_where_the_gradient_stands_across_the_radius(half_bright: NDArray[np.uint8]) -> None:
    places = [(450, 240), (200, 240), (320, 100), (400, 100)]
    points = [cv2.KeyPoint(u, v, 7) for u, v in places]
    assert on_radial_edges(points, half_bright, RING).tolist() == [True, True, False, False]


def test_the_box_holds_the_ring_where_it_was(half_bright: NDArray[np.uint8]) -> None:
    half_bright[240, 320] = 77
    part, ring = cropped(half_bright, RING)
    assert part.shape == (458, 458)
    assert part[int(ring.v_px), int(ring.u_px)] == 77


def descriptors(count: int, seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).normal(size=(count, 16)).astype(np.float32)


def test_the_same_descriptors_keep_their_tracks_in_any_order() -> None:
    matcher, given = Matcher(cv2.NORM_L2, 0.9, 1.0), descriptors(12)
    first = matcher.step(given)
    order = np.random.default_rng(1).permutation(12)
    assert matcher.step(given[order]).tolist() == first[order].tolist()


def test_what_is_too_far_or_ambiguous_is_new() -> None:
    matcher, given = Matcher(cv2.NORM_L2, 0.9, 0.5), descriptors(3)
    matcher.step(given)
    assert matcher.step(given + 0.5).tolist() == [3, 4, 5]
    twins = Matcher(cv2.NORM_L2, 0.9, 9.0)
    twins.step(np.concatenate((given[:1], given[:1] + 1e-4)))
    assert twins.step(given[:1] + 5e-5).tolist() == [2]


@pytest.mark.parametrize(("away", "again"), [(1, True), (LOOKBACK - 1, True), (LOOKBACK, False)])
def test_what_was_lost_is_known_again_for_20_frames(away: int, again: bool) -> None:
    matcher, given = Matcher(cv2.NORM_L2, 0.9, 1.0), descriptors(4)
    matcher.step(given)
    for _ in range(away):
        matcher.step(given[:3])
    assert (int(matcher.step(given)[3]) == 3) == again


def test_a_frame_without_features_loses_nothing() -> None:
    matcher, given = Matcher(cv2.NORM_L2, 0.9, 1.0), descriptors(4)
    first = matcher.step(given)
    assert matcher.step(np.empty((0, 16), dtype=np.float32)).size == 0
    assert matcher.step(given).tolist() == first.tolist()
