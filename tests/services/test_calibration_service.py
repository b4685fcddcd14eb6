"""What the calibration service does around its calibrator; the calibrator is replaced by one that only takes notes."""

import itertools
from typing import Any

import numpy as np
import pytest

import omnivert
from omnivert.calibration.smoothing import at_once
from omnivert.config import Config
from omnivert.messages import (
    Bearings,
    Estimate,
    Extrinsics,
    Message,
    Mount,
    ParameterVerdict,
    Playback,
    Receipt,
    State,
    Ticks,
)
from omnivert.pictures.notes import is_harmless
from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, PLAYBACK, RECEIPT, TICKS, Channel
from omnivert.wire.received import Received
from services import calibration

MS = 1_000_000
CHANNELS = {Ticks: TICKS, Bearings: BEARINGS, Playback: PLAYBACK, Receipt: RECEIPT}


class NotingCalibrator:
    """An estimate for each bearings at once, extrinsics with the third; remembers all it was given."""

    made: list["NotingCalibrator"]

    def __init__(self, config: Config, stored: Extrinsics | None = None, background: object = None) -> None:
        self.stored = stored
        self.given: list[Ticks | Bearings] = []
        self.closed = False
        self.refused: dict[str, int] = {}
        self.left_out = 0
        self.made.append(self)

    def step(self, message: Ticks | Bearings) -> tuple[Estimate | Extrinsics, ...]:
        self.given.append(message)
        if isinstance(message, Ticks):
            return ()
        if sum(isinstance(m, Bearings) for m in self.given) == 3:
            return estimate(message.stamp_ns), extrinsics(message.stamp_ns)
        return (estimate(message.stamp_ns),)

    def close(self) -> tuple[Estimate | Extrinsics, ...]:
        self.closed = True
        return ()

    @property
    def stamps(self) -> list[int]:
        return [m.stamp_ns // MS for m in self.given]


class QuietBus:
    """Takes down what a service says."""

    def __init__(self) -> None:
        self.published: list[tuple[Channel, Message, Received | None]] = []
        self.refused: dict[str, int] = {}
        self.notes: dict[str, str | None] = {}
        self.here: set[bytes] = set()
        self.answer: Extrinsics | None = None

    def publish(self, channel: Channel, message: Message, cause: Received | None = None) -> None:
        self.published.append((channel, message, cause))

    def refuse(self, reason: str, times: int = 1) -> None:
        self.refused[reason] = self.refused.get(reason, 0) + times

    def note(self, text: str | None, about: str = "") -> None:
        self.notes[about] = text

    def done(self, received: Received) -> None: ...

    def ask(self, channel: Channel) -> Extrinsics | None:
        return self.answer

    def alive(self, incarnation: bytes) -> bool:
        return incarnation in self.here


def estimate(stamp_ns: int) -> Estimate:
    verdict = ParameterVerdict(State.NOT_YET)
    return Estimate(stamp_ns, 1, None, State.NOT_YET, verdict, verdict, verdict, "", 0.0, 0.0, 0, 0, 0)


def extrinsics(stamp_ns: int, robot: str = "demo") -> Extrinsics:
    mount = Mount(0.1, 0.2, 0.3, 1e-4 * np.eye(3))
    software = f"omnivert {omnivert.__version__}"
    digest = Config().rig_digest()
    return Extrinsics(stamp_ns, robot, "front", mount, State.CALIBRATED, 9, (), software, digest)


class Drive:
    """Messages of one source, as the service would receive them."""

    def __init__(self, desk: Any, run: bytes, replay: bool = True, first: int = 0) -> None:
        self.desk, self.run, self.replay = desk, run, replay
        self.numbers = {kind: itertools.count(first) for kind in CHANNELS}

    def says(self, message: Message, publisher: bytes | None = None) -> None:
        kind = type(message)
        channel = CHANNELS[kind]
        self.desk.step(
            Received(
                channel,
                channel.key(Config()),
                message,
                0,
                self.replay,
                self.run,
                publisher or self.run,
                next(self.numbers[kind]),
            )
        )

    def plays(self, from_ms: int, to_ms: int, vision: bytes = b"vision-1") -> None:
        for ms in range(from_ms, to_ms, 10):
            self.says(Ticks(ms * MS, ms, ms))
            if ms % 20 == 0:
                self.says(bearings(ms * MS), vision)


def bearings(stamp_ns: int) -> Bearings:
    one = np.array([0.1])
    return Bearings(stamp_ns, np.array([7]), one, one, np.zeros(1, np.int32), np.ones(1, np.float32))


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> QuietBus:
    NotingCalibrator.made = []
    monkeypatch.setattr(calibration, "Calibrator", NotingCalibrator)
    return QuietBus()


def desk_on(bus: QuietBus, config: Config | None = None) -> Any:
    return calibration._Desk(bus, config or Config(), at_once)  # type: ignore[arg-type]


def test_the_calibrator_gets_both_streams_in_the_order_of_their_stamps(bus: QuietBus) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    for ms in (0, 20, 40, 60):
        drive.says(bearings(ms * MS))
    for ms in range(0, 70, 10):
        drive.says(Ticks(ms * MS, 0, 0))
    (calibrator,) = NotingCalibrator.made
    assert calibrator.stamps == [0, 0, 10, 20, 20, 30, 40, 40, 50, 60, 60]
    estimates = [(m.stamp_ns // MS, c.run) for ch, m, c in bus.published if ch is ESTIMATE and c]
    assert estimates == [(0, b"run-1"), (20, b"run-1"), (40, b"run-1"), (60, b"run-1")]


def test_a_second_playback_begins_with_a_fresh_calibrator_and_gives_the_same(bus: QuietBus) -> None:
    desk = desk_on(bus)
    Drive(desk, b"run-1").plays(0, 200)
    Drive(desk, b"run-2").plays(0, 200)
    first, second = NotingCalibrator.made
    assert first.stamps == second.stamps
    assert [m.stamp_ns for m in first.given] == [m.stamp_ns for m in second.given]


def test_what_was_left_of_the_playback_before_is_refused(bus: QuietBus) -> None:
    desk = desk_on(bus)
    old, new = Drive(desk, b"run-1"), Drive(desk, b"run-2")
    old.plays(0, 100)
    new.plays(0, 100)
    before = NotingCalibrator.made[-1].stamps
    old.says(bearings(500 * MS))
    assert len(NotingCalibrator.made) == 2
    assert NotingCalibrator.made[-1].stamps == before
    assert sum(bus.refused.values()) == 1


def test_strangers_are_not_heard_while_the_source_is_alive(bus: QuietBus) -> None:
    desk = desk_on(bus)
    bus.here = {b"run-1"}
    drive = Drive(desk, b"run-1")
    drive.plays(0, 100)
    for replay in (True, False):
        stranger = Drive(desk, b"stranger", replay)
        for stamp in (0, 100 * MS, 2**62):
            stranger.says(Ticks(stamp, 5, 5))
    drive.plays(100, 200)
    assert len(NotingCalibrator.made) == 1
    assert all(m.left == m.stamp_ns // MS for m in NotingCalibrator.made[0].given if isinstance(m, Ticks))
    assert sum(bus.refused.values()) == 6


def test_the_tracks_of_a_vision_service_that_came_anew_are_other_tracks(bus: QuietBus) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    drive.plays(0, 100, vision=b"vision-1")
    drive.plays(100, 200, vision=b"vision-2")
    seen = {int(m.track_id[0]) for m in NotingCalibrator.made[0].given if isinstance(m, Bearings)}
    assert seen == {7, 7 + 2**40}


def test_of_two_visions_the_first_is_heard_until_it_has_gone(bus: QuietBus) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    bus.here = {b"vision-1", b"vision-2"}
    for ms in range(0, 200, 20):
        drive.says(Ticks(ms * MS, ms, ms))
        for vision in (b"vision-1", b"vision-2"):
            drive.says(bearings(ms * MS), vision)
    bus.here = {b"vision-2"}
    drive.plays(200, 400, vision=b"vision-2")
    seen = [(m.stamp_ns // MS, int(m.track_id[0])) for m in NotingCalibrator.made[0].given if isinstance(m, Bearings)]
    assert seen == [(ms, 7 + (2**40 if ms >= 200 else 0)) for ms in range(0, seen[-1][0] + 20, 20)]
    assert seen[-1][0] > 300
    assert bus.refused == {"v1/vision/front/bearings: from another vision than the one that is heard": 10}


def test_at_the_end_of_a_playback_everything_that_waits_goes_through(bus: QuietBus) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    drive.plays(0, 100)
    drive.says(bearings(150 * MS))
    end = Playback(150 * MS, 1, 1, True, frame_ns=170 * MS, ticks_ns=90 * MS)
    drive.says(end)
    (calibrator,) = NotingCalibrator.made
    assert calibrator.stamps[-1] < 150
    assert not calibrator.closed
    drive.says(bearings(170 * MS))
    drive.says(end)
    assert calibrator.stamps[-2:] == [150, 170]
    assert calibrator.closed


@pytest.mark.parametrize("played", [3, 4])
def test_the_next_rounds_of_a_loop_claim_nothing_because_they_show_the_same_again(bus: QuietBus, played: int) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    drive.plays(0, 20)
    drive.says(Playback(20 * MS, played, 3, False))
    drive.plays(20, 200)
    published = [channel for channel, _, _ in bus.published]
    assert published.count(ESTIMATE) > 3
    assert (EXTRINSICS in published) == (played <= 3)
    assert ("nothing more of it is claimed" in (bus.notes["loop"] or "")) == (played > 3)


def test_the_end_of_another_playback_ends_nothing(bus: QuietBus) -> None:
    desk = desk_on(bus)
    Drive(desk, b"run-1").plays(0, 100)
    Drive(desk, b"stranger").says(Playback(0, 0, 0, True))
    assert not NotingCalibrator.made[0].closed


def test_a_service_that_ends_claims_what_it_knows(bus: QuietBus, monkeypatch: pytest.MonkeyPatch) -> None:
    desk = desk_on(bus)
    desk.close()
    drive = Drive(desk, b"run-1", replay=False)
    drive.plays(0, 100)
    final = extrinsics(90 * MS)
    monkeypatch.setattr(NotingCalibrator, "close", lambda _: (final,))
    desk.close()
    channel, message, cause = bus.published[-1]
    assert (channel, message, cause is not None and cause.run) == (EXTRINSICS, final, b"run-1")


# ------------------------------------------------------------------ storage


@pytest.mark.parametrize(
    ("replay", "first", "resumes"), [(False, 0, True), (False, 90, True), (True, 90, True), (True, 0, False)]
)
def test_the_stored_extrinsics_are_taken_up_except_by_a_playback_from_its_start(
    bus: QuietBus, replay: bool, first: int, resumes: bool
) -> None:
    bus.answer = extrinsics(5)
    Drive(desk_on(bus), b"run-1", replay, first).plays(0, 400)
    assert (NotingCalibrator.made[0].stored is bus.answer) is resumes
    assert bus.notes["resume"] is not None


@pytest.mark.parametrize(
    ("answer", "config", "why"),
    [
        (None, Config(), "nothing is stored"),
        (extrinsics(5, robot="other"), Config(), "stored for other/front"),
        (extrinsics(5), Config.model_validate({"robot": {"wheel_base_m": 0.7}}), "another rig"),
        (extrinsics(5), Config.model_validate({"calibration": {"resume": False}}), "resume is false"),
    ],
)
def test_when_nothing_is_taken_up_a_note_says_why(
    bus: QuietBus, answer: Extrinsics | None, config: Config, why: str
) -> None:
    bus.answer = answer
    Drive(desk_on(bus, config), b"run-1", replay=False).plays(0, 400)
    assert NotingCalibrator.made[0].stored is None
    assert why in str(bus.notes["resume"])


def test_a_claim_is_said_again_until_storage_has_it(bus: QuietBus) -> None:
    desk = desk_on(bus)
    drive = Drive(desk, b"run-1", replay=False)
    drive.plays(0, 200)
    claims = [m for channel, m, _ in bus.published if channel is EXTRINSICS]
    assert len(claims) == 1
    assert desk.claims.newest is claims[0]
    desk.keep_house(1e12)
    assert [m for channel, m, _ in bus.published if channel is EXTRINSICS] == 2 * claims
    assert "not acknowledged" in str(bus.notes["storage"])
    drive.says(Receipt(claims[0].stamp_ns, "demo", "front", 1))
    desk.keep_house(2e12)
    assert len([m for channel, m, _ in bus.published if channel is EXTRINSICS]) == 2
    assert bus.notes["storage"] is None


def test_what_is_said_again_of_a_playback_is_still_of_a_playback(bus: QuietBus) -> None:
    desk = desk_on(bus)
    Drive(desk, b"run-1").plays(0, 200)
    desk.keep_house(1e12)
    causes = [cause for channel, _, cause in bus.published if channel is EXTRINSICS]
    assert [cause is not None and cause.replay for cause in causes] == [True, True]


def test_what_the_timeline_refuses_is_counted_once(bus: QuietBus) -> None:
    drive = Drive(desk_on(bus), b"run-1")
    drive.plays(0, 100)
    drive.says(Ticks(2**62, 0, 0))
    drive.plays(100, 300)
    assert bus.refused == {"Ticks: stamp far ahead": 1}


def test_lines_that_were_too_many_are_told_and_are_no_trouble(bus: QuietBus) -> None:
    desk = desk_on(bus)
    drive = Drive(desk, b"run-1")
    drive.plays(0, 100)
    assert bus.notes["lines"] is None
    NotingCalibrator.made[0].left_out = 1900
    drive.plays(100, 200)
    told = str(bus.notes["lines"])
    assert told == "more lines than calibration.frame_lines = 100 in a frame, 1900 left out so far"
    assert is_harmless(told)
    assert bus.refused == {}
    Drive(desk, b"run-2").plays(0, 100)
    assert bus.notes["lines"] is None


def test_a_clock_that_has_changed_begins_another_drive_and_the_last_word_on_the_first_is_said(bus: QuietBus) -> None:
    desk = desk_on(bus)
    drive = Drive(desk, b"run-1", replay=False)
    drive.plays(5000, 5300)
    (before,) = NotingCalibrator.made
    before.refused = {"ticks: a jump that no wheel can make": 3}
    bus.answer = extrinsics(5)
    drive.plays(100, 400)
    before, after = NotingCalibrator.made
    assert before.closed
    assert before.stamps == sorted(before.stamps)
    assert before.stamps[0] == 5000
    assert after.stamps == sorted(after.stamps)
    assert after.stamps[0] < 200  # what has shown that the clock has changed is not lost
    assert after.stored is bus.answer
    after.refused = {"ticks: a jump that no wheel can make": 2}
    drive.plays(400, 500)
    assert len(NotingCalibrator.made) == 2
    assert bus.refused["stamps: the clock has changed, another drive begins"] == 1
    assert bus.refused["ticks: a jump that no wheel can make"] == 5
