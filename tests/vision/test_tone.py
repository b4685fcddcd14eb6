"""What the tone does to edges: against painted light, whose edges are known, and through changes of exposure."""

from math import erf

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.vision.edges import PLAIN, Array, Band, EdgeFinder, Edges, everywhere, tone_of_light

Float = NDArray[np.float64]
Grey = NDArray[np.uint8]

LEAST = 32.0
GAINS = pytest.mark.parametrize("gain", [0.5, 0.7])
_blurred_step = np.vectorize(lambda x: 0.5 * (1.0 + erf(x / np.sqrt(2.0))))


def _edges(picture: Grey, tone: Array = PLAIN) -> Edges:
    return EdgeFinder(LEAST).step(picture, everywhere(picture), tone)


def _toned_edges(picture: Grey) -> Edges:
    return _edges(picture, tone_of_light(picture, everywhere(picture)))


def _bars(low: float, high: float) -> Grey:
    """Upright bars of blurred light in ten stripes, one below another; steps between `low` and `high`, 16 px apart."""
    rng = np.random.default_rng(7)
    where = 20.0 + 16.0 * np.arange(30) + rng.uniform(-0.5, 0.5, 30)
    level = 120.0 + np.where(np.arange(31) % 2, 0.5, -0.5) * rng.uniform(low, high, (10, 31))
    steps = np.diff(level)[:, None, :] * _blurred_step((np.arange(520.0)[:, None] - where) / 1.2)
    rows = np.repeat(level[:, :1] + np.sum(steps, axis=2), 24, axis=0)
    return np.asarray(np.rint(rows), dtype=np.uint8)


def _places(edges: Edges) -> Float:
    """Where the edge of each bar is in each row, u, (240, 30); infinite where there is none, or more than one."""
    place, count = np.full((240, 32), np.inf), np.zeros((240, 32))
    row, bar = np.rint(edges.v_px).astype(int), np.rint((edges.u_px - 20.0) / 16.0).astype(int)
    np.add.at(count, (row, bar), 1)
    place[row, bar] = edges.u_px
    place[count != 1] = np.inf
    return place[np.abs(np.arange(240) % 24 - 12) < 10, :30]  # where one stripe ends and the next begins are edges, too


def _darker(picture: Grey, gain: float) -> Grey:
    return np.asarray(np.rint(picture * gain), dtype=np.uint8)


def test_plain_is_the_picture_as_it_is(textured: Grey) -> None:
    assert PLAIN.tolist() == list(range(256))
    edges = _edges(textured)
    assert edges.u_px.size > 1000
    as_it_is = cv2.Sobel(textured, cv2.CV_32F, 1, 0), cv2.Sobel(textured, cv2.CV_32F, 0, 1)
    row, column = np.rint(edges.v_px).astype(int), np.rint(edges.u_px).astype(int)
    on_grid = (np.abs(edges.u_px - column) < 0.49) & (np.abs(edges.v_px - row) < 0.49)
    for gradient, of_picture in zip(edges[2:], as_it_is, strict=True):
        assert np.array_equal(gradient[on_grid], of_picture[row, column][on_grid])


def test_a_brighter_pixel_stays_the_brighter_one_and_black_stays_black(textured: Grey) -> None:
    for gain in (0.1, 0.5, 1.0):
        picture = _darker(textured, gain)
        tone = tone_of_light(picture, everywhere(picture))
        assert tone[0] == 0.0
        assert np.all(np.diff(tone) > 0.0)


def test_only_the_ring_tells_what_white_is(textured: Grey) -> None:
    """A window beside the mirror, or the dark around it, is no light of the ring."""
    band = Band(321.5, 239.0, 63.0, 225.0)
    tone = tone_of_light(textured, band)
    v, u = np.mgrid[:480, :640]
    away = np.hypot(u - 321.5, v - 239.0)
    for grey in (0, 255):
        other = textured.copy()
        other[(away < 60.0) | (away > 228.0)] = grey
        assert np.array_equal(tone_of_light(other, band), tone)
    assert np.array_equal(tone_of_light(textured, band._replace(u_px=5000.0)), PLAIN)  # no ring in the picture


@pytest.mark.parametrize(("low", "high"), [(0.02, 0.5), (0.1, 0.6), (0.01, 0.25)])
@pytest.mark.parametrize(("response", "left"), [(1.5, 0.15), (2.2, 0.7)])
def test_edges_of_blurred_light_are_where_they_are(low: float, high: float, response: float, left: float) -> None:
    """A lens blurs light, and the camera's response then moves what is halfway between dark and bright.

    A response of light^(1 / 1.5) is undone but for rounding, one of light^(1 / 2.2), as most cameras have, in part.
    """
    plain, toned = [], []
    for where in np.linspace(59.0, 61.0, 9):
        light = low + (high - low) * _blurred_step((np.arange(120.0) - where) / 1.5)
        picture = np.tile(np.rint(255.0 * light ** (1.0 / response)).astype(np.uint8), (40, 1))
        plain.append(float(np.mean(_edges(picture).u_px)) - where)
        toned.append(float(np.mean(_toned_edges(picture).u_px)) - where)
    assert np.mean(plain) < -0.25  # px; towards the dark side
    assert abs(np.mean(toned)) < left * abs(np.mean(plain))
    assert np.max(np.abs(toned)) < np.max(np.abs(plain))


@GAINS
def test_edges_stay_in_their_places_when_the_picture_gets_darker(gain: float) -> None:
    """The tone is a power of the grey value: a gain before it is a gain after it, and moves no ridge; rounding does."""
    picture = _bars(60.0, 120.0)
    bright, dark = _places(_toned_edges(picture)), _places(_toned_edges(_darker(picture, gain)))
    both = np.isfinite(bright) & np.isfinite(dark)
    assert np.mean(both) > 0.99
    assert np.mean(np.abs(dark - bright)[both] < 0.1) > 0.95  # px; measured 0.973 at half the light


@GAINS
def test_a_darker_picture_keeps_its_edges(gain: float) -> None:
    """Those of low steps, of which the threshold lets most through in full light, with the tone or without."""
    picture = _bars(8.0, 40.0)
    share = [
        [np.mean(np.isfinite(_places(of(p)))) for p in (picture, _darker(picture, gain))]
        for of in (_edges, _toned_edges)
    ]
    (plain, plain_dark), (toned, toned_dark) = share
    assert plain > 0.9
    assert plain_dark < 0.8 * plain  # measured 0.76 at 0.7, 0.25 at half the light
    assert toned > 0.99
    assert toned_dark > 0.96 * toned  # measured 1 and 0.977


@pytest.mark.parametrize("gain", [0.8, 0.6])
def test_half_of_a_change_of_exposure_is_undone(textured: Grey, gain: float) -> None:
    """White is halfway between this picture's and a usual one: of (g x / sqrt(g))^1.5 there stays g^0.75."""

    def strength(picture: Grey) -> float:
        edges = _toned_edges(picture)
        return float(np.percentile(np.hypot(edges.gradient_u, edges.gradient_v), 90.0))

    assert strength(_darker(textured, gain)) == pytest.approx(gain**0.75 * strength(textured), rel=0.03)


def test_the_noise_of_a_dark_picture_does_not_become_edges() -> None:
    noise = np.random.default_rng(4).normal(0.0, 2.0, (240, 320))
    dark = np.asarray(np.clip(np.rint(12.0 + noise), 0, 255), dtype=np.uint8)
    assert _toned_edges(dark).u_px.size < 1e-3 * dark.size
