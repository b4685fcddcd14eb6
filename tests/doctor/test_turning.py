"""Wheels and picture compared, against drives whose wiring, lag and scale are known."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.doctor.turning import Turning, WheelWay, Wiring, turning, turns_seen
from omnivert.messages import Bearings

Array = NDArray[np.float64]
BASE_M = 0.4
RATE_HZ = 15.0
NOISE_K_M = 2e-4
S = 10**9


def driven(legs: list[tuple[float, float]]) -> tuple[Array, Array, Array, Array]:
    """Time, heading, right and left way of legs of (speed m/s, turn rad/s), two seconds each, after one of rest."""
    time = np.arange(0.0, 1.0 + 2.0 * len(legs), 0.02)
    leg = np.clip(((time - 1.0) // 2.0).astype(int), 0, len(legs) - 1)
    speed = np.where(time < 1.0, 0.0, np.array([v for v, _ in legs])[leg])
    rate = np.where(time < 1.0, 0.0, np.array([w for _, w in legs])[leg])
    heading, way = 0.02 * np.cumsum(rate), 0.02 * np.cumsum(speed)
    return time, heading, way + 0.5 * BASE_M * heading, way - 0.5 * BASE_M * heading


def pictures(
    time: Array, heading: Array, way: Array, seed: int, rate_hz: float = RATE_HZ, far: float = 1.0
) -> list[Bearings]:
    """Twenty lines around, one to four metres off times `far`, from a robot that drives along its heading."""
    rng = np.random.default_rng(seed)
    around, away = rng.uniform(-np.pi, np.pi, 20), far * rng.uniform(1.0, 4.0, 20)
    lines = np.stack([away * np.cos(around), away * np.sin(around)], axis=-1)
    step = np.diff(way, prepend=0.0)
    at = np.stack([np.cumsum(step * np.cos(heading)), np.cumsum(step * np.sin(heading))], axis=-1)
    seen = []
    for t in np.arange(0.0, time[-1], 1.0 / rate_hz):
        k = int(np.searchsorted(time, t))
        off = lines - at[k]
        bearing = wrap(np.arctan2(off[:, 1], off[:, 0]) - heading[k] + rng.normal(0.0, 5e-4, 20))
        rest = np.arange(20), bearing, np.full(20, 5e-4), np.full(20, 9, np.int32), np.full(20, 0.5, np.float32)
        seen.append(Bearings(round(time[k] * S), *rest))
    return seen


def compared(
    legs: list[tuple[float, float]],
    wired: Callable[[Array, Array], tuple[Array, Array]] = lambda right, left: (right, left),
    sense: int = 1,
    late_s: float = 0.0,
    seed: int = 0,
) -> Turning:
    time, heading, right, left = driven(legs)
    seen = pictures(time, heading, 0.5 * (right + left), seed)
    shifted = [
        Bearings(
            b.stamp_ns + round(late_s * S),
            *(b.track_id, np.asarray(wrap(sense * b.bearing_rad)), b.std_rad, b.age_frames, b.strength),
        )
        for b in seen
    ]
    found = turning(turns_seen(shifted), WheelWay(time, *wired(right, left)), BASE_M, NOISE_K_M)
    assert found is not None
    return found


TURN_AND_DRIVE = [(0.0, 0.4), (0.3, 0.0), (0.0, 0.4)]
WIRED: dict[Wiring, Callable[[Array, Array], tuple[Array, Array]]] = {
    Wiring.AS_CONFIGURED: lambda right, left: (right, left),
    Wiring.MIRRORED: lambda right, left: (left, right),
    Wiring.LEFT_BACKWARDS: lambda right, left: (right, -left),
    Wiring.RIGHT_BACKWARDS: lambda right, left: (-right, left),
}


@settings(max_examples=15, deadline=None)
@given(wiring=st.sampled_from(list(Wiring)), seed=st.integers(0, 10**6), way=st.sampled_from((1.0, -1.0)))
def test_turn_and_straight_way_tell_every_wiring(wiring: Wiring, seed: int, way: float) -> None:
    legs = [(way * v, way * w) for v, w in TURN_AND_DRIVE]
    assert compared(legs, WIRED[wiring], seed=seed).wirings == (wiring,)


def test_a_wrong_sense_of_the_bearings_is_the_mirrored_world() -> None:
    assert compared(TURN_AND_DRIVE, sense=-1).wirings == (Wiring.MIRRORED,)


def test_wrong_sense_and_swapped_wheels_together_are_a_world_that_fits() -> None:
    assert compared(TURN_AND_DRIVE, WIRED[Wiring.MIRRORED], sense=-1).wirings == (Wiring.AS_CONFIGURED,)


def test_a_straight_way_alone_tells_a_reversed_wheel_but_not_which() -> None:
    straight = [(0.3, 0.0)] * 3
    assert set(compared(straight).wirings) == {Wiring.AS_CONFIGURED, Wiring.MIRRORED}
    backwards = compared(straight, WIRED[Wiring.LEFT_BACKWARDS]).wirings
    assert set(backwards) == {Wiring.LEFT_BACKWARDS, Wiring.RIGHT_BACKWARDS}


def test_a_turn_on_the_spot_alone_tells_all_four() -> None:
    for wiring, wired in WIRED.items():
        assert compared([(0.0, 0.4)] * 2, wired).wirings == (wiring,)


def test_without_motion_everything_is_possible() -> None:
    assert compared([(0.0, 0.0)] * 2).wirings == tuple(Wiring)


def test_a_wheel_that_is_dead_fits_no_wiring() -> None:
    assert compared(TURN_AND_DRIVE, lambda right, left: (0.0 * right, left)).wirings == ()


@pytest.mark.parametrize("factor", [0.25, 0.9, 1.2, 4.0])
def test_the_turn_per_turn_of_the_wheels_is_measured(factor: float) -> None:
    found = compared(TURN_AND_DRIVE, lambda right, left: (right / factor, left / factor))
    assert found.wirings == (Wiring.AS_CONFIGURED,)
    assert found.scale is not None
    scale, sigma = found.scale
    assert abs(scale - factor) < 0.02 * factor + 3.0 * sigma


@settings(max_examples=10, deadline=None)
@given(late_s=st.floats(-0.6, 0.6), seed=st.integers(0, 10**6))
def test_the_lag_is_measured(late_s: float, seed: int) -> None:
    found = compared(TURN_AND_DRIVE, late_s=late_s, seed=seed).late_s
    assert found is not None
    # Half a step of the encoders and one of the search are no noise.
    assert abs(found[0] - late_s) < 3.0 * found[1] + 0.03


def test_a_steady_turn_does_not_tell_the_lag() -> None:
    time, heading, right, left = driven([(0.0, 0.4)] * 3)
    steady = [b for b in pictures(time, heading, 0.0 * time, 1) if b.stamp_ns > 2.2 * S and b.stamp_ns < 5.8 * S]
    found = turning(turns_seen(steady), WheelWay(time, right, left), BASE_M, NOISE_K_M)
    assert found is not None
    assert found.late_s is None or found.late_s[1] > 0.1


@settings(max_examples=25, deadline=None)
@given(
    wiring=st.sampled_from(list(Wiring)),
    rate_hz=st.sampled_from((3.0, 15.0, 30.0, 50.0)),
    far=st.sampled_from((1.0, 20.0)),
    seed=st.integers(0, 10**6),
)
def test_turns_that_the_wheels_do_not_count_hide_no_wiring(
    wiring: Wiring, rate_hz: float, far: float, seed: int
) -> None:
    time, _, right, left = driven([(0.0, 0.4), (0.3, 0.0), (0.3, 0.0), (0.0, 0.4)] * 2)
    rng = np.random.default_rng(seed)
    steps = np.diff(np.stack([right, left]), prepend=0.0)
    went = np.cumsum(steps + rng.normal(0.0, 1.0, steps.shape) * np.sqrt(NOISE_K_M * np.abs(steps)), axis=1)
    seen = pictures(time, (went[0] - went[1]) / BASE_M, went.mean(axis=0), seed, rate_hz, far)
    found = turning(turns_seen(seen), WheelWay(time, *WIRED[wiring](right, left)), BASE_M, NOISE_K_M)
    assert found is not None
    assert found.wirings == (wiring,)


def test_counts_that_begin_anew_cost_one_pair() -> None:
    time, heading, right, left = driven(TURN_AND_DRIVE)
    jump = np.where(time > 4.0, 1e6, 0.0)
    seen = turns_seen(pictures(time, heading, 0.5 * (right + left), 3))
    found = turning(seen, WheelWay(time, right + jump, left + jump), BASE_M, NOISE_K_M)
    assert found is not None
    assert found.wirings == (Wiring.AS_CONFIGURED,)
