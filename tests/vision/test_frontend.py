from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd, Work

Grey = NDArray[np.uint8]
Scene = Callable[..., Grey]

ANGLES = np.array([-2.6, -2.0, -1.1, -0.3, 0.5, 1.2, 2.0, 2.7])
LEVELS = np.array([200.0, 60.0, 180.0, 90.0, 230.0, 120.0, 30.0, 150.0])
RING = {"center_px": (160.0, 120.0), "r_min_px": 30.0, "r_max_px": 105.0}


def _config(**changes: object) -> Config:
    given = {"camera": {"width_px": 320, "height_px": 240}, "ring": RING}
    return Config.model_validate(given | changes)


def _frame(picture: Grey, stamp: int = 0) -> Frame:
    return Frame(stamp, PixelFormat.GREY8, picture.shape[1], picture.shape[0], picture.ravel())


@pytest.fixture(scope="module")
def picture(scene: Scene) -> Callable[[float, float, float], Grey]:
    def at(turn: float, u: float = 160.0, v: float = 120.0) -> Grey:
        turned = wrap(ANGLES + turn)
        order = np.argsort(turned)
        return scene(turned[order], LEVELS[order], center=(u, v), r_min=30.0, r_max=105.0, size=(320, 240), noise=2.0)

    return at


@pytest.mark.parametrize("sign", [1, -1])
def test_bearings_carry_the_sign_and_the_ring(picture: Callable[..., Grey], sign: int) -> None:
    camera = {"width_px": 320, "height_px": 240, "bearing_sign": sign}
    seen = FrontEnd(_config(camera=camera)).step(_frame(picture(0.0, 163.0, 118.0), stamp=77))
    assert seen.stamp_ns == 77
    assert seen.reasons == ()
    assert seen.ring is not None
    assert np.hypot(seen.ring.center_u_px - 163.0, seen.ring.center_v_px - 118.0) < 0.1
    assert np.max(np.abs(np.sort(sign * seen.bearing_rad) - ANGLES)) < 2e-3
    assert seen.age_frames.tolist() == [0] * 8


@pytest.mark.parametrize("sign", [1, -1])
def test_lines_keep_their_identity_while_the_camera_turns_and_shakes(picture: Callable[..., Grey], sign: int) -> None:
    camera = {"width_px": 320, "height_px": 240, "bearing_sign": sign}
    front = FrontEnd(_config(camera=camera))
    rng = np.random.default_rng(0)
    bearing: dict[int, float] = {}
    for k in range(12):
        turn = 0.04 * k
        seen = front.step(_frame(picture(turn, *(np.array([160.0, 120.0]) + rng.normal(0.0, 1.0, 2)))))
        assert seen.reasons == ()
        for track, value in zip(seen.track_id, seen.bearing_rad, strict=True):
            still = wrap(sign * float(value) - turn)
            assert abs(wrap(bearing.setdefault(int(track), still) - still)) < 0.02
    assert len(bearing) == 8


def test_paper_mode_finds_the_lines_to_half_a_sector(picture: Callable[..., Grey]) -> None:
    front = FrontEnd(_config(vision={"mode": "paper"}))
    for k in range(3):
        seen = front.step(_frame(picture(0.04 * k)))
        assert seen.reasons == ()
        error = wrap(np.sort(wrap(seen.bearing_rad - 0.04 * k)) - ANGLES)
        assert np.max(np.abs(error)) < np.deg2rad(0.5)


def _good(front: FrontEnd, picture: Callable[..., Grey]) -> Bearings:
    return front.step(_frame(picture(0.0)))


def _black() -> Frame:
    return _frame(np.zeros((240, 320), dtype=np.uint8))


