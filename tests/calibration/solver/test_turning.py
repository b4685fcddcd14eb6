"""Time offset and wheel base from how bearings turn."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.calibration.judging.corrections import first_prior
from omnivert.calibration.solver.problem import Problem
from omnivert.calibration.solver.stretch import Stretch
from omnivert.calibration.solver.turning import turning
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND, Odometer
from omnivert.simulation.recording import Scene, recorded


def problem_of(scene: Scene, seed: int) -> Problem:
    config = Config()
    odometer, stretch, last = Odometer(config.encoder, config.robot.wheel_base_m), Stretch(config), -1
    messages = recorded(scene, config, seed).messages
    for ticks in (m for m in messages if isinstance(m, Ticks)):
        odometer.push(ticks)
    for frame in (m for m in messages if isinstance(m, Bearings)):
        wheels = None if last < 0 else odometer.samples(last, frame.stamp_ns)
        stretch.append(frame.stamp_ns / SECOND, wheels, frame.track_id, frame.bearing_rad, frame.std_rad)
        last = frame.stamp_ns
    return stretch.posed(first_prior(), 200, 4).problem


def asked_of(late_s: float, base: float) -> NDArray[np.float64] | None:
    scene = Scene(path="alternate", repeat=2, time_offset_s=late_s, base_factor=base, bearing_std_rad=0.001)
    return turning(problem_of(scene, 5), True, True)


@pytest.mark.parametrize(("late_s", "base"), [(0.25, 1.12), (-0.2, 1.15), (0.0, 0.85)])
def test_the_turning_of_bearings_shows_clock_and_base_that_are_far_off(late_s: float, base: float) -> None:
    found = asked_of(late_s, base)
    assert found is not None
    assert found[0] == pytest.approx(late_s, abs=0.08)
    assert found[2] == pytest.approx(base - 1.0, abs=0.05)


def test_a_rig_as_configured_asks_for_nothing() -> None:
    assert asked_of(0.0, 1.0) is None


def test_what_is_held_is_not_touched() -> None:
    scene = Scene(path="alternate", repeat=2, time_offset_s=0.25, base_factor=1.15, bearing_std_rad=0.001)
    problem = problem_of(scene, 5)
    held = turning(problem, False, True)
    assert held is not None
    assert held[0] == 0.0
    assert turning(problem, False, False) is None
