"""Broken frames in the middle of the corridor: named, bounded, and forgotten afterwards."""

import time

import numpy as np
import pytest

from omnivert.angles import wrap
from omnivert.bench.vision import raw
from omnivert.messages import Bearings, Frame
from omnivert.vision.frontend import FrontEnd
from tests.vision.bad_frames import bad_frames, blinds, texture
from tests.vision.drive import Drive, corridor

STRAIGHT, TURN = 10, 70  # first frames of a stretch
BAD = 6  # the first bad frame of it

RING = "ring not in the picture"
NAMED = {
    "black": RING,
    "white": RING,
    "grey": RING,
    "saturated": RING,
    "underexposed": RING,
    "noise": RING,
    "texture": RING,
    "smeared": RING,
    "hand over all": RING,
    "empty mirror": "no lines",
    "half a jpeg": "cut off",
    "another size": "320x240, configured 640x480",
    "short": "holds 307199 bytes",
}
HARMFUL = (*NAMED, "half black", "a third black", "turning blur", "coarse blinds", "blinds", "half a jpeg, ended")


@pytest.fixture(scope="module")
def drive() -> Drive:
    return corridor()


@pytest.fixture(scope="module")
def bad(drive: Drive) -> dict[int, dict[str, Frame]]:
    return {first: bad_frames(drive.frames[first + BAD], drive.config) for first in (STRAIGHT, TURN)}


def _seen(drive: Drive, first: int, bad: Frame | None = None, count: int = 1) -> list[Bearings]:
    """Twelve frames of the drive, `count` of them replaced."""
    front, frames = FrontEnd(drive.config), list(drive.frames[first : first + 12])
    if bad is not None:
        frames[BAD : BAD + count] = [bad] * count
    return [front.step(frame) for frame in frames]


@pytest.fixture(scope="module")
def undisturbed(drive: Drive) -> dict[int, list[Bearings]]:
    return {first: _seen(drive, first) for first in (STRAIGHT, TURN)}


def _kept(undisturbed: list[Bearings], seen: list[Bearings], at: int) -> float:
    """Of the tracks that go through undisturbed, the share that does so here, on the same line."""
    _, i, _ = np.intersect1d(undisturbed[at].track_id, undisturbed[BAD - 1].track_id, return_indices=True)
    there = dict(zip(seen[at].track_id.tolist(), seen[at].bearing_rad.tolist(), strict=True))
    same = [
        abs(wrap(there.get(track, bearing + 3.0) - bearing)) < 0.012
        for track, bearing in zip(
            undisturbed[at].track_id[i].tolist(), undisturbed[at].bearing_rad[i].tolist(), strict=True
        )
    ]
    return float(np.mean(same))


@pytest.mark.parametrize("name", NAMED)
def test_a_bad_frame_says_what_is_wrong_with_it(drive: Drive, bad: dict[int, dict[str, Frame]], name: str) -> None:
    front = FrontEnd(drive.config)
    front.step(drive.frames[TURN + BAD - 1])
    seen = front.step(bad[TURN][name])
    assert any(NAMED[name] in reason for reason in seen.reasons), seen.reasons
    assert all(0 < len(reason) <= 1000 for reason in seen.reasons)


@pytest.mark.parametrize("name", ["black", "white", "grey", "texture", "hand over all", "half a jpeg", "another size"])
def test_nothing_to_see_gives_no_lines(drive: Drive, bad: dict[int, dict[str, Frame]], name: str) -> None:
    front = FrontEnd(drive.config)
    front.step(drive.frames[TURN + BAD - 1])
    assert front.step(bad[TURN][name]).track_id.size == 0


@pytest.mark.parametrize("first", [STRAIGHT, TURN])
@pytest.mark.parametrize("name", [name for name in HARMFUL if name != "smeared"])
def test_all_tracks_go_on_after_one_bad_frame(
    drive: Drive, bad: dict[int, dict[str, Frame]], undisturbed: dict[int, list[Bearings]], name: str, first: int
) -> None:
    seen = _seen(drive, first, bad[first][name])
    assert seen[BAD + 1].reasons == ()
    assert _kept(undisturbed[first], seen, BAD + 1) > 0.95  # measured 1.00
    ring, true = seen[BAD + 1].ring, drive.truth[first + BAD + 1].center_px
    assert ring is not None
    assert true is not None
    assert np.hypot(ring.center_u_px - true[0], ring.center_v_px - true[1]) < 0.1


@pytest.mark.parametrize("name", ["black", "half a jpeg", "noise", "smeared"])
def test_most_tracks_go_on_after_three_bad_frames_of_a_straight_drive(
    drive: Drive, bad: dict[int, dict[str, Frame]], undisturbed: dict[int, list[Bearings]], name: str
) -> None:
    seen = _seen(drive, STRAIGHT, bad[STRAIGHT][name], 3)
    assert _kept(undisturbed[STRAIGHT], seen, BAD + 3) > 0.5  # measured 0.60


def test_a_picture_that_never_had_a_ring_gives_nothing_and_says_so_each_time(drive: Drive) -> None:
    front = FrontEnd(drive.config)
    for k in range(3):
        seen = front.step(raw(texture((480, 640), 3.0, seed=k), k))
        assert seen.ring is None
        assert seen.track_id.size == 0
        assert RING in seen.reasons


@pytest.mark.parametrize("most", [20, 200])
@pytest.mark.parametrize("count", [100, 300, 1500])
def test_blinds_give_no_more_lines_than_are_kept(drive: Drive, count: int, most: int) -> None:
    vision = drive.config.vision.model_copy(update={"max_lines": most})
    front = FrontEnd(drive.config.model_copy(update={"vision": vision}))
    for k in range(3):
        assert front.step(raw(blinds(drive.config, count), k)).track_id.size <= most


def test_blinds_cost_a_bounded_multiple_of_a_normal_frame(drive: Drive) -> None:
    """Least of some in one run, one after the other: what else the machine does can only add to either."""
    front = {count: FrontEnd(drive.config) for count in (0, 300, 1500)}
    took: dict[int, list[float]] = {count: [] for count in front}
    pictures = {count: raw(blinds(drive.config, count), 0) for count in front if count}
    for k in range(6):
        for count in front:
            began = time.perf_counter()
            front[count].step(pictures.get(count, drive.frames[TURN + k]))
            took[count].append(time.perf_counter() - began)
    for count in (300, 1500):
        assert min(took[count]) < 8.0 * min(took[0])  # measured 3
