"""A rim that is not round, as a camera shows it that does not look along the mirror's axis: painted, fitted, learnt."""

from copy import deepcopy

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Edges, everywhere, thinned_edges
from omnivert.vision.rim import Circle, circle_near, configured_shape
from omnivert.vision.ring import RingFinder, RingFound

Float = NDArray[np.float64]
Grey = NDArray[np.uint8]

RADIUS = 222.0
CENTER = (321.3, 239.4)
EXPECTED = (320.0, 240.0)
SIZE = (480, 640)
LEVELS = np.array([150.0, 90.0, 210.0, 120.0])  # of the four quarters of the mirror; all beyond the rim is black
LEARNT_FRAMES = 30


def _around(center: tuple[float, float]) -> tuple[Float, Float]:
    v, u = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    return u - center[0], v - center[1]


def _filled(share: Float, angle: Float, noise: float, seed: int) -> Grey:
    """share  of each pixel that lies inside the rim"""
    quarter = ((angle / TURN + 0.5) * LEVELS.size).astype(int) % LEVELS.size
    picture = LEVELS[quarter] * share + np.random.default_rng(seed).normal(0.0, noise, share.shape)
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)


def _ellipse(center: tuple[float, float], longer: float, way: float, seed: int) -> Grey:
    """Half axes RADIUS + longer, along `way` from u towards v, and RADIUS - longer; from the equation of an ellipse."""
    x, y = _around(center)
    p, q = np.cos(way) * x + np.sin(way) * y, np.cos(way) * y - np.sin(way) * x
    a, b = RADIUS + longer, RADIUS - longer
    level = np.hypot(p / a, q / b)
    slope = np.hypot(p / a**2, q / b**2) / np.maximum(level, 1e-9)
    return _filled(np.clip((1.0 - level) / slope + 0.5, 0.0, 1.0), np.arctan2(y, x), 2.0, seed)


def _dented(seed: int, cover: float | None = None) -> Grey:
    """An ellipse that is not a perfect one, as no rim is; a third of it covered around the angle `cover`."""
    x, y = _around(CENTER)
    angle = np.arctan2(y, x)
    rim = RADIUS + 3.0 * np.cos(2.0 * angle) - 2.0 * np.sin(2.0 * angle)
    rim += 0.4 * np.cos(3.0 * angle + 0.3) + 0.4 * np.cos(7.0 * angle + 1.0)
    picture = _filled(np.clip(rim - np.hypot(x, y) + 0.5, 0.0, 1.0), angle, 2.0, seed)
    if cover is not None:
        picture[np.abs(wrap(angle - cover)) < TURN / 6.0] = 100
    return picture


def _edges(picture: Grey) -> Edges:
    return thinned_edges(picture, everywhere(picture), 30.0)


def _off(circle: Circle, center: tuple[float, float]) -> float:
    return float(np.hypot(circle.u_px - center[0], circle.v_px - center[1]))


@pytest.mark.parametrize("seed", range(6))
def test_an_ellipse_is_fitted_with_its_centre_and_its_shape(seed: int) -> None:
    """At angle a the ellipse's radius is RADIUS - 3/4 d^2 / RADIUS + d cos 2 (a - way), to second order in d."""
    rng = np.random.default_rng(seed)
    center = (320.0 + rng.uniform(-3.0, 3.0), 240.0 + rng.uniform(-3.0, 3.0))
    longer, way = rng.uniform(1.0, 4.0), rng.uniform(0.0, np.pi)
    circle = circle_near(_edges(_ellipse(center, longer, way, seed)), EXPECTED, configured_shape(225.0), 20.0)
    assert circle is not None
    assert _off(circle, center) < 0.05
    assert circle.quality > 0.95
    assert abs(circle.radius_px - (RADIUS - 0.75 * longer**2 / RADIUS)) < 0.02
    # Around the whole rim, cos 2a and sin 2a are known as well as the centre, which is cos a and sin a.
    assert circle.std_px < 0.02
    assert abs(circle.even_px - longer * np.cos(2.0 * way)) < 2.0 * circle.std_px
    assert abs(circle.odd_px - longer * np.sin(2.0 * way)) < 2.0 * circle.std_px


def _found(finder: RingFinder, picture: Grey) -> RingFound:
    edges = _edges(picture)
    found = finder.step(edges, lambda _: edges)
    assert found is not None
    assert found.reason == ""
    return found


def _finder() -> RingFinder:
    return RingFinder(MirrorRing(r_min_px=63.0, r_max_px=RADIUS, center_px=EXPECTED), Vision())


@pytest.fixture(scope="module")
def taught() -> RingFinder:
    """Has seen the whole rim for a while."""
    finder = _finder()
    for seed in range(LEARNT_FRAMES):
        assert _off(_found(finder, _dented(seed)).circle, CENTER) < 0.1
    return finder


@pytest.mark.parametrize("cover", [0.0, 0.8, 1.5, -1.0])
def test_a_shape_once_learnt_holds_the_centre_when_a_third_of_the_rim_is_covered(
    taught: RingFinder, cover: float
) -> None:
    """Dents of 0.4 px pull at a centre whose rim may have any shape: three to nine times as far."""
    picture = _dented(1000, cover)
    with_shape = _found(deepcopy(taught), picture).circle
    without = _found(_finder(), picture).circle
    for circle in (with_shape, without):
        assert 0.55 < circle.quality < 0.75
    assert _off(with_shape, CENTER) < 0.3  # measured 0.08 .. 0.23
    assert _off(without, CENTER) > 0.4  # measured 0.56 .. 1.6


def test_a_covered_rim_unlearns_nothing(taught: RingFinder) -> None:
    """As when somebody stands before the mirror for a while."""
    finder = deepcopy(taught)
    for seed in range(10):
        covered = _found(finder, _dented(2000 + seed, 0.8)).circle
    assert _off(covered, CENTER) < 0.3
    assert _off(_found(finder, _dented(3000)).circle, CENTER) < 0.1
