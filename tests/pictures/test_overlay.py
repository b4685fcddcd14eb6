"""Pictures of lines: each where it is, in a colour and with a number that can be told apart and read."""

import colorsys
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.messages import Bearings, Looks, MeetingPoint, Ring
from omnivert.pictures import overlay as module
from omnivert.pictures.labels import Labels
from omnivert.pictures.overlay import magnification, overlay
from omnivert.pictures.palette import track_color

Picture = NDArray[np.uint8]

RING = Ring(100.0, 80.0, 70.0, 1.0)
R_MIN = 20.0


def _bearings(*bearing: float, ring: Ring | None = RING, age: int = 9, reasons: tuple[str, ...] = ()) -> Bearings:
    n = len(bearing)
    return Bearings(
        stamp_ns=2_500_000_000,
        track_id=3 + np.arange(n),
        bearing_rad=np.array(bearing, dtype=np.float64),
        std_rad=np.full(n, 1e-3),
        age_frames=np.full(n, age, dtype=np.int32),
        strength=np.full(n, 0.5, dtype=np.float32),
        ring=ring,
        reasons=reasons,
    )


def _looks(polarity: int = 0, inner: float = 20.0, outer: float = 70.0, moving: int = 0, n: int = 1) -> Looks:
    return Looks(
        polarity=np.full(n, polarity, dtype=np.int32),
        inner_px=np.full(n, inner, dtype=np.float32),
        outer_px=np.full(n, outer, dtype=np.float32),
        quality=np.ones(n, dtype=np.float32),
        moving=np.full(n, moving, dtype=np.uint8),
    )


def _black(height: int = 160, width: int = 200) -> Picture:
    return np.zeros((height, width), dtype=np.uint8)


def _colored(drawn: Picture, u: float, v: float, track: int = 3, shape: tuple[int, int] = (160, 200)) -> bool:
    """Whether the drawing of a frame of that shape has the track's colour at a pixel of the frame."""
    k = magnification(*shape)
    x, y = round(k * (u + 0.5) - 0.5), round(k * (v + 0.5) - 0.5)
    return bool(np.max(np.abs(drawn[y, x].astype(int) - track_color(track))) < 60)  # smoothed at its border


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[Labels]:
    """The labels of every picture that is drawn from now on."""
    made: list[Labels] = []

    class Heard(Labels):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            made.append(self)

    monkeypatch.setattr(module, "Labels", Heard)
    return made


@pytest.mark.parametrize(("sign", "row", "other"), [(1, 40, 120), (-1, 120, 40)])
def test_a_line_is_drawn_in_its_tracks_colour_at_its_bearing_with_either_sign(sign: int, row: int, other: int) -> None:
    picture = _black()
    drawn = overlay(picture, _bearings(np.pi / 2.0), sign, R_MIN)  # image angle pi / 2 is up
    k = magnification(160, 200)
    assert drawn.shape == (160 * k, 200 * k, 3)
    assert _colored(drawn, 100, row)
    assert not drawn[other * k, 100 * k].any()
    assert not picture.any()


@pytest.mark.parametrize("shape", [(240, 320), (480, 640), (1944, 2592), (120, 160)])
def test_every_pixel_along_a_ray_has_the_lines_colour_at_every_size(shape: tuple[int, int]) -> None:
    height, width = shape
    ring = Ring(0.5 * width + 0.3, 0.5 * height - 0.4, 0.42 * height, 1.0)
    for angle in (0.3, 2.0, -1.1):
        drawn = overlay(_black(height, width), _bearings(angle, ring=ring, age=99), 1, 0.2 * height)
        assert drawn.shape == (height * magnification(*shape), width * magnification(*shape), 3)
        for r in np.linspace(0.22 * height, 0.36 * height, 20):
            u, v = ring.center_u_px + r * np.cos(angle), ring.center_v_px - r * np.sin(angle)
            assert _colored(drawn, u, v, shape=shape)


def test_small_pictures_are_enlarged_and_large_ones_left() -> None:
    assert [magnification(*shape) for shape in ((240, 320), (480, 640), (768, 1024), (1944, 2592))] == [3, 2, 1, 1]


def test_lines_begin_at_the_meeting_point_only_where_it_is_used() -> None:
    for used, row in ((True, 90), (False, 80)):
        bearings = replace(_bearings(0.0), meeting=MeetingPoint(100.0, 90.0, 0.1, used))
        drawn = overlay(_black(), bearings, 1, R_MIN)
        assert _colored(drawn, 140, row)
        assert not _colored(drawn, 140, 170 - row)


def test_a_used_meeting_point_is_named_and_a_mere_one_is_not(written: list[Labels]) -> None:
    for used in (True, False):
        overlay(_black(), replace(_bearings(), meeting=MeetingPoint(103.0, 80.0, 0.1, used)), 1, R_MIN)
    assert [len(labels.boxes) for labels in written] == [1, 0]


