"""Clock offset, wheel ratio and base: freed when the drive shows them, held and said so when it does not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.judging.corrections import are_far, first_prior, freed, freed_at_first
from omnivert.calibration.solver.noise import Noise
from omnivert.calibration.way import Way
from omnivert.config import Calibration, Config
from omnivert.messages import Estimate, Ticks
from omnivert.odometry import SECOND
from omnivert.simulation.recording import Drive, Scene, recorded

Array = NDArray[np.float64]
CONFIGURED = {"time_offset": 0.0, "wheel_ratio": 1.0, "wheel_base": 0.40}
ALL_FREE = Config(calibration=Calibration(time_offset="free", wheel_ratio="free", wheel_base="free"))


def last_of(drive: Drive, config: Config) -> Estimate:
    calibrator = Calibrator(config)
    for message in drive.messages:
        calibrator.step(message)
    return [told for told in calibrator.close() if isinstance(told, Estimate)][-1]


def test_late_stamps_and_wrong_wheels_are_found() -> None:
    scene = Scene(path="alternate", visible=6.0, time_offset_s=0.083, wheel_ratio=1.06, base_factor=1.05)
    truth = {"time_offset": 0.083, "wheel_ratio": 1.06, "wheel_base": 0.40 * 1.05}
    drive = recorded(scene, Config(), 4)
    last = last_of(drive, ALL_FREE)
    found = {part.name: part for part in last.corrections if part.name in truth}
    assert found.keys() == truth.keys()
    for part in found.values():
        assert part.freed
        assert abs(part.value - truth[part.name]) < 3.5 * part.std
        assert part.std < 0.3 * abs(truth[part.name] - CONFIGURED[part.name])  # or the drive would not show it
    assert last.mount is not None
    assert abs(last.mount.rho_m - drive.mount[1]) < 4.0 * np.sqrt(last.mount.covariance[1, 1])


def test_what_the_drive_does_not_show_is_held_and_said() -> None:
    last = last_of(recorded(Scene(path="paper"), Config(), 2), Config())
    ratio = next(part for part in last.corrections if part.name == "wheel_ratio")
    assert (ratio.value, ratio.freed) == (1.0, False)
    assert ratio.reason.startswith("held: this drive shows it to ")


def test_settings_have_the_last_word() -> None:
    sharp, nothing = np.diag([1e6] * 6), np.zeros(6)
    before = np.zeros(3, dtype=np.bool_)
    held = Config(calibration=Calibration(time_offset="held", wheel_base="free"))
    assert freed(held, before, sharp, nothing, np.zeros(3)).tolist() == [False, True, True]
    assert freed(held, before, first_prior().information + 1e-3 * np.eye(6), nothing, np.zeros(3)).tolist() == [
        False,
        False,
        True,
    ]
    assert freed_at_first(held).tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("off", "was_free", "is_free"),
    [(5.0, False, True), (-3.3, False, True), (2.7, False, False), (-2.7, True, True), (1.7, True, False)],
)
def test_a_value_far_from_the_configured_one_is_freed_however_badly_it_is_seen(
    off: float, was_free: bool, is_free: bool
) -> None:
    """off  in its sigmas"""
    information = np.diag([1e6, 1e6, 1e6, 1.0 / 0.02**2, 1e2, 1e2])
    step = np.array([0.0, 0.0, 0.0, 0.02 * off, 0.0, 0.0])
    free = freed(Config(), np.array([was_free, False, False]), information, step, np.zeros(3))
    assert free.tolist() == [is_free, False, False]


@pytest.mark.parametrize(
    ("at", "far"), [((0.083, 0.02, 0.05), False), ((0.2, 0.0, 0.0), True), ((0.0, 0.0, -0.08), True)]
)
def test_a_rig_is_far_from_its_configuration_when_one_correction_is(at: tuple[float, ...], far: bool) -> None:
    assert are_far(np.array(at)) is far


@pytest.mark.parametrize("late", [0.0, 0.12])
def test_the_filter_drives_by_the_corrected_clock(late: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the correction the pulse would miss each frame by the way of that time, and the smoother with it."""
    used, correct = [0.0], Way.correct

    def spied(way: Way, corrections: Array, noise: Noise) -> None:
        used.append(float(corrections[0]))
        correct(way, corrections, noise)

    monkeypatch.setattr(Way, "correct", spied)
    calibrator, last = Calibrator(replace_calibration(time_offset="free")), None
    for message in recorded(Scene(path="alternate", time_offset_s=late), Config(), 8).messages:
        for told in calibrator.step(message):
            last = told if isinstance(told, Estimate) else last
    assert used[-1] == pytest.approx(late, abs=0.03)
    assert last is not None
    assert last.smoother is not None
    assert last.disagreement < 1.5
    assert last.lines_rejected <= 3


def test_a_late_picture_is_met_by_the_way_until_it_was_taken() -> None:
    """The wheels stand for a second and then turn the robot; pictures are stamped 0.1 s late."""
    way = Way(Config())
    for k in range(101):
        turned = max(k - 50, 0)
        way.push(Ticks(k * SECOND // 50, -turned, turned))
    way.correct(np.array([0.1, 0.0, 0.0]), Noise())
    motions = [way.step(round(stamp_s * SECOND))[0] for stamp_s in (0.5, 1.1, 1.5, 1.7)]
    turns = [motion.pose[2] for motion in motions if motion is not None]
    a_second = 2.0 * 50 * Config().encoder.metres_per_tick / Config().robot.wheel_base_m
    assert turns == pytest.approx([0.0, 0.0, 0.4 * a_second, 0.2 * a_second])


def replace_calibration(**given: str) -> Config:
    return replace_config(Config(), Calibration(**given))  # type: ignore[arg-type]


def replace_config(config: Config, calibration: Calibration) -> Config:
    return config.model_copy(update={"calibration": calibration})


def test_a_free_correction_widens_what_is_claimed() -> None:
    drive = recorded(Scene(path="alternate"), Config(), 8)
    held = last_of(drive, replace_calibration(time_offset="held", wheel_ratio="held", wheel_base="held"))
    free = last_of(drive, ALL_FREE)
    assert held.mount is not None
    assert free.mount is not None
    assert np.diag(free.mount.covariance)[0] > 1.05 * np.diag(held.mount.covariance)[0]
