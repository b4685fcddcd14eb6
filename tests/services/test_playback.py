"""The playback's pace: never ahead of its results by more than allowed, never stuck; its clock; its rounds."""

import itertools
import threading
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.config import Config
from omnivert.config import Timeline as Settings
from omnivert.errors import DataError
from omnivert.messages import (
    Bearings,
    Estimate,
    Extrinsics,
    Frame,
    Message,
    Mount,
    ParameterVerdict,
    PixelFormat,
    Receipt,
    State,
    Ticks,
)
from omnivert.timeline import Timeline
from omnivert.wire.channels import TICKS
from omnivert.wire.received import Received
from omnivert.wire.recording import Recording, RecordingWriter
from services import _clock, player
from services._ahead import read_ahead
from services._clock import Clock
from services._controls import Controls
from services._credits import Credits
from services._excerpt import Excerpt
from services._repeater import Repeater

MS = 1_000_000
SECOND = 1000 * MS


def ticks(stamp_ns: int, left: int = 0) -> Ticks:
    return Ticks(stamp_ns, left, 2 * left)


def frame(stamp_ns: int) -> Frame:
    return Frame(stamp_ns, PixelFormat.PNG, 4, 4, np.zeros(3, np.uint8))


def bearings(stamp_ns: int) -> Bearings:
    none = np.zeros(0)
    return Bearings(stamp_ns, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))


def estimate(stamp_ns: int) -> Estimate:
    verdict = ParameterVerdict(State.NOT_YET)
    return Estimate(stamp_ns, 1, None, State.NOT_YET, verdict, verdict, verdict, "", 0.0, 0.0, 0, 0, 0)


class Consumers:
    """Vision and calibration without their work: real timeline, a frame's estimate once ticks have passed it."""

    def __init__(self) -> None:
        self._timeline = Timeline((Ticks, Bearings), Settings())
        self._waiting: deque[int] = deque()
        self._ticks_ns = -1

    def step(self, message: Message) -> list[Message]:
        out: list[Message] = []
        if isinstance(message, Frame):
            message = bearings(message.stamp_ns)
            out.append(message)
        for released in self._timeline.push(message, replay=True):
            if isinstance(released, Ticks):
                self._ticks_ns = released.stamp_ns
            else:
                self._waiting.append(released.stamp_ns)
            while self._waiting and self._waiting[0] <= self._ticks_ns:
                out.append(estimate(self._waiting.popleft()))
        return out


stamps = st.lists(st.integers(0, 50), unique=True, min_size=3).map(lambda s: [x * 10 * MS for x in sorted(s)])


@given(stamps, stamps, st.integers(1, 5))
def test_a_playback_whose_results_come_is_never_stuck(ticks_at: Any, frames_at: Any, ahead: Any) -> None:
    """Except over the first frames, which wait until both streams have begun."""
    begun = max(ticks_at[1], frames_at[1])
    both: list[Message] = [*map(ticks, ticks_at), *map(frame, frames_at)]
    messages = sorted(both, key=lambda m: (m.stamp_ns, isinstance(m, Frame)))
    consumers, credits = Consumers(), Credits(ahead)
    for message in messages:
        if isinstance(message, Frame) and message.stamp_ns > begun:
            assert credits.may_play(vision=True, calibration=True)
        credits.played(message)
        for result in consumers.step(message):
            credits.seen(result)


@given(st.integers(1, 6), st.booleans())
def test_a_playback_without_results_stops_at_the_allowed_number_of_frames(ahead: Any, calibration: Any) -> None:
    credits = Credits(ahead)
    played = 0
    for i in range(50):
        credits.played(ticks(i * MS))
        if not credits.may_play(vision=not calibration, calibration=calibration):
            break
        credits.played(frame(i * MS))
        played += 1
    assert played == ahead + (1 if calibration else 0)  # the newest frame's estimate needs a later one
    assert credits.give_up(vision=True, calibration=True) == credits.lost == played
    assert credits.may_play(vision=True, calibration=True)
    assert credits.complete(vision=True, calibration=True)


def test_a_playback_that_nobody_consumes_goes_on() -> None:
    credits = Credits(1)
    for i in range(50):
        credits.played(frame(i))
        assert credits.may_play(vision=False, calibration=False)


def test_a_playback_is_complete_when_every_frame_has_its_results() -> None:
    credits = Credits(4)
    for message in (ticks(0), frame(5), ticks(10)):
        credits.played(message)
    assert not credits.complete(vision=True, calibration=False)
    credits.seen(bearings(5))
    assert credits.complete(vision=True, calibration=False)
    assert not credits.complete(vision=True, calibration=True)
    credits.seen(estimate(5))
    assert credits.complete(vision=True, calibration=True)


# ------------------------------------------------------------------ clock


class Now:
    def __init__(self) -> None:
        self.s = 100.0

    def monotonic(self) -> float:
        return self.s


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_messages_are_due_in_proportion_to_their_stamps(speed: float, monkeypatch: pytest.MonkeyPatch) -> None:
    now = Now()
    monkeypatch.setattr(_clock, "time", now)
    clock = Clock(speed, longest_pause_s=60.0)
    due = []
    for i in range(100):
        left = clock.until(7 * SECOND + i * 33 * MS)
        due.append(now.s + left)
        now.s += max(left, 0.0) + 0.001  # each publication takes a while
    assert np.diff(due) == pytest.approx(np.full(99, 0.033 / speed), abs=1e-9)


