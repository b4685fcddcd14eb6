"""What is said of broken pictures, and that nothing is said of good ones; each picture is made from a good one."""

import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from omnivert.angles import TURN
from omnivert.bench.vision import raw
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd, Work
from omnivert.vision.image import grey_from_frame
from tests.vision.bad_frames import turned
from tests.vision.drive import Drive, Grey, as_recorded, corridor
from tests.vision.painting import polar

AT = 30  # of the frame that is spoilt
BEFORE = 9  # the first three frames are searched all over, and not remembered
SMEARED = "far fewer edges than before: smeared or out of focus"


@pytest.fixture(scope="module")
def drive() -> Drive:
    return corridor(AT - BEFORE, AT + 2)


@pytest.fixture(scope="module")
def good(drive: Drive) -> Grey:
    return drive.pictures()[BEFORE]


def _told(drive: Drive, *spoilt: Frame | Grey) -> list[Bearings]:
    """What the front end makes of spoilt frames after good ones."""
    front = FrontEnd(drive.config)
    for frame in drive.frames[:BEFORE]:
        assert front.step(frame).reasons == ()
    return [front.step(frame if isinstance(frame, Frame) else raw(frame, 10**12)) for frame in spoilt]


def _share(drive: Drive, mask: np.ndarray) -> float:
    """Of the ring's area."""
    radius, _ = polar(mask.shape, drive.config.ring.center_px)
    ring = (radius > drive.config.ring.r_min_px) & (radius < drive.config.ring.r_max_px)
    return float(np.mean(mask[ring]))


def _number(reason: str) -> int:
    return int("".join(c for c in reason if c.isdigit()))


def _wedge(drive: Drive, good: Grey, degrees: float) -> np.ndarray:
    """From a third of the way around."""
    _, angle = polar(good.shape, drive.config.ring.center_px)
    return np.asarray(np.mod(angle - TURN / 3.0, TURN) < np.deg2rad(degrees))


@pytest.mark.parametrize("degrees", [90.0, 150.0, 250.0, 360.0])
@pytest.mark.parametrize(("level", "word"), [(0, "black"), (7, "black"), (255, "white"), (252, "white")])
def test_a_black_or_white_part_of_the_ring_is_told_with_its_size(
    drive: Drive, good: Grey, degrees: float, level: int, word: str
) -> None:
    mask = _wedge(drive, good, degrees)
    told = _told(drive, np.where(mask, level, good).astype(np.uint8))[0].reasons
    mine = [reason for reason in told if reason.endswith(f"of the ring is {word}")]
    assert len(mine) == 1
    assert abs(_number(mine[0]) - 100.0 * _share(drive, mask)) <= 7.0  # rounded to tens, and what was so before


@pytest.mark.parametrize("level", [0, 255])
def test_a_small_black_or_white_part_is_no_fault(drive: Drive, good: Grey, level: int) -> None:
    assert _told(drive, np.where(_wedge(drive, good, 30.0), level, good).astype(np.uint8))[0].reasons == ()


def test_many_small_dark_things_are_no_cover(drive: Drive, good: Grey) -> None:
    """A third of the ring, but in no direction most of it."""
    radius, _ = polar(good.shape, drive.config.ring.center_px)
    band = np.abs(radius - 170.0) < 25.0
    assert _share(drive, band) > 0.3
    told = _told(drive, np.where(band, 5, good).astype(np.uint8))[0].reasons
    assert not any("black" in reason for reason in told)


@pytest.mark.parametrize("part", [0.3, 0.5, 0.7])
def test_a_jpeg_that_breaks_off_before_its_end_marker_is_told(drive: Drive, good: Grey, part: float) -> None:
    jpeg = np.asarray(cv2.imencode(".jpg", good)[1], dtype=np.uint8).ravel()
    ended = np.concatenate((jpeg[: int(part * jpeg.size)], np.array([0xFF, 0xD9], dtype=np.uint8)))
    frame = Frame(10**12, PixelFormat.JPEG, good.shape[1], good.shape[0], ended)
    same = np.flatnonzero(np.any(grey_from_frame(frame)[:, 2:-2] != grey_from_frame(frame)[-1, -1], axis=1))
    told = [reason for reason in _told(drive, frame)[0].reasons if reason.startswith("picture breaks off")]
    assert len(told) == 1
    assert abs(_number(told[0]) - 100.0 * (1.0 - same[-1] / good.shape[0])) <= 8.0


