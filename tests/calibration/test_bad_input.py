"""What no robot should send: nothing raises, waits for ever or grows, and each has a reason or is counted."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.ekf import Filter, Rules
from omnivert.calibration.kalman.watchdog import Watchdog, WatchRules
from omnivert.calibration.solver.stretch import Stretch
from omnivert.calibration.waiting import MOST_HELD
from omnivert.calibration.way import KEPT_NS
from omnivert.config import Calibration, Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Mount, State, Ticks
from omnivert.simulation.recording import Knock, Scene, recorded

Array = NDArray[np.float64]
SECOND = 1_000_000_000
AROUND = np.linspace(-3.0, 3.0, 8)


def frame(stamp_ns: int, first: int = 0, beta: Array = AROUND, std: float = 0.003) -> Bearings:
    n = beta.size
    few = np.zeros(n, dtype=np.int32)
    return Bearings(stamp_ns, first + np.arange(n), beta, np.full(n, std), few, np.ones(n, dtype=np.float32))


def told(calibrator: Calibrator, messages: list[Ticks | Bearings]) -> list[Estimate]:
    out = [word for message in messages for word in calibrator.step(message)]
    return [word for word in out if isinstance(word, Estimate)]


def driven(frames: int, begin_ns: int = 0, counts: int = 0, std: float = 0.003) -> list[Ticks | Bearings]:
    """Straight on and round in turn, whatever the bearings say."""
    out: list[Ticks | Bearings] = []
    left = right = counts
    for k in range(frames):
        left, right = (left + 60, right + 60) if k % 20 < 10 else (left - 40, right + 40)
        stamp = begin_ns + k * SECOND // 3
        out += [Ticks(stamp, left, right), frame(stamp, std=std)]
    return out


@pytest.mark.parametrize(
    "covariance",
    [
        np.zeros((3, 3)),
        np.diag([np.inf, 1.0, 1.0]),
        np.full((3, 3), np.nan),
        -np.eye(3),
        np.eye(3) + np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    ],
    ids=["zero", "infinite", "no number", "negative", "lopsided"],
)
def test_a_stored_mount_without_a_covariance_is_not_taken_up_and_it_is_said_once(covariance: Array) -> None:
    stored = Extrinsics(
        0, "demo", "front", Mount(0.1, 0.2, 0.3, covariance), State.CALIBRATED, 9, (), "omnivert", "digest"
    )
    calibrator = Calibrator(Config(), stored)
    estimates = told(calibrator, driven(6))
    assert [any("stored mount is not taken up" in r for r in e.reasons) for e in estimates] == [True] + [False] * 5
    assert calibrator.refused == {"stored mount: its covariance is none": 1}
    assert all(e.mount is None for e in estimates)


def test_a_stored_mount_that_the_filter_cannot_stand_on_is_given_up_and_counted() -> None:
    stored = Extrinsics(
        0, "demo", "front", Mount(0.1, 0.2, 0.3, 1e300 * np.eye(3)), State.CALIBRATED, 9, (), "omnivert", "digest"
    )
    calibrator = Calibrator(Config(), stored)
    estimates = told(calibrator, driven(30))
    assert calibrator.refused == {"filter: covariance lost its definiteness": 1}
    assert sum("the filter lost its footing and starts anew" in e.reasons for e in estimates) == 1
    assert "taken up from the store" not in estimates[-1].reasons
    assert all(e.state is not State.CALIBRATED for e in estimates)


@pytest.mark.parametrize(
    "messages",
    [
        driven(40, begin_ns=2**62 - 20 * SECOND),
        driven(40, counts=2**53 - 3000),
        driven(40, counts=-(2**53)),
        driven(40, std=1e-6),
        driven(40, std=float(np.pi)),
    ],
    ids=["late stamps", "many counts", "few counts", "sure bearings", "unsure bearings"],
)
def test_the_ends_of_every_range_are_lived_through(messages: list[Ticks | Bearings]) -> None:
    calibrator = Calibrator(Config())
    estimates = told(calibrator, messages)
    calibrator.close()
    assert len(estimates) == 40
    assert all(e.state is not State.CALIBRATED for e in estimates)  # these bearings are of no world


def test_counts_without_frames_are_kept_for_a_while_only() -> None:
    calibrator = Calibrator(Config())
    told(calibrator, [Ticks(k * SECOND // 5, k, k) for k in range(3000)])
    known = calibrator._way._odometer._known
    assert known[-1][0] - known[0][0] <= KEPT_NS + SECOND
    (late,) = told(calibrator, [frame(600 * SECOND), Ticks(601 * SECOND, 3000, 3000)])
    assert not late.reasons


def test_frames_whose_stamps_hardly_grow_do_not_wait_for_ever() -> None:
    calibrator = Calibrator(Config())
    calibrator.step(Ticks(0, 0, 0))
    estimates = told(calibrator, [frame(k) for k in range(1, MOST_HELD + 50)])
    assert len(estimates) >= 40
    assert all("no wheel counts at this frame" in e.reasons for e in estimates)


def test_what_shows_no_mount_for_long_is_dropped_by_halves() -> None:
    config = Config(calibration=Calibration(window_keyframes=40))
    calibrator = Calibrator(config)
    sizes = []
    for k in range(150):
        told(calibrator, [Ticks(k * SECOND // 3, 60 * k, 60 * k), frame(k * SECOND // 3, beta=AROUND[:0])])
        sizes.append(calibrator.solved_keyframes)
    assert 20 <= max(sizes) <= 44


def test_standing_for_long_among_tracks_that_come_and_go_grows_nothing() -> None:
    mount, spread = np.array([0.3, 0.2, 0.1]), np.diag([1e-4, 1e-6, 1e-4])
    dog, known = Watchdog(mount, spread), Filter(mount, spread, Rules())
    for k in range(600):
        dog.stand(k, True, 8 * k + np.arange(8), AROUND, np.full(8, 0.003), known)
    assert len(dog._still) <= dog.rules.most_still + 16


def test_breaks_for_hours_among_tracks_that_never_come_again_leave_nothing_behind() -> None:
    stretch = Stretch(Config())
    for k in range(400):
        stretch.append(float(k), None, 8 * k + np.arange(8), AROUND, np.full(8, 0.003))
        if len(stretch.keyframes) == 20:
            stretch.drop_first(10)
    assert len(stretch._left_behind) + len(stretch._renamed) <= 20 * 8


def test_the_rarer_a_false_alarm_may_be_the_more_a_knock_must_show() -> None:
    knock = Knock(5.0, float(np.deg2rad(4.0)))
    drive = recorded(Scene(path="alternate", mount=(0.6, 0.25, -0.4), knock=knock), Config(), 3)
    mount = Mount(0.6, 0.25, -0.4, np.diag([0.01, 0.002, 0.01]) ** 2)
    stored = Extrinsics(0, "demo", "front", mount, State.CALIBRATED, 9, (), "omnivert", "digest")
    alarms = []
    for chance in (1e-3, 1e-30):
        calibrator = Calibrator(Config(calibration=Calibration(alarm_chance=chance)), stored)
        estimates = told(calibrator, [m for m in drive.messages if m.stamp_ns < 9 * SECOND])
        alarms.append([e.stamp_ns / SECOND for e in estimates if e.state is State.MOVED])
    assert 5.0 < alarms[0][0] < 7.0
    assert alarms[1] == []
    assert WatchRules().chance == Calibration().alarm_chance
