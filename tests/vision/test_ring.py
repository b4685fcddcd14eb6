from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Band, Edges, everywhere, thinned_edges
from omnivert.vision.rim import circle_anywhere, circle_near, configured_shape
from omnivert.vision.ring import RingFinder

Grey = NDArray[np.uint8]
Scene = Callable[..., Grey]

ANGLES = np.array([-2.0, 0.3, 1.7])
LEVELS = np.array([160.0, 90.0, 220.0])


def _edges(picture: Grey) -> Edges:
    return thinned_edges(picture, everywhere(picture), 30.0)


def _never(_: Band | None) -> Edges:
    raise AssertionError("looked everywhere for a ring that was where it was expected")


@settings(max_examples=15, deadline=None)
@given(u=st.floats(-12.0, 12.0), v=st.floats(-12.0, 12.0), radius=st.floats(90.0, 140.0))
def test_the_centre_is_found_below_the_pixel_wherever_it_is(scene: Scene, u: float, v: float, radius: float) -> None:
    center = (200.0 + u, 170.0 + v)
    picture = scene(ANGLES, LEVELS, center=center, r_min=40.0, r_max=radius, size=(400, 340), noise=2.0)
    circle = circle_near(_edges(picture), (200.0, 170.0), configured_shape(radius), 15.0)
    assert circle is not None
    assert np.hypot(circle.u_px - center[0], circle.v_px - center[1]) < 0.1
    assert abs(circle.radius_px - radius) < 0.1
    assert circle.quality > 0.9


def test_a_third_of_the_rim_covered_moves_the_centre_by_less_than_a_third_of_a_pixel(scene: Scene) -> None:
    picture = scene(ANGLES, LEVELS, noise=2.0)
    v, u = np.mgrid[:480, :640]
    picture[np.abs(np.arctan2(v - 239.0, u - 321.5)) < np.pi / 3.0] = 100
    circle = circle_near(_edges(picture), (325.0, 235.0), configured_shape(225.0), 20.0)
    assert circle is not None
    assert np.hypot(circle.u_px - 321.5, circle.v_px - 239.0) < 0.3
    assert 0.55 < circle.quality < 0.75


def test_a_rim_cropped_by_the_picture_on_two_sides_is_found(scene: Scene) -> None:
    picture = scene(ANGLES, LEVELS, noise=2.0)[60:420]
    circle = circle_near(_edges(picture), (320.0, 180.0), configured_shape(225.0), 20.0)
    assert circle is not None
    assert np.hypot(circle.u_px - 321.5, circle.v_px - 179.0) < 0.2


def test_a_radius_known_only_to_two_pixels_does_not_move_the_centre(scene: Scene) -> None:
    circle = circle_near(_edges(scene(ANGLES, LEVELS)), (320.0, 240.0), configured_shape(223.0), 20.0)
    assert circle is not None
    assert np.hypot(circle.u_px - 321.5, circle.v_px - 239.0) < 0.1
    assert abs(circle.radius_px - 225.0) < 0.2


def test_to_the_pixel_as_the_paper_has_it(scene: Scene) -> None:
    circle = circle_near(
        _edges(scene(ANGLES, LEVELS, center=(324.0, 236.0))),
        (321.0, 239.0),
        configured_shape(225.0),
        20.0,
        refine=False,
    )
    assert circle is not None
    assert circle[:3] == (324.0, 236.0, 225.0)


@pytest.mark.parametrize("center", [(110.0, 300.0), (560.0, 120.0), (20.0, 240.0)])
def test_a_lost_ring_is_found_all_over_the_picture(scene: Scene, center: tuple[float, float]) -> None:
    picture = scene(ANGLES, LEVELS, center=center, r_min=30.0, r_max=110.0, noise=2.0)
    circle = circle_anywhere(_edges(picture), configured_shape(110.0))
    assert circle is not None
    assert np.hypot(circle.u_px - center[0], circle.v_px - center[1]) < 0.3


def test_noise_shows_no_rim(textured: Grey) -> None:
    noise = np.random.default_rng(2).integers(0, 256, (480, 640), dtype=np.uint8)
    for picture in (noise, textured[100:380, 180:460]):
        near = circle_near(_edges(picture), (picture.shape[1] / 2, picture.shape[0] / 2), configured_shape(150.0), 20.0)
        anywhere = circle_anywhere(_edges(picture), configured_shape(150.0))
        for circle in (near, anywhere):
            assert circle is None or circle.quality < Vision().ring_min_quality


def test_the_finder_follows_holds_lets_go_and_finds_again(scene: Scene) -> None:
    vision = Vision(lookback_frames=3)
    finder = RingFinder(MirrorRing(r_min_px=40.0, r_max_px=110.0, center_px=(200.0, 200.0)), vision)
    nothing = _edges(np.zeros((480, 640), dtype=np.uint8))

    def seen(u: float, v: float) -> Edges:
        return _edges(scene(ANGLES, LEVELS, center=(u, v), r_min=40.0, r_max=110.0))

    found = finder.step(seen(205.0, 203.0), _never)
    assert found is not None
    assert found.reason == ""
    assert abs(found.circle.u_px - 205.0) < 0.1
    stds = []
    for _ in range(3):
        held = finder.step(nothing, lambda _: nothing)
        assert held is not None
        assert held.reason
        assert held.circle[:3] == found.circle[:3]
        stds.append(held.circle.std_px)
    assert found.circle.std_px < stds[0] < stds[1] < stds[2]
    assert finder.step(nothing, lambda _: nothing) is None
    far = seen(400.0, 300.0)
    again = finder.step(far, lambda _: far)
    assert again is not None
    assert again.reason == ""
    assert abs(again.circle.u_px - 400.0) < 0.1
    assert finder.band(None, 20.0)[:2] == again.circle[:2]


def test_a_ring_that_never_was_there_is_nothing_to_hold() -> None:
    nothing = _edges(np.zeros((480, 640), dtype=np.uint8))
    assert RingFinder(MirrorRing(), Vision()).step(nothing, lambda _: nothing) is None