def test_a_grey_floor_below_the_ring_is_no_break(drive: Drive, good: Grey) -> None:
    below = good.copy()
    below[int(drive.config.ring.center_px[1] + drive.config.ring.r_max_px) - 30 :] = 77
    assert not any("breaks off" in reason for reason in _told(drive, below)[0].reasons)


@pytest.mark.parametrize("degrees", [3.0, 4.5, 9.0])
def test_a_turn_while_the_shutter_is_open_is_told(drive: Drive, good: Grey, degrees: float) -> None:
    picture = turned(good, drive.config.ring.center_px, float(np.deg2rad(degrees)))
    bad, after = _told(drive, picture, good)
    assert bad.reasons == (SMEARED,)
    assert after.reasons == ()


def test_a_camera_that_stays_out_of_focus_is_told_at_first_and_then_taken_as_it_is(drive: Drive, good: Grey) -> None:
    blurred = np.asarray(cv2.GaussianBlur(good, (0, 0), 3.0), dtype=np.uint8)
    seen = _told(drive, *[blurred] * 40)
    assert SMEARED in seen[0].reasons
    assert SMEARED not in seen[-1].reasons


@pytest.mark.parametrize("factor", [0.5, 0.6, 1.4])
def test_another_exposure_is_no_smear(drive: Drive, good: Grey, factor: float) -> None:
    assert _told(drive, np.clip(np.rint(good * factor), 0, 255).astype(np.uint8))[0].reasons == ()


def test_a_part_without_edges_is_told_when_it_had_some(drive: Drive, good: Grey) -> None:
    mask = _wedge(drive, good, 180.0)
    told = _told(drive, np.where(mask, 110, good).astype(np.uint8))[0].reasons
    assert [_number(reason) for reason in told if reason.startswith("hardly an edge")] in ([40], [50])


def test_a_cover_of_the_whole_ring_is_no_smear(drive: Drive, good: Grey) -> None:
    radius, _ = polar(good.shape, drive.config.ring.center_px)
    told = _told(drive, np.where(radius < drive.config.ring.r_max_px - 3.0, 110, good).astype(np.uint8))[0].reasons
    assert [_number(reason) for reason in told if reason.startswith("hardly an edge")] == [100]
    assert SMEARED not in told


def test_white_is_told_by_area(drive: Drive, good: Grey) -> None:
    """The outer half of the radii is more than half of the ring."""
    radius, _ = polar(good.shape, drive.config.ring.center_px)
    ring = drive.config.ring
    outer = (radius > 0.5 * (ring.r_min_px + ring.r_max_px)) & (radius < ring.r_max_px - 3.0)
    told = _told(drive, np.where(outer, 255, good).astype(np.uint8))[0].reasons
    white = [_number(reason) for reason in told if reason.endswith("white")]
    assert len(white) == 1
    assert abs(white[0] - 100.0 * _share(drive, outer)) <= 7.0


def test_a_bare_room_is_no_fault(scene: Callable[..., Grey], drive: Drive) -> None:
    angles = np.array([-2.0, -1.0, 0.5, 2.0])
    front = FrontEnd(drive.config)
    for k in range(6):
        picture = scene(angles + 0.02 * k, np.array([60.0, 180.0, 90.0, 200.0]))
        assert front.step(raw(picture, k)).reasons == ()


def venetian(config: Config, edges: int, seed: int = 0) -> Grey:
    """So many radial edges at even angles, between levels by chance; four samples a pixel each way."""
    height, width, fine = config.camera.height_px, config.camera.width_px, 4
    level = np.random.default_rng(seed).integers(20, 250, edges).astype(np.float32)
    u0, v0 = ((place + 0.5) * fine - 0.5 for place in config.ring.center_px)
    radius, angle = polar((height * fine, width * fine), (u0, v0))
    inside = (radius < config.ring.r_max_px * fine) & (radius > config.ring.r_min_px * fine)
    picture = np.where(inside, level[((angle / TURN + 0.5) * edges).astype(int) % edges], 0.0)
    return np.asarray(np.rint(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)), dtype=np.uint8)


@pytest.mark.parametrize(("edges", "most"), [(3000, 40), (700, 200)])
def test_more_lines_than_are_kept_are_told_with_both_numbers(drive: Drive, edges: int, most: int) -> None:
    vision = drive.config.vision.model_copy(update={"max_lines": most})
    seen = FrontEnd(drive.config.model_copy(update={"vision": vision})).step(raw(venetian(drive.config, edges), 0))
    told = [reason for reason in seen.reasons if reason.endswith(f"lines found, the strongest {most} kept")]
    assert len(told) == 1
    assert most < int(told[0].split()[0]) <= edges
    assert seen.track_id.size <= most


