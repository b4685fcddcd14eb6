from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Edges, everywhere, thinned_edges
from omnivert.vision.lines import Lines, lines_from_edges, local_peaks, radial_votes, sector_histogram, strongest

Grey = NDArray[np.uint8]
Scene = Callable[..., Grey]


def _edges(picture: Grey) -> Edges:
    return thinned_edges(picture, everywhere(picture), 30.0)


def _lines(picture: Grey, center: tuple[float, float], ring: MirrorRing, vision: Vision | None = None) -> Lines:
    return lines_from_edges(_edges(picture), center, 0.01, ring, vision or Vision())


@settings(max_examples=25, deadline=None)
@given(
    center=st.tuples(st.floats(120.0, 260.0), st.floats(110.0, 190.0)),
    size=st.sampled_from([(380, 300), (401, 333)]),
    turn=st.floats(-np.pi, np.pi),
    seed=st.integers(0, 1000),
)
def test_every_radial_edge_is_found_at_its_angle_and_nothing_else(
    scene: Scene, center: tuple[float, float], size: tuple[int, int], turn: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    true = np.sort(wrap(turn + np.cumsum(rng.uniform(0.3, 0.6, 10))))
    true = true[np.abs(np.abs(true) - np.pi) > 0.05]
    true = true[: true.size // 2 * 2]  # an even count, so that every step is large
    levels = np.where(np.arange(true.size) % 2, 200.0, 80.0) + rng.uniform(-30.0, 30.0, true.size)
    ring = MirrorRing(center_px=center, r_min_px=30.0, r_max_px=105.0)
    lines = _lines(scene(true, levels, center=center, r_min=30.0, r_max=105.0, size=size, noise=2.0), center, ring)
    step = levels - np.roll(levels, 1)
    assert lines.angle_rad.size == true.size
    assert np.all(np.diff(lines.angle_rad) > 0.0)
    error = wrap(lines.angle_rad - true)
    assert np.max(np.abs(error)) < 3e-3  # a third of a sector
    assert np.array_equal(lines.polarity, np.sign(step))
    assert np.min(lines.strength) > 0.8
    assert np.all(lines.std_rad > 0.0)


def test_the_sigma_from_a_lines_own_points_is_of_the_size_of_the_error(scene: Scene) -> None:
    rng = np.random.default_rng(3)
    ring, vision = MirrorRing(), Vision(bearing_std_deg=1e-6)  # no floor: the points alone
    normalised = []
    for seed in range(6):
        true = np.sort(wrap(rng.uniform(-3.0, 3.0) + np.arange(30.0) * 0.2))
        true = true[np.abs(np.abs(true) - np.pi) > 0.05]
        levels = np.where(np.arange(true.size) % 2, 130.0, 100.0)
        lines = _lines(scene(true, levels, noise=4.0, seed=seed), (321.5, 239.0), ring, vision)
        nearest = true[np.argmin(np.abs(wrap(lines.angle_rad[:, None] - true)), axis=1)]
        normalised.append(wrap(lines.angle_rad - nearest) / lines.std_rad)
    z = np.concatenate(normalised)
    assert z.size > 120
    assert 0.3 < np.sqrt(np.mean(z**2)) < 1.5


def test_the_two_sides_of_a_narrow_bar_are_two_lines(scene: Scene) -> None:
    true = np.array([0.5, 0.516])  # 2.3 px apart in the middle of the ring
    lines = _lines(scene(true, np.array([200.0, 80.0])), (321.5, 239.0), MirrorRing())
    assert lines.angle_rad.size == 2
    assert lines.polarity.tolist() == [1, -1]
    assert np.max(np.abs(lines.angle_rad - true)) < 3e-3


def test_paper_mode_places_lines_in_the_middle_of_their_sectors(scene: Scene) -> None:
    true = np.array([-2.0, -0.7, 0.4, 1.9])
    picture = scene(true, np.array([200.0, 80.0, 180.0, 60.0]))
    lines = _lines(picture, (321.5, 239.0), MirrorRing(), Vision(mode="paper"))
    assert lines.angle_rad.size == 4
    assert np.max(np.abs(lines.angle_rad - true)) < np.deg2rad(0.5)
    middles = (lines.angle_rad + np.pi) / np.deg2rad(0.5)
    assert np.allclose(middles % 1.0, 0.5)


def test_a_line_shorter_than_the_threshold_is_none(scene: Scene) -> None:
    picture = scene(np.array([-1.0, 1.0]), np.array([200.0, 80.0]))
    v, u = np.mgrid[:480, :640]
    picture[(np.hypot(u - 321.5, v - 239.0) > 100.0) & (v < 239.0)] = 128  # only 37 of 162 px stay of the line at 1.0
    ring = MirrorRing()
    long = _lines(picture, (321.5, 239.0), ring, Vision(min_length=0.28, min_length_continued=0.28))
    both = _lines(picture, (321.5, 239.0), ring, Vision(min_length=0.28, min_length_continued=0.15))
    for true, in_long in ((-1.0, True), (1.0, False)):
        assert np.any(np.abs(long.angle_rad - true) < 3e-3) is np.bool_(in_long)
        assert np.any(np.abs(both.angle_rad - true) < 3e-3)


def test_only_the_strongest_lines_are_kept(scene: Scene) -> None:
    true = np.linspace(-3.0, 3.0, 30)
    picture = scene(true, np.where(np.arange(30) % 2, 200.0, 80.0))
    assert _lines(picture, (321.5, 239.0), MirrorRing(), Vision(max_lines=7)).angle_rad.size == 7


def test_edges_that_do_not_point_at_the_centre_have_no_vote() -> None:
    gradient = np.array([100.0, 100.0, 0.0, 0.0], dtype=np.float32)
    other = np.array([0.0, 0.0, 100.0, 100.0], dtype=np.float32)
    at_u = np.array([100.0, 0.0, 100.0, 0.0], dtype=np.float32)
    at_v = np.array([0.0, 100.0, 0.0, 100.0], dtype=np.float32)
    votes = radial_votes(Edges(at_u, at_v, gradient, other), (0.0, 0.0), 50.0, 200.0, 5.0)
    # Below the centre with a gradient to the right, and right of it with one downwards: across the radius.
    assert np.allclose(votes.angle_rad, [-np.pi / 2, 0.0])
    assert votes.polarity.tolist() == [1, -1]


@pytest.mark.parametrize("lean_deg", [4.9, 5.1])
def test_the_tolerance_is_a_border(lean_deg: float) -> None:
    across = np.deg2rad(90.0 - lean_deg)
    point = [np.array([x], dtype=np.float32) for x in (100.0, 0.0, np.cos(across), np.sin(across))]
    votes = radial_votes(Edges(*point), (0.0, 0.0), 50.0, 200.0, 5.0)
    assert votes.angle_rad.size == (1 if lean_deg < 5.0 else 0)


@given(st.lists(st.floats(-np.pi, np.pi), max_size=50), st.sampled_from([90, 720, 1440]))
def test_each_vote_lands_in_the_sector_that_holds_it(angles: list[float], sectors: int) -> None:
    angle = np.array(angles)
    histogram = sector_histogram(angle, None, sectors)
    assert histogram.sum() == angle.size
    for a in angles:
        sector = int((a / (2.0 * np.pi) + 0.5) * sectors) % sectors
        assert histogram[sector] >= 1


@given(st.lists(st.integers(0, 5), min_size=5, max_size=40), st.integers(1, 2), st.integers(0, 39))
def test_peaks_turn_with_the_histogram_and_stand_apart(values: list[int], reach: int, turn: int) -> None:
    # Distinct values: what is the first of equals depends on where the circle is cut.
    h = np.array(values) + np.arange(len(values)) / 100.0
    peaks = local_peaks(h, 2.0, reach)
    assert np.all(h[peaks] >= 2.0)
    turned = local_peaks(np.roll(h, turn), 2.0, reach)
    assert set(((peaks + turn) % h.size).tolist()) == set(turned.tolist())
    for p in peaks:
        for step in range(1, reach + 1):
            assert h[p] >= max(h[(p + step) % h.size], h[(p - step) % h.size])


def test_of_a_plateau_the_first_sector_is_the_peak() -> None:
    assert local_peaks(np.array([0.0, 3.0, 3.0, 0.0, 0.0]), 1.0).tolist() == [1]


def test_the_strongest_sectors_stay_in_order() -> None:
    assert strongest(np.array([1, 3, 5]), np.array([0.0, 7.0, 0.0, 2.0, 0.0, 9.0]), 2).tolist() == [1, 5]


@pytest.mark.parametrize(("inner", "outer"), [(63.0, 225.0), (63.0, 150.0), (110.0, 200.0)])
def test_a_line_ends_where_its_edge_does(scene: Scene, inner: float, outer: float) -> None:
    true, levels = np.array([-2.0, -0.7, 0.4, 1.5]), np.array([140.0, 90.0, 140.0, 90.0])
    picture = scene(true, levels)
    v, u = np.mgrid[:480, :640]
    r = np.hypot(u - 321.5, v - 239.0)
    ring = (r > 60.0) & (r < 225.0)
    picture[ring & ((r < inner) | (r > outer))] = 115
    lines = _lines(picture, (321.5, 239.0), MirrorRing())
    assert lines.angle_rad.size == true.size
    assert np.all(np.abs(lines.inner_px - inner) < 4.0)
    assert np.all(np.abs(lines.outer_px - outer) < 4.0)
    assert np.all(np.abs(lines.strength - (outer - inner) / 162.0) < 0.06)


@pytest.mark.parametrize("gap", [(105.0, 195.0), (90.0, 175.0)])
def test_a_line_with_a_gap_does_not_go_on_where_there_is_no_edge(scene: Scene, gap: tuple[float, float]) -> None:
    picture = scene(np.array([-2.0, -0.7, 0.4, 1.5]), np.array([200.0, 40.0, 200.0, 40.0]))
    v, u = np.mgrid[:480, :640]
    r = np.hypot(u - 321.5, v - 239.0)
    picture[(r > gap[0]) & (r < gap[1])] = 115
    lines = _lines(picture, (321.5, 239.0), MirrorRing())
    assert lines.angle_rad.size == 4
    assert np.all(lines.inner_px > 60.0)
    assert np.all(lines.outer_px < 229.0)
