import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Vision
from omnivert.vision.assignment import assigned
from omnivert.vision.lines import Lines, no_lines
from omnivert.vision.motion import common_turn
from omnivert.vision.tracker import Tracked, Tracker

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]


def lines_at(angle: Float, std: Float, polarity: NDArray[np.int64], strength: Float) -> Lines:
    """Lines that meet the centre and span the ring."""
    none = np.zeros(angle.size)
    return Lines(angle, std, polarity, strength, none + 63.0, none + 225.0, none, none, none + 1.0, none)


class World:
    """Lines with fixed descriptors, seen with a little noise."""

    def __init__(self, count: int, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.angle = wrap(np.sort(self.rng.uniform(-np.pi, np.pi, count)))
        self.polarity = self.rng.choice([-1, 1], count).astype(np.int64)
        raw = np.abs(self.rng.normal(size=(count, 192)))
        self.descriptor = np.sqrt(3.0) * raw / np.linalg.norm(raw, axis=1, keepdims=True)

    def seen(self, which: NDArray[np.int64], turn: float = 0.0, strength: float = 1.0) -> tuple[Lines, Float32]:
        n = which.size
        angle = wrap(self.angle[which] + turn + self.rng.normal(0.0, 1e-3, n))
        noise = self.rng.normal(0.0, 0.01, (n, 192))
        lines = lines_at(angle, np.full(n, 1e-3), self.polarity[which], np.full(n, strength))
        return lines, (self.descriptor[which] + noise).astype(np.float32)


NOTHING = (no_lines(), np.empty((0, 192), dtype=np.float32))
MODES = pytest.mark.parametrize("mode", ["default", "paper"])


def _tracker(mode: str, **settings: int) -> Tracker:
    return Tracker(Vision.model_validate({"mode": mode, **settings}))


def _ids(tracked: Tracked, which: NDArray[np.int64]) -> dict[int, int]:
    """Identity by line of the world."""
    return {int(which[line]): int(track) for line, track in zip(tracked.line, tracked.track_id, strict=True)}


@MODES
def test_identities_count_up_from_zero_and_last(mode: str) -> None:
    world, tracker, every = World(12), _tracker(mode), np.arange(12)
    first = tracker.step(*world.seen(every))
    assert first.track_id.tolist() == list(range(12))
    assert first.age_frames.tolist() == [0] * 12
    for age in range(1, 6):
        again = tracker.step(*world.seen(every, turn=0.02 * age))
        assert _ids(again, every) == _ids(first, every)
        assert again.age_frames.tolist() == [age] * 12


@MODES
@pytest.mark.parametrize("turn", [0.5, -1.5, 3.0])
def test_any_turn_between_two_frames_is_followed(mode: str, turn: float) -> None:
    world, tracker, every = World(15, seed=1), _tracker(mode), np.arange(15)
    first = _ids(tracker.step(*world.seen(every)), every)
    assert _ids(tracker.step(*world.seen(every, turn=turn)), every) == first


@MODES
@pytest.mark.parametrize(("away", "known"), [(0, True), (19, True), (20, False), (40, False)])
def test_a_line_out_of_sight_is_looked_for_twenty_frames_back(mode: str, away: int, known: bool) -> None:
    world, tracker, every = World(10, seed=2), _tracker(mode), np.arange(10)
    before = _ids(tracker.step(*world.seen(every)), every)
    for _ in range(away):
        tracker.step(*world.seen(every[1:]))
    after = _ids(tracker.step(*world.seen(every)), every)
    assert {k: after[k] for k in range(1, 10)} == {k: before[k] for k in range(1, 10)}
    assert (after[0] == before[0]) is known
    if not known:
        assert after[0] == 10  # no number is used twice


@MODES
def test_all_lines_gone_for_a_while_come_back_as_themselves(mode: str) -> None:
    world, tracker, every = World(10, seed=3), _tracker(mode), np.arange(10)
    before = _ids(tracker.step(*world.seen(every)), every)
    for _ in range(5):
        assert tracker.step(*NOTHING).track_id.size == 0
    after = tracker.step(*world.seen(every))
    assert _ids(after, every) == before
    assert after.age_frames.tolist() == [6] * 10


def test_polarity_tells_two_sides_of_a_bar_apart() -> None:
    tracker = _tracker("default")
    same = np.abs(np.random.default_rng(0).normal(size=(1, 192))).astype(np.float32)
    same = np.repeat(np.sqrt(3.0) * same / np.linalg.norm(same), 2, axis=0).astype(np.float32)
    for frame in range(5):
        angle = np.array([0.5, 0.51]) + 0.01 * frame
        lines = lines_at(angle, np.full(2, 1e-3), np.array([1, -1]), np.ones(2))
        assert tracker.step(lines, same).track_id.tolist() == [0, 1]


def test_look_alikes_are_told_apart_by_where_they_are() -> None:
    tracker = _tracker("default")
    same = np.full((4, 192), np.sqrt(3.0 / 192.0), dtype=np.float32)
    for frame in range(8):
        angle = wrap(np.array([-2.0, -1.0, 0.5, 1.2]) + 0.06 * frame)
        lines = lines_at(angle, np.full(4, 1e-3), np.ones(4, dtype=np.int64), np.ones(4))
        assert tracker.step(lines, same).track_id.tolist() == [0, 1, 2, 3]


def test_a_weak_line_continues_a_track_but_begins_none() -> None:
    world, tracker, every = World(6, seed=4), _tracker("default"), np.arange(6)
    weak = Vision().min_length - 0.01
    assert tracker.step(*world.seen(every, strength=weak)).track_id.size == 0
    assert tracker.step(*world.seen(every)).track_id.tolist() == list(range(6))
    assert tracker.step(*world.seen(every, strength=weak)).track_id.tolist() == list(range(6))


@MODES
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_identity_is_given_twice_whatever_comes(mode: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracker, born = _tracker(mode, lookback_frames=3), 0
    few = np.abs(rng.normal(size=(4, 192)))
    few = np.sqrt(3.0) * few / np.linalg.norm(few, axis=1, keepdims=True)
    for _ in range(8):
        n = int(rng.integers(0, 12))
        angle = np.sort(wrap(rng.uniform(-np.pi, np.pi, n)))
        lines = lines_at(angle, np.full(n, 1e-3), rng.choice([-1, 1], n).astype(np.int64), rng.uniform(0.2, 1.0, n))
        noise = rng.normal(0.0, 0.01, (n, 192))
        tracked = tracker.step(lines, (few[rng.integers(0, 4, n)] + noise).astype(np.float32))
        assert np.unique(tracked.track_id).size == tracked.track_id.size
        assert np.unique(tracked.line).size == tracked.line.size
        assert np.all(np.diff(tracked.track_id) > 0)
        new = tracked.track_id[tracked.age_frames == 0]
        assert new.tolist() == list(range(born, born + new.size))
        born += new.size


def test_the_common_turn_is_where_look_alikes_agree_and_none_when_nothing_does() -> None:
    angle = np.random.default_rng(6).uniform(-np.pi, np.pi, 20)
    D = np.where(np.eye(20, dtype=np.bool_), 0.3, 1.3)
    sides = np.ones(20, dtype=np.int64)
    assert common_turn(wrap(angle + 2.5), angle, D, sides, sides) == pytest.approx(2.5, abs=1e-3)
    assert common_turn(wrap(angle + 2.5), angle, np.full((20, 20), 1.5), sides, sides) is None
    assert common_turn(wrap(angle + 2.5), angle, D, sides, -sides) is None
    assert common_turn(angle[:0], angle[:3], np.empty((0, 3)), sides[:0], sides[:3]) is None


@given(n=st.integers(0, 4), m=st.integers(0, 4), seed=st.integers(0, 1000))
def test_the_assignment_is_the_cheapest_of_all(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.0, 12.0, (n, m))
    allowed = (cost < 10.0) & (rng.uniform(size=(n, m)) < 0.7)
    cost[~allowed & (cost < 10.0)] = np.inf

    def cheapest(row: int, free: frozenset[int]) -> float:
        if row == n:
            return 0.0
        options = [10.0 + cheapest(row + 1, free)]
        options += [cost[row, j] + cheapest(row + 1, free - {j}) for j in free if allowed[row, j]]
        return min(options)

    match = assigned(cost, 10.0)
    pairs = np.flatnonzero(match >= 0)
    assert np.all(allowed[pairs, match[pairs]])
    total = float(np.sum(cost[pairs, match[pairs]])) + 10.0 * (n - pairs.size)
    assert total == pytest.approx(cheapest(0, frozenset(range(m))))
