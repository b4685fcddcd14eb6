"""What is told of a run of frames as a whole."""

from dataclasses import replace
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnivert.angles import TURN
from omnivert.bench.vision import raw
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, MeetingPoint, PixelFormat, Ring
from omnivert.vision.account import ABOUT, Account
from omnivert.vision.frontend import FrontEnd
from tests.vision.drive import Grey, corridor
from tests.vision.painting import polar
from tests.vision.test_real import RINGS

S = 10**9
CONFIG = Config()
U, V = CONFIG.ring.center_px
R = CONFIG.ring.r_max_px


def _seen(*reasons: str, stamp_ns: int = 0, lines: int = 1, ring: Ring | None = None) -> Bearings:
    one = np.full(lines, 0.5)
    return Bearings(
        stamp_ns, np.arange(lines), one, one, np.zeros(lines, np.int32), one.astype("f4"), ring=ring, reasons=reasons
    )


def _ring(u: float = U, v: float = V, radius: float = R, quality: float = 0.9) -> Ring:
    return Ring(u, v, radius, quality)


def test_reasons_are_counted_the_most_frequent_first() -> None:
    seen = [_seen("no lines", "dark", lines=0), _seen(), _seen("dark"), _seen("dark", lines=0), _seen("odd")]
    account = Account.of(CONFIG, seen)
    assert list(account.reasons.items()) == [("dark", 3), ("no lines", 1), ("odd", 1)]
    assert (account.frames, account.unusable) == (5, 2)


def test_reasons_that_differ_in_numbers_alone_count_as_one_and_read_as_the_newest() -> None:
    account = Account.of(CONFIG, [_seen("30 % is black"), _seen("30 % is white"), _seen("100 % is black")])
    assert account.reasons == {"100 % is black": 2, "30 % is white": 1}


def test_a_note_names_three_reasons_of_the_last_ten_seconds_and_counts_the_rest() -> None:
    account = Account(CONFIG)
    account.step(_seen("long ago", stamp_ns=0))
    for k, reasons in enumerate([("a", "b", "c", "d", "e"), ("a", "b", "c"), ("a", "b"), ("a",), ()]):
        account.step(_seen(*reasons, stamp_ns=(k + 1) * 2 * S + 1))
    assert account.notes() == {"frames": "last 5 frames: a (4), b (3), c (2), 2 more"}


def test_good_frames_have_no_note() -> None:
    account = Account.of(CONFIG, [_seen(stamp_ns=k, ring=_ring()) for k in range(9)])
    assert account.notes() == {}
    assert account.reasons == {}


def test_what_is_remembered_of_a_note_is_bounded_by_time_even_when_the_clock_is_set_back() -> None:
    stamps = (100 * S, 101 * S, 5 * S, 6 * S)
    account = Account.of(CONFIG, [_seen("x", stamp_ns=ns) for ns in stamps])
    assert account.notes() == {"frames": "last 2 frames: x (2)"}
    assert account.reasons == {"x": 4}


@pytest.mark.parametrize(("off", "told"), [(18.0, False), (25.0, True)])
def test_a_ring_off_its_place_is_told(off: float, told: bool) -> None:
    notes = Account.of(CONFIG, [_seen(ring=_ring(U + 0.6 * off, V - 0.8 * off)) for _ in range(5)]).notes()
    place = f"({U + 0.6 * off:.0f}, {V - 0.8 * off:.0f})"
    assert notes == (
        {"ring": f"ring is not as configured: centre {place} px, configured ({U:.0f}, {V:.0f})"} if told else {}
    )


@pytest.mark.parametrize(("factor", "told"), [(0.985, True), (0.995, False), (1.005, False), (1.02, True)])
def test_a_ring_of_another_radius_is_told(factor: float, told: bool) -> None:
    notes = Account.of(CONFIG, [_seen(ring=_ring(radius=R * factor)) for _ in range(5)]).notes()
    assert notes == (
        {"ring": f"ring is not as configured: radius {R * factor:.1f} px, configured {R:.1f}"} if told else {}
    )


