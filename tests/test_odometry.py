"""Wheel counts to motion, its covariance, and counts that lie."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.config import Encoder
from omnivert.messages import Ticks
from omnivert.odometry import SECOND, Motion, Odometer, Samples, after, arc

calm = settings(deadline=None, max_examples=40)
ENCODER = Encoder(wheel_diameter_m=0.15, ticks_per_rev=2000)
BASE = 0.4


def ticks(time_s: float, left: int, right: int) -> Ticks:
    return Ticks(round(time_s * SECOND), left, right)


@calm
@given(right=st.floats(-0.5, 0.5), left=st.floats(-0.5, 0.5))
def test_an_arc_is_many_small_chords(right: float, left: float) -> None:
    pose = np.zeros(3)
    small = arc(np.array([right / 100]), np.array([left / 100]), BASE)[0]
    for _ in range(100):
        pose = after(pose, small)
    np.testing.assert_allclose(arc(np.array([right]), np.array([left]), BASE)[0], pose, atol=1e-9)


def motion(odometer: Odometer, first_s: float, last_s: float) -> Motion | None:
    samples = odometer.samples(round(first_s * SECOND), round(last_s * SECOND))
    return None if samples is None else odometer.motion(samples)


@calm
@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=4, max_size=40))
def test_joined_samples_tell_the_same_motion(counts: list[tuple[int, int]]) -> None:
    """Also where the robot stands, of which only the ends are kept."""
    odometer = Odometer(ENCODER, BASE)
    total = np.cumsum(np.array(counts), axis=0)
    for k, (left, right) in enumerate(total.tolist()):
        odometer.push(ticks(0.02 * k, left, right))
    end = 0.02 * (len(counts) - 1)
    whole, first, second = (
        odometer.samples(round(a * SECOND), round(b * SECOND)) for a, b in ((0.0, end), (0.0, 0.03), (0.03, end))
    )
    assert whole is not None
    assert first is not None
    assert second is not None
    both = first + second
    told, again = odometer.motion(whole), odometer.motion(both)
    np.testing.assert_allclose(again.pose, told.pose, atol=1e-9)
    assert again.driven_m == pytest.approx(told.driven_m)
    assert again.turned_rad == pytest.approx(told.turned_rad)


def test_of_a_stand_only_the_ends_are_kept() -> None:
    still = Samples(np.arange(1000.0), np.zeros(1000), np.zeros(1000))
    both = still + Samples(np.array([999.0, 1000.0, 1001.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
    assert both.time_s.tolist() == [0.0, 1000.0, 1001.0]


def test_motion_between_samples_is_interpolated() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k in range(11):
        odometer.push(ticks(0.02 * k, 10 * k, 10 * k))
    moved = motion(odometer, 0.03, 0.17)
    assert moved is not None
    assert moved.pose == pytest.approx([70 * ENCODER.metres_per_tick, 0.0, 0.0])
    assert moved.turned_rad == 0.0


def test_driving_backwards_is_driving_too() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(0.1, -100, -100))
    moved = motion(odometer, 0.0, 0.1)
    assert moved is not None
    assert moved.pose[0] == pytest.approx(-100 * ENCODER.metres_per_tick)
    assert moved.driven_m == pytest.approx(100 * ENCODER.metres_per_tick)


def test_motion_is_unknown_where_the_counts_do_not_reach() -> None:
    odometer = Odometer(ENCODER, BASE)
    assert motion(odometer, 0.0, 0.1) is None
    odometer.push(ticks(1.0, 0, 0))
    odometer.push(ticks(2.0, 5, 5))
    assert motion(odometer, 0.5, 1.0) is None
    assert motion(odometer, 1.0, 3.0) is None
    assert motion(odometer, 1.0, 2.0) is not None


def test_one_wild_count_is_refused_and_the_chain_holds() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k, left in enumerate([0, 10, 900_000, 30, 40]):
        odometer.push(ticks(0.02 * k, left, 10 * k))
    assert odometer.refused == {"ticks: a jump that no wheel can make": 1}
    moved = motion(odometer, 0.0, 0.08)
    assert moved is not None
    assert moved.pose[0] == pytest.approx(40 * ENCODER.metres_per_tick)


def test_counts_that_go_on_elsewhere_break_the_chain() -> None:
    odometer = Odometer(ENCODER, BASE)
    for k, left in enumerate([0, 10, 900_000, 900_010, 900_020]):
        odometer.push(ticks(0.02 * k, left, left))
    assert motion(odometer, 0.0, 0.08) is None
    after_break = motion(odometer, 0.04, 0.08)
    assert after_break is not None
    assert after_break.pose[0] == pytest.approx(20 * ENCODER.metres_per_tick)


def test_a_silence_while_the_wheels_turn_breaks_the_chain() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(3.0, 2000, 2000))
    assert motion(odometer, 0.0, 3.0) is None
    assert odometer.refused == {"ticks: silent while the wheels turned": 1}


def test_a_silence_of_standing_wheels_does_no_harm() -> None:
    odometer = Odometer(ENCODER, BASE)
    odometer.push(ticks(0.0, 0, 0))
    odometer.push(ticks(30.0, 1, 0))
    assert motion(odometer, 0.0, 30.0) is not None
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
    assert motion(odometer, 0.11, 0.2) is not None
    assert motion(odometer, 0.05, 0.2) is None