def test_a_long_gap_is_shortened_and_a_standstill_is_not_made_up_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now = Now()
    monkeypatch.setattr(_clock, "time", now)
    clock = Clock(1.0, longest_pause_s=2.0)
    assert clock.until(0) == 0.0
    assert clock.until(1000 * SECOND) == pytest.approx(2.0)
    now.s += 2.0 + 5.0
    clock.stood_still(5.0)
    assert clock.until(1001 * SECOND) == pytest.approx(1.0)


def test_at_full_speed_everything_is_due_at_once() -> None:
    clock = Clock(0.0, longest_pause_s=60.0)
    assert [clock.until(i * SECOND) for i in range(3)] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("text", "speed"), [("full", 0.0), ("0", 0.0), ("2.5", 2.5)])
def test_a_speed_is_a_number_or_full(text: str, speed: float) -> None:
    assert player._speed(text) == speed


# ------------------------------------------------------------------ rounds


def recording(path: Path, messages: list[Message]) -> Recording:
    keys = {Ticks: "v1/encoder/base/ticks", Frame: "v1/camera/front/frame", Bearings: "v1/vision/front/bearings"}
    with RecordingWriter(path, Config()) as writer:
        for message in messages:
            writer.write(keys[type(message)], message)
    return Recording(path)


def test_in_a_loop_stamps_and_ticks_go_on_growing(tmp_path: Path) -> None:
    messages: list[Message] = [
        m for i in range(10) for m in (ticks(SECOND + i * 100 * MS, 7 * i), frame(SECOND + i * 100 * MS + 5))
    ]
    excerpt = Excerpt(recording(tmp_path / "a.mcap", messages), Config(), None, None)
    played = [message for message, _ in zip(excerpt.rounds(loop=True), range(60), strict=False)]
    all_stamps = [m.stamp_ns for m in played]
    assert all_stamps == sorted(all_stamps)
    assert len(set(all_stamps)) == 60
    counts = [m.left for m in played if isinstance(m, Ticks)]
    assert counts == sorted(counts)
    assert counts[-1] == 3 * 63
    frames = np.array([m.stamp_ns for m in played if isinstance(m, Frame)])
    assert np.diff(frames).max() < 150 * MS


def test_the_rounds_of_a_single_frame_follow_each_other_as_frames_do(tmp_path: Path) -> None:
    excerpt = Excerpt(recording(tmp_path / "a.mcap", [ticks(SECOND), frame(SECOND)]), Config(), None, None)
    played = [message for message, _ in zip(excerpt.rounds(loop=True), range(20), strict=False)]
    for kind in (Ticks, Frame):
        stamps = np.array([m.stamp_ns for m in played if isinstance(m, kind)])
        np.testing.assert_allclose(np.diff(stamps), SECOND / Config().camera.frame_rate_hz, atol=1)


def test_a_part_of_a_recording_is_played(tmp_path: Path) -> None:
    messages: list[Message] = [ticks(i * 100 * MS) for i in range(100)]
    excerpt = Excerpt(recording(tmp_path / "a.mcap", messages), Config(), 2.0, 3.0)
    assert [m.stamp_ns for m in excerpt.rounds(loop=False)] == [i * 100 * MS for i in range(20, 30)]
    assert excerpt.count() == 10


@pytest.mark.parametrize(("from_s", "to_s"), [(5.0, 3.0), (100.0, None), (None, 0.0)])
def test_a_part_with_nothing_in_it_is_refused(tmp_path: Path, from_s: float | None, to_s: float | None) -> None:
    whole = recording(tmp_path / "a.mcap", [ticks(i * 100 * MS) for i in range(100)])
    with pytest.raises(DataError, match=r"in this part: it lasts 9\.9 s") as refused:
        Excerpt(whole, Config(), from_s, to_s)
    assert refused.value.code == "OV305"


def test_of_a_recording_without_frames_the_bearings_are_the_sensor(tmp_path: Path) -> None:
    messages: list[Message] = [m for i in range(5) for m in (ticks(i * MS), bearings(i * MS))]
    excerpt = Excerpt(recording(tmp_path / "a.mcap", messages), Config(), None, None)
    assert [type(m) for m in excerpt.rounds(loop=False)] == [Ticks, Bearings] * 5


def test_a_recording_without_sensor_data_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", Config()) as writer:
        writer.write("v1/calibration/front/estimate", estimate(1))
    with pytest.raises(DataError, match="no sensor data") as refused:
        Excerpt(Recording(tmp_path / "a.mcap"), Config(), None, None)
    assert refused.value.code == "OV305"


# ------------------------------------------------------------------ claims


def claim(stamp_ns: int) -> Extrinsics:
    mount = Mount(0.0, 0.1, 0.0, np.eye(3))
    return Extrinsics(stamp_ns, "r", "c", mount, State.CALIBRATED, 1, (), "omnivert 0", "0")