def test_a_line_is_drawn_over_its_extent_and_no_farther() -> None:
    bearings = replace(_bearings(0.0), looks=_looks(inner=35.0, outer=55.0))
    drawn = overlay(_black(), bearings, 1, R_MIN)
    assert all(_colored(drawn, u, 80) for u in range(136, 155))
    assert not any(_colored(drawn, u, 80) for u in (*range(121, 133), *range(158, 169)))


def test_without_looks_a_line_fills_the_ring() -> None:
    drawn = overlay(_black(), _bearings(0.0), 1, R_MIN)
    assert all(_colored(drawn, u, 80) for u in range(122, 169))


def test_a_moving_line_is_dashed_and_says_so(written: list[Labels]) -> None:
    share = []
    for moving in (0, 1):
        drawn = overlay(_black(), replace(_bearings(0.0), looks=_looks(moving=moving)), 1, R_MIN)
        share.append(np.mean([_colored(drawn, u, 80) for u in np.arange(122.0, 168.0, 0.25)]))
    assert share[0] == 1.0
    assert 0.3 < share[1] < 0.8
    still, moves = (labels.boxes[0] for labels in written)
    assert moves[2] - moves[0] > 2 * (still[2] - still[0])


@pytest.mark.parametrize("polarity", [-1, 0, 1])
def test_a_tick_at_the_outer_end_points_to_the_brighter_side(polarity: int) -> None:
    drawn = overlay(_black(), replace(_bearings(0.0), looks=_looks(polarity, outer=50.0)), 1, R_MIN)
    # At angle 0 the image angle grows upwards.
    assert _colored(drawn, 150, 78.25) == (polarity == 1)
    assert _colored(drawn, 150, 81.75) == (polarity == -1)


def test_old_lines_are_thicker_than_new_ones() -> None:
    widths = []
    for age in (0, 9, 99):
        column = overlay(
            np.zeros((960, 1200), dtype=np.uint8), _bearings(0.0, ring=Ring(500, 480, 400, 1.0), age=age), 1, 90.0
        )
        lit = np.abs(column[470:491, 700].astype(int) - track_color(3)).max(axis=1) < 60
        widths.append(int(lit.sum()))
    assert widths[0] < widths[1] < widths[2]


def test_without_a_ring_only_the_reasons_are_drawn() -> None:
    picture = np.zeros((160, 200, 3), dtype=np.uint8)
    assert not overlay(picture, _bearings(0.0, ring=None), 1, R_MIN).any()
    assert overlay(picture, _bearings(0.0, ring=None, reasons=("ring not in the picture",)), 1, R_MIN).any()
    assert not picture.any()


@pytest.mark.parametrize("shape", [(240, 320), (1944, 2592), (32, 32)])
@pytest.mark.parametrize(
    "reasons", [("a long reason that goes on and on " * 9,), ("x" * 1000,), tuple("one\ntwo" for _ in range(16))]
)
def test_reasons_never_run_out_of_the_picture(
    shape: tuple[int, int], reasons: tuple[str, ...], written: list[Labels]
) -> None:
    drawn = overlay(_black(*shape), _bearings(ring=None, reasons=reasons), 1, R_MIN)
    left, top, right, bottom = written[0].boxes[0]
    assert (left, bottom) == (0, drawn.shape[0])
    assert top >= 0
    assert right <= drawn.shape[1]
    assert drawn[top:bottom, left:right].any()
    assert not drawn[:, -2:].any()
    assert not drawn[:top].any()


def test_the_band_stands_above_the_picture_and_hides_none_of_it() -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 255, (240, 320), dtype=np.uint8)
    plain, told = (overlay(picture, _bearings(), 1, R_MIN, index) for index in (None, 12345))
    band = told.shape[0] - plain.shape[0]
    assert band > 15
    assert np.array_equal(told[band:], plain)
    assert told[:band].max() > 200


def test_the_band_of_a_narrow_picture_is_cut_with_a_margin() -> None:
    drawn = overlay(_black(96, 32), _bearings(), 1, 10.0, 10**9)
    ground = drawn[0, 0]
    assert (drawn[: drawn.shape[0] - 4 * 96, -2:] == ground).all()


@pytest.mark.parametrize("shape", [(240, 320), (480, 640), (768, 1024), (1944, 2592)])
@pytest.mark.parametrize("fill", [0.46, 0.5, 0.62])
def test_numbers_lie_neither_on_each_other_nor_outside(
    shape: tuple[int, int], fill: float, written: list[Labels]
) -> None:
    height, width = shape
    angles = np.random.default_rng(7).uniform(-np.pi, np.pi, 60)
    ring = Ring(0.5 * width, 0.49 * height, fill * height, 1.0)
    bearings = replace(_bearings(*angles, ring=ring, reasons=("no lines",)), looks=_looks(moving=1, n=60))
    drawn = overlay(_black(height, width), replace(bearings, looks=None), 1, 0.13 * height, 5)
    boxes = written[0].boxes
    _assert_apart(boxes, drawn.shape[1], drawn.shape[0])
    assert len(boxes) > 45
    overlay(_black(height, width), bearings, 1, 0.13 * height, 5)
    _assert_apart(written[1].boxes, drawn.shape[1], drawn.shape[0])


