"""Lines that are not seen for a while, in painted pictures of a mirror that turns on meanwhile."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.bench.vision import raw
from omnivert.config import Config, Vision
from omnivert.messages import Bearings, Frame
from omnivert.vision.frontend import FrontEnd
from omnivert.vision.lines import no_lines
from omnivert.vision.tracker import Tracker
from tests.vision.painting import polar
from tests.vision.test_tracker import World

Float = NDArray[np.float64]

CENTER = (160.0, 120.0)
R_MIN, R_MAX = 30.0, 105.0
TURN_A_FRAME = 0.04  # rad
MIDDLE = np.array([-2.7, -1.6, -0.8, 0.3, 1.2, 2.2])  # of bars before a wall
HALF = np.array([0.09, 0.14, 0.08, 0.17, 0.11, 0.20])
LEVEL = np.array([200.0, 20.0, 190.0, 40.0, 170.0, 220.0])
WALL = 100.0
EVERY = range(MIDDLE.size)


def _frame(k: int, bars: range | list[int] = EVERY) -> Frame:
    """The k-th of a drive that turns on the spot; each bar that is seen has two edges."""
    radius, angle = polar((240, 320), CENTER)
    picture = np.full(radius.shape, WALL)
    for i in bars:
        across = (HALF[i] - np.abs(wrap(angle - MIDDLE[i] - TURN_A_FRAME * k))) * radius
        picture += (LEVEL[i] - picture) * np.clip(across + 0.5, 0.0, 1.0)
    picture *= np.clip(R_MAX - radius + 0.5, 0.0, 1.0) * np.clip(radius - R_MIN + 0.5, 0.0, 1.0)
    noise = np.random.default_rng(k).normal(0.0, 1.0, radius.shape)
    return raw(np.asarray(np.clip(np.rint(picture + noise), 0, 255), dtype=np.uint8), k * 100_000_000)


def _front(mode: str, **vision: int) -> FrontEnd:
    ring = {"center_px": CENTER, "r_min_px": R_MIN, "r_max_px": R_MAX}
    camera = {"width_px": 320, "height_px": 240}
    return FrontEnd(Config.model_validate({"camera": camera, "ring": ring, "vision": {"mode": mode, **vision}}))


def _by_edge(seen: Bearings, k: int) -> dict[tuple[int, int], int]:
    """Identity by bar and side; each line must be one of them."""
    found = {}
    for track, bearing in zip(seen.track_id, seen.bearing_rad, strict=True):
        off = wrap(float(bearing) - TURN_A_FRAME * k - np.stack((MIDDLE - HALF, MIDDLE + HALF), axis=1))
        bar, side = (int(n) for n in np.unravel_index(int(np.argmin(np.abs(off))), off.shape))
        assert abs(off[bar, side]) < np.deg2rad(0.5)
        found[bar, side] = int(track)
    return found


@pytest.mark.parametrize("blank", [1, 3, 8])
def test_tracks_survive_frames_without_lines_while_the_robot_turns_on(blank: int) -> None:
    front = _front("default")
    for k in range(5):
        before = front.step(_frame(k))
    first = _by_edge(before, 4)
    assert len(first) == 12
    for k in range(5, 5 + blank):
        empty = front.step(_frame(k, []))
        assert empty.track_id.size == 0
        assert empty.reasons[0] == "no lines"
        assert empty.ring is not None
    k = 5 + blank
    after = front.step(_frame(k))
    assert _by_edge(after, k) == first
    assert after.age_frames.tolist() == [k] * 12


@pytest.mark.parametrize(("covered", "known"), [(1, True), (4, True), (5, False), (9, False)])
def test_a_bar_covered_for_less_than_the_look_back_comes_back_as_itself(covered: int, known: bool) -> None:
    front = _front("default", lookback_frames=5)
    for k in range(5):
        before = _by_edge(front.step(_frame(k)), k)
    for k in range(5, 5 + covered):
        meanwhile = _by_edge(front.step(_frame(k, [0, 1, 2, 4, 5])), k)
        assert meanwhile == {edge: track for edge, track in before.items() if edge[0] != 3}
    k = 5 + covered
    seen = front.step(_frame(k))
    after = _by_edge(seen, k)
    if known:
        assert after == before
    else:
        assert {edge: track for edge, track in after.items() if edge[0] != 3} == meanwhile
        assert sorted((after[3, 0], after[3, 1])) == [12, 13]  # no number is used twice
        assert seen.age_frames[-2:].tolist() == [0, 0]


def _changed(descriptor: Float, rng: np.random.Generator) -> NDArray[np.float32]:
    """Descriptors at about 0.8 from what they were: as far from a line's own as a look-alike's are."""
    raw_rows = np.abs(descriptor + rng.normal(0.0, 0.075, descriptor.shape))
    return np.asarray(np.sqrt(3.0) * raw_rows / np.linalg.norm(raw_rows, axis=1, keepdims=True), dtype=np.float32)


@pytest.mark.parametrize("turn", [0.06, -0.06])
def test_the_turn_goes_on_while_nothing_tells_of_it(turn: float) -> None:
    """Three frames show no lines, and the next one's look so different that only their places make them known."""
    world, tracker, every = World(12, seed=7), Tracker(Vision()), np.arange(12)
    rng = np.random.default_rng(0)
    for k in range(6):
        before = tracker.step(*world.seen(every, turn=turn * k))
    for _ in range(3):
        tracker.step(no_lines(), np.empty((0, 192), dtype=np.float32))
        assert tracker.common_turn_rad == pytest.approx(turn, abs=2e-3)
    lines, descriptor = world.seen(every, turn=turn * 9)
    new = _changed(descriptor.astype(np.float64), rng)
    assert np.min(np.linalg.norm(new - world.descriptor, axis=1)) > 0.7
    after = tracker.step(lines, new)
    assert np.array_equal(after.track_id, before.track_id)
    assert np.array_equal(after.line, before.line)
