"""The first look for where lines meet, in painted pictures whose lines meet in a known point."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.config import MirrorRing
from omnivert.vision.edges import Band, Edges, thinned_edges
from omnivert.vision.meeting import sharpest_point

Grey = NDArray[np.uint8]
Scene = Callable[..., Grey]

CENTER = (321.5, 239.0)
RING = MirrorRing(center_px=CENTER)
TOLERANCE_DEG = 20.0
SEEDS = pytest.mark.parametrize("seed", range(3))


def _edges(scene: Scene, meeting: tuple[float, float], seed: int, lines: int = 40) -> Edges:
    """Straight lines about the point, of all directions, seen in the ring."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(-3.1, 3.1, lines))
    level = 130.0 + np.where(np.arange(lines) % 2, 0.5, -0.5) * rng.uniform(40.0, 120.0, lines)
    about = (CENTER[0] + meeting[0], CENTER[1] + meeting[1])
    picture = scene(angle, level, center=about, r_min=1.0, r_max=400.0, noise=2.0, seed=seed)
    v, u = np.mgrid[:480, :640]
    away = np.hypot(u - CENTER[0], v - CENTER[1])
    picture[(away < RING.r_min_px) | (away > RING.r_max_px)] = 0
    return thinned_edges(picture, Band(*CENTER, 60.0, 228.0), 32.0)


@SEEDS
@pytest.mark.parametrize("meeting", [(5.0, 4.0), (-8.0, 6.0), (-9.0, -9.0), (0.0, 12.0), (7.0, -3.0)])
def test_the_point_is_found_within_a_pixel(scene: Scene, meeting: tuple[float, float], seed: int) -> None:
    u, v = sharpest_point(_edges(scene, meeting, seed), CENTER, RING, TOLERANCE_DEG)
    assert np.hypot(u - meeting[0], v - meeting[1]) < 1.0  # px; measured 0.76 at most


@SEEDS
@pytest.mark.parametrize("meeting", [(20.0, -25.0), (-40.0, 10.0), (0.0, 50.0)])
def test_far_off_where_a_tilt_is_no_longer_small_the_point_is_near(
    scene: Scene, meeting: tuple[float, float], seed: int
) -> None:
    """As near as the lines can be followed from: to the first order, a line turns by slant (1 / r - 1 / h)."""
    u, v = sharpest_point(_edges(scene, meeting, seed), CENTER, RING, TOLERANCE_DEG)
    assert np.hypot(u - meeting[0], v - meeting[1]) < 8.0  # px; measured 5.9 at most


@SEEDS
@pytest.mark.parametrize("lines", [2, 8, 40])
def test_lines_that_meet_at_the_centre_leave_the_point_there(scene: Scene, lines: int, seed: int) -> None:
    assert sharpest_point(_edges(scene, (0.0, 0.0), seed, lines), CENTER, RING, TOLERANCE_DEG) == (0.0, 0.0)


@pytest.mark.parametrize("meeting", [(0.3, -0.2), (-0.7, 0.5)])
def test_a_point_that_is_hardly_off_is_left_to_the_frames_that_follow(
    scene: Scene, meeting: tuple[float, float]
) -> None:
    assert sharpest_point(_edges(scene, meeting, 0), CENTER, RING, TOLERANCE_DEG) == (0.0, 0.0)


def test_edges_that_meet_nowhere_leave_the_point_at_the_centre(textured: Grey) -> None:
    edges = thinned_edges(textured, Band(*CENTER, 60.0, 220.0), 32.0)
    assert edges.u_px.size > 1000
    assert sharpest_point(edges, CENTER, RING, TOLERANCE_DEG) == (0.0, 0.0)