BAD = {
    "black": (_black(), "ring"),
    "white": (_frame(np.full((240, 320), 255, dtype=np.uint8)), "ring"),
    "noise": (_frame(np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8)), "ring"),
    "another size": (_frame(np.zeros((480, 640), dtype=np.uint8)), "640x480, configured 320x240"),
    "too few bytes": (Frame(0, PixelFormat.GREY8, 320, 240, np.zeros(100, dtype=np.uint8)), "100 bytes"),
    "no bytes": (Frame(0, PixelFormat.JPEG, 320, 240, np.zeros(0, dtype=np.uint8)), "jpeg"),
    "garbage": (Frame(0, PixelFormat.PNG, 320, 240, np.arange(200, dtype=np.uint8)), "png"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_frame_gives_its_reason_and_the_tracks_survive(picture: Callable[..., Grey], name: str) -> None:
    frame, reason = BAD[name]
    front = FrontEnd(_config())
    before = _good(front, picture)
    for _ in range(3):
        bad = front.step(frame)
        assert any(reason in r for r in bad.reasons)
        assert name == "noise" or bad.track_id.size == 0
    after = _good(front, picture)
    assert after.reasons == ()
    assert set(before.track_id.tolist()) <= set(after.track_id.tolist())
    back = {int(t): float(b) for t, b in zip(after.track_id, after.bearing_rad, strict=True)}
    for track, value in zip(before.track_id, before.bearing_rad, strict=True):
        assert abs(back[int(track)] - value) < 5e-3


@pytest.mark.parametrize("name", BAD)
def test_a_bad_frame_may_come_first(picture: Callable[..., Grey], name: str) -> None:
    front = FrontEnd(_config())
    bad = front.step(BAD[name][0])
    assert bad.reasons
    assert bad.ring is None
    assert bad.track_id.size == 0
    assert _good(front, picture).track_id.size == 8


def test_a_held_ring_is_in_the_message_with_its_reason(picture: Callable[..., Grey]) -> None:
    front = FrontEnd(_config())
    good = _good(front, picture).ring
    held = front.step(_black())
    assert good is not None
    assert held.ring is not None
    assert (held.ring.center_u_px, held.ring.center_v_px) == (good.center_u_px, good.center_v_px)
    assert held.ring.quality < good.quality


def test_colour_shows_the_same_lines_as_grey(picture: Callable[..., Grey]) -> None:
    grey = picture(0.1)
    colour = np.repeat(grey[..., None], 3, axis=2).ravel()
    one = FrontEnd(_config()).step(_frame(grey))
    two = FrontEnd(_config()).step(Frame(0, PixelFormat.BGR8, 320, 240, colour))
    assert np.array_equal(one.bearing_rad, two.bearing_rad)


@pytest.mark.parametrize("gain", [0.5, 0.8, 1.6])
def test_the_lines_stay_when_the_light_changes(picture: Callable[..., Grey], gain: float) -> None:
    front = FrontEnd(_config())
    before = _good(front, picture)
    bright = np.clip(picture(0.02) * gain, 0, 255).astype(np.uint8)
    after = front.step(_frame(bright))
    assert np.intersect1d(before.track_id, after.track_id).size >= 7


def test_the_same_frames_give_the_same_bytes(picture: Callable[..., Grey]) -> None:
    frames = [_frame(picture(0.03 * k)) for k in range(4)]
    runs = [[front.step(f) for f in frames] for front in (FrontEnd(_config()), FrontEnd(_config()))]
    for a, b in zip(*runs, strict=True):
        assert a.bearing_rad.tobytes() == b.bearing_rad.tobytes()
        assert a.std_rad.tobytes() == b.std_rad.tobytes()
        assert a.track_id.tobytes() == b.track_id.tobytes()


def test_the_stages_one_by_one_are_the_step(picture: Callable[..., Grey]) -> None:
    whole, parts = FrontEnd(_config()), FrontEnd(_config())
    assert [s.name for s in parts.stages] == ["decode", "edges", "ring", "lines", "faults", "descriptors", "tracking"]
    for k in range(3):
        frame = _frame(picture(0.05 * k))
        work = Work(frame)
        for stage in parts.stages:
            stage.run(work)
        a, b = parts.bearings(work), whole.step(frame)
        assert a.bearing_rad.tobytes() == b.bearing_rad.tobytes()
        assert a.track_id.tobytes() == b.track_id.tobytes()


@pytest.mark.parametrize("size", [(200, 160), (97, 211)])
def test_a_ring_mostly_outside_the_picture_does_no_harm(picture: Callable[..., Grey], size: tuple[int, int]) -> None:
    part = np.ascontiguousarray(picture(0.0)[: size[1], : size[0]])
    camera = {"width_px": part.shape[1], "height_px": part.shape[0]}
    seen = FrontEnd(_config(camera=camera)).step(_frame(part))
    assert seen.ring is not None or seen.reasons
    assert np.all(np.isfinite(seen.bearing_rad))