def cause(replay: bool = False) -> Received:
    ticks = Ticks(1, 0, 0)
    return Received(TICKS, "k", ticks, 0, replay, b"run", b"bridge", 0)


def test_a_claim_is_said_again_each_second_until_it_is_acknowledged() -> None:
    repeater = Repeater()
    a, b = (claim(1), cause()), (claim(2), cause())
    repeater.claim(*a, 0.0)
    repeater.claim(*b, 0.0)
    assert repeater.due(0.5) == ()
    assert repeater.due(1.0) == (a, b)
    assert repeater.due(1.5) == ()
    repeater.acknowledge(Receipt(1, "r", "c", 1))
    repeater.acknowledge(Receipt(2, "r", "another", 1))
    assert repeater.repeated
    assert repeater.due(2.0) == (b,)
    repeater.acknowledge(Receipt(2, "r", "c", 2))
    assert repeater.due(9.0) == ()
    assert not repeater.repeated
    assert repeater.newest is b[0]


def test_claims_that_nobody_acknowledges_are_bounded() -> None:
    repeater = Repeater()
    for i in range(100):
        repeater.claim(claim(i), cause(), 0.0)
    assert [c.stamp_ns for c, _ in repeater.due(1.0)] == list(range(84, 100))
    assert repeater.given_up == 84


def test_a_claim_of_a_playback_answers_nobody_who_could_not_see_that_it_is_one() -> None:
    repeater = Repeater()
    repeater.claim(claim(1), cause(replay=True), 0.0)
    assert repeater.newest is None
    ((_, again),) = repeater.due(1.0)
    assert again.replay


# ------------------------------------------------------------------ pause and step


presses = st.lists(st.sampled_from(["space", "step", "play", "play", "play", "play"]), max_size=60)


@given(presses)
def test_a_step_is_one_frame_and_all_that_comes_before_the_next(pressed: Any) -> None:
    """Every third message is a frame; beside the controls runs a model that counts frames alone."""
    controls, at, paused, due = Controls(), 0, False, 0

    def frames() -> int:
        """Among the messages played, of which the first is one."""
        return -(-at // 3)

    for press in pressed:
        match press:
            case "space":
                controls.pause_or_go()
                paused, due = not paused, 0
            case "step":
                controls.step()
                due = (due if paused and due > frames() else frames()) + 1
                paused = True
            case _:
                is_frame = at % 3 == 0
                may_play = not paused or (frames() < due or (due > 0 and frames() == due and not is_frame))
                assert controls.holds(is_frame) != may_play
                if may_play:
                    controls.played(is_frame)
                    at += 1


def test_whoever_waits_for_the_controls_is_woken_by_each_of_them() -> None:
    for press in (Controls.pause_or_go, Controls.step, Controls.end):
        controls = Controls()
        waiting = threading.Thread(target=controls.wait, args=(60.0,))
        waiting.start()
        while waiting.is_alive():
            press(controls)
            waiting.join(0.01)


def test_after_a_standstill_the_clock_goes_on_from_the_message_that_is_due(monkeypatch: pytest.MonkeyPatch) -> None:
    now = Now()
    monkeypatch.setattr(_clock, "time", now)
    clock = Clock(2.0, longest_pause_s=60.0)
    assert clock.until(5 * SECOND) == 0.0
    now.s += 100.0
    clock.due_now(7 * SECOND)
    assert clock.until(7 * SECOND) == pytest.approx(0.0)
    assert clock.until(8 * SECOND) == pytest.approx(0.5)


def test_the_clock_begins_with_the_first_message_however_long_that_took_to_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = Now()
    monkeypatch.setattr(_clock, "time", now)
    clock = Clock(1.0, longest_pause_s=60.0)
    now.s += 3.0
    assert [clock.until(0), clock.until(SECOND)] == [0.0, pytest.approx(1.0)]


# ------------------------------------------------------------------ reading ahead


@given(st.lists(st.integers(1, 10), max_size=40), st.integers(1, 15))
def test_what_is_read_ahead_is_the_same_and_bounded(items: Any, most: Any) -> None:
    read: list[int] = []

    def reading() -> Iterator[int]:
        for item in items:
            read.append(item)
            yield item

    taken = []
    with read_ahead(reading(), lambda item: item, most) as ahead:
        for item in ahead:
            taken.append(item)
            assert sum(read) - sum(taken) <= most + 20  # the one that reaches it, and the one that waits for room
    assert taken == items


def test_a_reader_that_is_left_ends_and_what_it_raises_comes_in_its_place() -> None:
    read = itertools.count()
    with read_ahead(read, lambda _: 1, 10) as ahead:
        assert next(read) >= 10, "it begins with all that may be ready"
        assert next(ahead) == 0

    def failing() -> Iterator[int]:
        yield 1
        raise OSError("the disk has gone")

    taken: list[int] = []
    with pytest.raises(OSError, match="the disk has gone"), read_ahead(failing(), lambda _: 1, 10) as ahead:
        taken.extend(ahead)
    assert taken == [1]
    assert not [thread for thread in threading.enumerate() if thread.name == "read-ahead"]