@pytest.mark.parametrize(("radius", "outside"), [(70.0, True), (130.0, False)])
def test_numbers_stand_outside_the_ring_where_there_is_room(
    radius: float, outside: bool, written: list[Labels]
) -> None:
    ring = Ring(100.0, 80.0, radius, 1.0)
    overlay(_black(), _bearings(*np.arange(-3.0, 3.0, 0.5), ring=ring), 1, R_MIN)
    k = magnification(160, 200)
    middles = (written[0].boxes[:, :2] + written[0].boxes[:, 2:]) / 2.0
    distance = np.hypot(*(middles - k * np.array([100.0, 80.0])).T)
    assert len(distance) > (11 if outside else 3)
    assert ((distance > k * radius) == outside).all()


@given(
    places=st.lists(st.tuples(st.floats(-50, 450), st.floats(-50, 350)), max_size=40),
    texts=st.lists(
        st.text(st.characters(codec="ascii", exclude_categories=["C"]), min_size=1, max_size=12), max_size=9
    ),
)
def test_no_text_is_placed_on_another(places: list[tuple[float, float]], texts: list[str]) -> None:
    drawn = np.full((300, 400, 3), 255, dtype=np.uint8)
    labels = Labels(drawn, 14.0, 20)
    labels.paragraph(texts[:2], (255, 255, 255))
    for text in texts:
        labels.place(text, (255, 255, 255), places)
    _assert_apart(labels.boxes, 400, 300)
    assert not len(labels.boxes) or labels.boxes[:, 1].min() >= 20
    labels.write()


def _assert_apart(boxes: NDArray[np.int64], width: int, height: int) -> None:
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 2:] <= (width, height)).all()
    painted = np.zeros((height, width), dtype=np.int64)
    for left, top, right, bottom in boxes:
        painted[top:bottom, left:right] += 1
    assert painted.max(initial=0) <= 1


def _luminance(bgr: NDArray[Any] | tuple[int, int, int]) -> float:
    """WCAG 2, by sRGB's own curve."""
    c = np.asarray(bgr, dtype=np.float64)[::-1] / 255.0
    return float(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722))


def test_all_tracks_are_equally_bright_and_readable_on_black() -> None:
    bright = np.array([_luminance(track_color(k)) for k in (*range(500), 2**62)])
    assert (bright + 0.05).min() / 0.05 > 7.0
    assert np.ptp(bright) < 0.03


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_number_is_readable_on_any_picture(grey: int, written: list[Labels]) -> None:
    for track in range(24):
        bearings = replace(_bearings(0.0), track_id=np.array([track]))
        drawn = overlay(np.full((160, 200), grey, dtype=np.uint8), bearings, 1, R_MIN)
        left, top, right, bottom = written[-1].boxes[0]
        inside = drawn[top:bottom, left:right]
        letters = np.abs(inside.astype(int) - track_color(track)).max(axis=2) < 40
        assert letters.sum() > 8
        assert (_luminance(track_color(track)) + 0.05) / (_luminance(inside[0, -1]) + 0.05) > 4.5


def test_tracks_with_near_numbers_differ_in_hue() -> None:
    hues = np.array([colorsys.rgb_to_hsv(*track_color(k)[::-1])[0] for k in range(200)])
    colors = np.array([[track_color(k) for k in range(200)]], dtype=np.float32) / 255.0
    lab = cv2.cvtColor(colors, cv2.COLOR_BGR2Lab)[0]
    for step in (1, 2, 3, 4):
        assert np.linalg.norm(lab[step:, 1:] - lab[:-step, 1:], axis=1).min() > 25.0  # 2.3 can just be seen
    assert len(np.unique(hues.round(2))) > 40


def test_anything_that_a_message_may_hold_can_be_drawn() -> None:
    for ring in (Ring(-1e5, 1e5, 1e5, 0.0), Ring(1e5, 0.0, 0.0, 1.0), Ring(100.0, 80.0, 0.0, 1.0, 1e5)):
        bearings = replace(
            _bearings(-np.pi, 0.0, np.pi, ring=ring, reasons=("\x1b[2J", "")),
            track_id=np.array([0, 2**62, 5]),
            looks=_looks(1, inner=1e5, outer=0.0, moving=1, n=3),
            meeting=MeetingPoint(-1e5, -1e5, 1e5, True),
        )
        for looks in (None, bearings.looks, _looks(1, inner=0.0, outer=1e5, moving=1, n=3)):
            assert overlay(_black(), replace(bearings, looks=looks), -1, R_MIN, 2**40).shape[1] == 800
