"""The edge finder against its own docstrings, written down once more: slices for Sobel, then pixel after pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.vision.edges import PLAIN, Array, Band, EdgeFinder, Edges, everywhere, thinned_edges

Float = NDArray[np.float64]
Grey = NDArray[np.uint8]

LEAST = 30.0
# Not the picture as it is, but in whole numbers, so that gradients are exact and equal ones are equal.
ODD_TONE = np.random.default_rng(1).permutation(256).astype(np.float32)


def of_use(u: float, v: float, gradient_u: float, gradient_v: float, band: Band) -> bool:
    """The edge, across its gradient, points at `toward`, or it is far out and lies across the radius."""
    edge = np.array([-gradient_v, gradient_u]) / np.hypot(gradient_u, gradient_v)

    def lean(about_u: float, about_v: float) -> float:
        """Sine of the angle between the edge and the way to a point."""
        way = np.array([u - about_u, v - about_v])
        return abs(float(edge[0] * way[1] - edge[1] * way[0])) / float(np.hypot(*way))

    points = lean(band.toward_u_px, band.toward_v_px) ** 2 <= band.leaning
    far = np.hypot(u - band.u_px, v - band.v_px) >= band.rim_px
    return points or bool(far and 1.0 - lean(band.u_px, band.v_px) ** 2 <= band.rim_leaning)


def literal(grey: Grey, band: Band, least: float, tone: Array = PLAIN) -> tuple[Float, Float]:
    """u, v, gradient along u and along v of every edge point, row by row, (4, N); and how exact u and v can be, (N,).

    Sobel by slices; a pixel is a ridge when it exceeds both neighbours across the edge, along the axis nearer to the
    gradient: it may equal the one before it. The top of the parabola through the three magnitudes is its place.
    """
    height, width = grey.shape
    if height < 5 or width < 5:
        return np.empty((4, 0)), np.empty(0)
    p = tone.astype(np.float64)[grey]
    gu, gv = np.zeros(p.shape), np.zeros(p.shape)
    right_less_left, below_less_above = p[:, 2:] - p[:, :-2], p[2:] - p[:-2]
    gu[1:-1, 1:-1] = right_less_left[:-2] + 2.0 * right_less_left[1:-1] + right_less_left[2:]
    gv[1:-1, 1:-1] = below_less_above[:, :-2] + 2.0 * below_less_above[:, 1:-1] + below_less_above[:, 2:]
    square = gu**2 + gv**2
    points, exact = [], []
    for v in range(2, height - 2):
        for u in range(2, width - 2):
            away = np.hypot(u - band.u_px, v - band.v_px)
            if not band.inner_px <= away <= band.outer_px or square[v, u] <= least**2:
                continue
            if not of_use(u, v, float(gu[v, u]), float(gv[v, u]), band):
                continue
            du, dv = (1, 0) if abs(gu[v, u]) >= abs(gv[v, u]) else (0, 1)
            before, here, after = square[v - dv, u - du], square[v, u], square[v + dv, u + du]
            if before > here or after >= here:
                continue
            a, m, b = np.sqrt((before, here, after))
            bend = 2.0 * m - a - b
            offset = 0.5 * (b - a) / bend
            points.append((u + du * offset, v + dv * offset, gu[v, u], gv[v, u]))
            exact.append(8.0 * np.finfo(np.float32).eps * (m / bend + max(u, v)))
    return np.array(points).reshape(-1, 4).T, np.array(exact)


def agree(edges: Edges, grey: Grey, band: Band, least: float = LEAST, tone: Array = PLAIN) -> int:
    """How many points, when they are the same ones."""
    expected, exact = literal(grey, band, least, tone)
    assert edges.u_px.size == exact.size
    assert np.array_equal(edges.gradient_u, expected[2])
    assert np.array_equal(edges.gradient_v, expected[3])
    assert np.all(np.abs(edges.u_px - expected[0]) <= exact)
    assert np.all(np.abs(edges.v_px - expected[1]) <= exact)
    return exact.size


def _noise(height: int, width: int, seed: int, levels: int = 256) -> Grey:
    """Few levels make many equal neighbours."""
    grain = np.random.default_rng(seed).integers(0, levels, (height, width))
    return np.asarray(grain * (255 // (levels - 1)), dtype=np.uint8)


SHAPES = st.tuples(st.integers(1, 24), st.integers(1, 24))
# No pixel lies on a border: to which side it belongs there, nobody needs to know.
PLACES = st.integers(-150, 400).map(lambda n: n / 10.0 + np.pi / 100.0)
RADII = st.integers(0, 400).map(lambda n: n / 10.0 + np.e / 100.0)
SQUARES = st.integers(0, 40).map(lambda n: n / 40.0 + np.e / 1000.0)
BANDS = st.builds(Band, PLACES, PLACES, RADII, RADII, *map(st.just, Band(0.0, 0.0, 0.0, 0.0)[4:]))
CHOOSY_BANDS = st.builds(Band, PLACES, PLACES, RADII, RADII, PLACES, PLACES, SQUARES, RADII, SQUARES)


@settings(max_examples=40, deadline=None)
@given(shape=SHAPES, band=BANDS | CHOOSY_BANDS, seed=st.integers(0, 10_000), levels=st.sampled_from([2, 3, 256]))
def test_any_small_picture_and_any_band_give_the_literal_points(
    shape: tuple[int, int], band: Band, seed: int, levels: int
) -> None:
    """Bands within, across and beyond the picture, thin ones, empty ones, and with holes of all sizes."""
    grey = _noise(*shape, seed, levels)
    agree(thinned_edges(grey, band, LEAST), grey, band)
    tone = ODD_TONE if seed % 2 else PLAIN
    agree(EdgeFinder(LEAST).step(grey, band, tone), grey, band, tone=tone)


@pytest.mark.parametrize(
    "band",
    [
        Band(45.3, 32.8, 10.5, 28.6),  # a ring inside
        Band(45.3, 32.8, 0.0, 28.6),  # no hole
        Band(45.3, 32.8, 20.5, 60.6),  # cut off on all sides
        Band(45.3, 32.8, 40.2, 90.0),  # corners alone
        Band(-20.4, 70.9, 30.1, 80.7),  # its centre outside
        Band(45.3, 32.8, 27.0, 28.1),  # a pixel wide
        Band(45.3, -40.2, 1.5, 44.9),  # the topmost rows
        Band(200.3, 32.8, 1.5, 60.0),  # beside the picture
        Band(45.3, 32.8, 30.0, 20.0),  # nothing
    ],
)
@pytest.mark.parametrize("tone", [PLAIN, ODD_TONE], ids=["plain", "toned"])
def test_bands_of_a_noisy_picture(band: Band, tone: Array) -> None:
    grey = _noise(64, 91, 3)
    count = agree(EdgeFinder(LEAST).step(grey, band, tone), grey, band, tone=tone)
    assert (count > 20) is (band.u_px < 100.0 and band.inner_px < band.outer_px)


@pytest.mark.parametrize("leaning", [0.003, 0.11, 0.5])
@pytest.mark.parametrize("rim", [np.inf, 25.1])
def test_edges_of_no_use_are_left_out_and_no_others(leaning: float, rim: float) -> None:
    """Some are of no use, whether the rim is of use or not, and not all."""
    grey, whole = _noise(64, 91, 4), Band(45.3, 32.8, 10.5, 40.6)
    band = whole._replace(toward_u_px=47.2, toward_v_px=29.9, leaning=leaning, rim_px=rim, rim_leaning=0.2)
    count = agree(thinned_edges(grey, band, LEAST), grey, band)
    assert 10 < count < agree(thinned_edges(grey, whole, LEAST), grey, whole)


def test_painted_pictures(textured: Grey) -> None:
    part = np.ascontiguousarray(textured[4:164, 210:430])  # with a piece of the rim
    assert agree(thinned_edges(part, everywhere(part), LEAST), part, everywhere(part)) > 500
    v, u = np.mgrid[:60, :70]
    for step in ((u + v) * 3 % 255, np.where(u > 30, 200, 20), np.where(u + v > 60, 200, 20), 128 + 0 * u):
        grey = np.asarray(step, dtype=np.uint8)
        agree(thinned_edges(grey, everywhere(grey), LEAST), grey, everywhere(grey))


@pytest.mark.parametrize("least", [0.0, 1.0, 100.0, 400.0, 2000.0])
def test_the_threshold_is_the_magnitude(least: float) -> None:
    """And a flat picture has no edges whatever it says."""
    grey = _noise(40, 50, 5)
    faint, eighth = np.asarray(grey // 64, dtype=np.uint8), PLAIN / np.float32(8.0)
    agree(EdgeFinder(least).step(faint, everywhere(faint), eighth), faint, everywhere(faint), max(least, 1.0), eighth)
    agree(EdgeFinder(least).step(grey, everywhere(grey)), grey, everywhere(grey), max(least, 1.0))
    flat = np.full((40, 50), 77, dtype=np.uint8)
    assert EdgeFinder(least).step(flat, everywhere(flat)).u_px.size == 0


def test_one_finder_sees_pictures_of_any_size_one_after_another() -> None:
    """What the room held before is not seen."""
    finder = EdgeFinder(LEAST)
    for k, shape in enumerate([(30, 40), (60, 20), (4, 90), (20, 90), (90, 20), (5, 5), (30, 40)]):
        grey = _noise(*shape, k)
        agree(finder.step(grey, everywhere(grey)), grey, everywhere(grey))


def test_a_picture_that_is_part_of_another_is_read_as_it_lies() -> None:
    whole = _noise(80, 120, 8)
    for view in (whole[10:50, 20:75], whole[::2, ::3], whole.T, whole[::-1, ::-1]):
        agree(thinned_edges(view, everywhere(view), LEAST), np.array(view), everywhere(view))