def test_nothing_is_said_of_a_ring_that_was_hardly_seen() -> None:
    held = _ring(U + 99.0, quality=0.5 * CONFIG.vision.ring_min_quality)
    assert Account.of(CONFIG, [_seen(ring=held)] * 9).notes() == {}
    assert Account.of(CONFIG, [_seen(ring=_ring(U + 99.0))] * 4).notes() == {}
    assert set(Account.of(CONFIG, [_seen(ring=_ring(U + 99.0))] * 5).notes()) == {"ring"}


@pytest.mark.parametrize(
    ("off", "std", "used", "told"),
    [(22.0, 0.3, True, True), (22.0, 6.0, True, False), (22.0, 0.3, False, False), (3.0, 0.1, True, False)],
)
def test_lines_that_meet_far_off_the_centre_are_told_once_that_is_known(
    off: float, std: float, used: bool, told: bool
) -> None:
    at = MeetingPoint(U - 0.8 * off, V + 0.6 * off, std, used)
    notes = Account.of(CONFIG, [replace(_seen(ring=_ring()), meeting=at)] * 6).notes()
    text = "mirror axis not vertical: lines meet 22 px off the ring's centre; bearings are corrected"
    assert notes == ({"mirror": text} if told else {})
    assert set(notes) <= set(ABOUT)


def test_the_corridor_has_nothing_to_be_told_but_a_wrong_configuration_has() -> None:
    drive, stamp = corridor(0, 12), count()
    wrong = drive.config.ring.model_copy(update={"center_px": (U + 28.0, V), "r_max_px": R * 1.02})
    for ring, told in ((drive.config.ring, set()), (wrong, {"ring"})):
        config = drive.config.model_copy(update={"ring": ring})
        front = FrontEnd(config)
        seen = [front.step(raw(picture, next(stamp) * S // 10)) for picture in drive.pictures()]
        assert set(Account.of(config, seen).notes()) == told


def _leaning(point: tuple[float, float], turn: float, seed: int) -> Grey:
    """30 wedges about a point, noise, and the rim where it is configured."""
    shape = (CONFIG.camera.height_px, CONFIG.camera.width_px)
    rng = np.random.default_rng(3)
    borders, level = np.sort(rng.uniform(0.0, TURN, 30)), rng.uniform(40.0, 230.0, 31)
    _, angle = polar(shape, point)
    radius, _ = polar(shape, (U, V))
    picture = level[np.searchsorted(borders, np.mod(angle - turn, TURN))] * ((radius < R) & (radius > 63.0))
    noisy = cv2.GaussianBlur(picture, (0, 0), 0.7) + np.random.default_rng(seed).normal(0.0, 2.0, shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)


@pytest.mark.parametrize(("off", "told"), [((-18.0, 12.65), True), ((22.0, 0.0), True), ((0.0, 0.0), False)])
def test_lines_that_pass_by_the_centre_are_told_with_how_far(off: tuple[float, float], told: bool) -> None:
    front = FrontEnd(CONFIG)
    pictures = [_leaning((U + off[0], V + off[1]), 0.01 * k, k) for k in range(12)]
    notes = Account.of(CONFIG, [front.step(raw(picture, k)) for k, picture in enumerate(pictures)]).notes()
    assert set(notes) == ({"mirror"} if told else set())
    if told:
        assert abs(float(notes["mirror"].split()[6]) - np.hypot(*off)) <= 1.0


@pytest.mark.parametrize(("name", "told"), [("vmr", set()), ("static", {"mirror"})])
def test_of_photographs_a_leaning_mirror_is_told_alone(shared_data: Path, name: str, told: set[str]) -> None:
    width, height, center, r_min, r_max = RINGS[name]
    config = Config.model_validate(
        {
            "camera": {"width_px": width, "height_px": height},
            "ring": {"center_px": center, "r_min_px": r_min, "r_max_px": r_max},
        }
    )
    files = sorted((shared_data / "real" / name).glob("*.jpg"))
    if not files:
        pytest.skip(f"needs the photographs real/{name}, which are not here")
    front = FrontEnd(config)
    frames = [Frame(0, PixelFormat.JPEG, width, height, np.fromfile(file, dtype=np.uint8)) for file in files]
    account = Account.of(config, [front.step(frame) for frame in frames])
    assert set(account.notes()) == told
    assert account.reasons == {}