def test_how_many_lines_are_found_does_not_hang_on_how_many_are_kept(drive: Drive) -> None:
    found = []
    for most in (40, 2000):
        vision = drive.config.vision.model_copy(update={"max_lines": most})
        work = Work(raw(venetian(drive.config, 700), 0))
        for stage in FrontEnd(drive.config.model_copy(update={"vision": vision})).stages:
            stage.run(work)
        found.append(work.lines.found)
    assert found[0] == pytest.approx(found[1], rel=0.2)


def test_as_many_lines_as_are_kept_are_no_fault(drive: Drive, good: Grey) -> None:
    work = Work(raw(good, 0))
    for stage in FrontEnd(drive.config).stages:
        stage.run(work)
    found = work.lines.angle_rad.size
    for most, told in ((found, 0), (found - 1, 1)):
        vision = drive.config.vision.model_copy(update={"max_lines": most})
        seen = FrontEnd(drive.config.model_copy(update={"vision": vision})).step(raw(good, 0))
        assert len(seen.reasons) == told, seen.reasons


@pytest.mark.parametrize(("bad", "least"), [(1, 0.95), (3, 0.6)])
def test_tracks_go_on_when_the_blinds_are_gone_again(bad: int, least: float) -> None:
    """They took the place of so many frames of a straight drive; of the tracks that go through undisturbed."""
    drive = corridor(AT - BEFORE, AT + 4)
    blinds = [venetian(drive.config, 3000), venetian(drive.config, 700, 1), venetian(drive.config, 3000, 2)]
    frames = list(drive.frames)
    frames[BEFORE : BEFORE + bad] = [raw(picture, frames[BEFORE].stamp_ns) for picture in blinds[:bad]]
    front, other = FrontEnd(drive.config), FrontEnd(drive.config)
    seen = [front.step(frame) for frame in frames]
    undisturbed = [other.step(frame).track_id for frame in drive.frames]
    assert seen[BEFORE + bad].reasons == ()
    through = np.intersect1d(undisturbed[BEFORE - 1], undisturbed[BEFORE + bad])
    assert np.isin(through, seen[BEFORE + bad].track_id).mean() > least


def test_a_good_picture_after_many_of_blinds_is_no_smear(drive: Drive, good: Grey) -> None:
    blinds = venetian(drive.config, 3000)
    assert _told(drive, *[blinds] * 20, good)[-1].reasons == ()


def test_a_smear_is_told_by_one_who_keeps_few_lines(drive: Drive, good: Grey) -> None:
    vision = drive.config.vision.model_copy(update={"max_lines": 40})
    front = FrontEnd(drive.config.model_copy(update={"vision": vision}))
    for frame in drive.frames[:BEFORE]:
        assert len(front.step(frame).reasons) == 1
    assert SMEARED in front.step(raw(turned(good, drive.config.ring.center_px, np.deg2rad(9.0)), 10**12)).reasons


def test_3000_edges_cost_a_bounded_multiple_of_a_normal_frame(drive: Drive, good: Grey) -> None:
    """Least of some in one run, one after the other: what else the machine does can only add to either."""
    pictures = {"corridor": good, "blinds": venetian(drive.config, 3000)}
    fronts = {name: FrontEnd(drive.config) for name in pictures}
    took: dict[str, list[float]] = {name: [] for name in pictures}
    for k in range(6):
        for name, picture in pictures.items():
            began = time.perf_counter()
            fronts[name].step(raw(picture, k))
            took[name].append(time.perf_counter() - began)
    assert min(took["blinds"]) < 8.0 * min(took["corridor"])


def test_looking_for_faults_takes_a_small_part_of_a_frame(drive: Drive) -> None:
    """Of the whole step, which it is a part of; least of some."""
    front = FrontEnd(drive.config)
    took: dict[str, list[float]] = {stage.name: [] for stage in front.stages}
    for _ in range(4):
        for frame in drive.frames:
            work = Work(frame)
            for stage in front.stages:
                began = time.perf_counter()
                stage.run(work)
                took[stage.name].append(time.perf_counter() - began)
    assert min(took["faults"]) < 0.05 * sum(min(times) for times in took.values())


def test_no_frame_of_the_corridor_is_said_to_have_a_fault() -> None:
    drive = as_recorded()
    front = FrontEnd(drive.config)
    assert {reason for frame in drive.frames for reason in front.step(frame).reasons} == set()
