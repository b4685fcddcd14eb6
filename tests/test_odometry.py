"""Wheel counts to motion, its covariance, and counts that lie."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.config import Encoder
from omnivert.messages import Ticks
from omnivert.odometry import SECOND, Odometer, after, arc, joined, motion_from_wheels

calm = settings(deadline=None, max_examples=40)
ENCODER = Encoder(wheel_diameter_m=0.15, ticks_per_rev=2000)
BASE = 0.4


def ticks(time_s: float, left: int, right: int) -> Ticks:
    return Ticks(round(time_s * SECOND), left, right)


def test_covariance_is_that_of_many_noisy_drives() -> None:
    rng = np.random.default_rng(1)
    right, left = rng.normal(0.003, 0.001, 20), rng.normal(-0.002, 0.001, 20)
    told = motion_from_wheels(right, left, BASE, 2e-4)
    drives = np.array(
        [
            motion_from_wheels(
                right + np.sqrt(2e-4 * np.abs(right)) * rng.standard_normal(20),
                left + np.sqrt(2e-4 * np.abs(left)) * rng.standard_normal(20),
                BASE,
                2e-4,
            ).pose
            for _ in range(4000)
        ]
    )
    white = np.linalg.inv(np.linalg.cholesky(told.covariance))
    np.testing.assert_allclose(white @ np.cov(drives.T) @ white.T, np.eye(3), atol=0.12)


@calm
@given(right=st.floats(-0.5, 0.5), left=st.floats(-0.5, 0.5))
def test_an_arc_is_many_small_chords(right: float, left: float) -> None:
    pose = np.zeros(3)
    small = arc(np.array([right / 100]), np.array([left / 100]), BASE)[0]
    for _ in range(100):
        pose = after(pose, small)
    np.testing.assert_allclose(arc(np.array([right]), np.array([left]), BASE)[0], pose, atol=1e-9)


@calm
@given(st.lists(st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)), min_size=2, max_size=12))
def test_joined_motions_are_one_motion(steps: list[tuple[float, float]]) -> None:
    wheels = np.array(steps)
    half = len(steps) // 2
    whole = motion_from_wheels(wheels[:, 0], wheels[:, 1], BASE, 2e-4)
    parts = [motion_from_wheels(w[:, 0], w[:, 1], BASE, 2e-4) for w in (wheels[:half], wheels[half:])]
    both = joined(*parts)
    np.testing.assert_allclose(both.pose, whole.pose, atol=1e-12)
    np.testing.assert_allclose(both.covariance, whole.covariance, atol=1e-9)
    assert both.driven_m == pytest.approx(whole.driven_m)


def test_motion_between_samples_is_interpolated() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k in range(11):
        odometer.push(ticks(0.02 * k, 10 * k, 10 * k))
    motion = odometer.motion(round(0.03 * SECOND), round(0.17 * SECOND))
    assert motion is not None
    assert motion.pose == pytest.approx([70 * ENCODER.metres_per_tick, 0.0, 0.0])
    assert motion.turned_rad == 0.0


def test_driving_backwards_is_driving_too() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(0.1, -100, -100))
    motion = odometer.motion(0, SECOND // 10)
    assert motion is not None
    assert motion.pose[0] == pytest.approx(-100 * ENCODER.metres_per_tick)
    assert motion.driven_m == pytest.approx(100 * ENCODER.metres_per_tick)


def test_motion_is_unknown_where_the_counts_do_not_reach() -> None:
    odometer = Odometer(ENCODER, BASE)
    assert odometer.motion(0, 1) is None
    odometer.push(ticks(1.0, 0, 0))
    odometer.push(ticks(2.0, 5, 5))
    assert odometer.motion(SECOND // 2, SECOND) is None
    assert odometer.motion(SECOND, 3 * SECOND) is None
    assert odometer.motion(SECOND, 2 * SECOND) is not None


def test_one_wild_count_is_refused_and_the_chain_holds() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k, left in enumerate([0, 10, 900_000, 30, 40]):
        odometer.push(ticks(0.02 * k, left, 10 * k))
    assert odometer.refused == {"ticks: a jump that no wheel can make": 1}
    motion = odometer.motion(0, round(0.08 * SECOND))
    assert motion is not None
    assert motion.pose[0] == pytest.approx(40 * ENCODER.metres_per_tick)


def test_counts_that_go_on_elsewhere_break_the_chain() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k, left in enumerate([0, 10, 900_000, 900_010, 900_020]):
        odometer.push(ticks(0.02 * k, left, left))
    assert odometer.motion(0, round(0.08 * SECOND)) is None
    after_break = odometer.motion(round(0.04 * SECOND), round(0.08 * SECOND))
    assert after_break is not None
    assert after_break.pose[0] == pytest.approx(20 * ENCODER.metres_per_tick)


def test_a_silence_while_the_wheels_turn_breaks_the_chain() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(3.0, 2000, 2000))
    assert odometer.motion(0, 3 * SECOND) is None
    assert odometer.refused == {"ticks: silent while the wheels turned": 1}


def test_a_silence_of_standing_wheels_does_no_harm() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(30.0, 1, 0))
    assert odometer.motion(0, 30 * SECOND) is not None
    assert not odometer.refused


def test_repeated_and_reversed_stamps_are_refused() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(1.0, 0, 0))
    odometer.push(ticks(1.0, 5, 5))
    odometer.push(ticks(0.5, 5, 5))
    assert odometer.refused == {"ticks: stamp not after the one before": 2}


def test_forgetting_keeps_what_later_motion_needs() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k in range(11):
        odometer.push(ticks(0.02 * k, 10 * k, 10 * k))
    odometer.forget_before(round(0.11 * SECOND))
    assert odometer.motion(round(0.11 * SECOND), round(0.2 * SECOND)) is not None
    assert odometer.motion(round(0.05 * SECOND), round(0.2 * SECOND)) is None
