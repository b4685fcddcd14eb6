"""The filter: numbers stay sound, lines come and go with the right correlations, contradictions stay out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import model
from omnivert.calibration.kalman.blocks import agreeing
from omnivert.calibration.kalman.ekf import Filter, Layout, Rules, rules_of_the_paper
from omnivert.config import Encoder
from omnivert.odometry import Motion, Odometer, Samples, after

Array = NDArray[np.float64]

BASE, K, STD = 0.4, 2e-4, 0.003
MOUNT = np.array([-0.34, 0.23, 0.33])
SPREAD = np.diag([0.02**2, 0.005**2, 0.02**2])


def motion_from_wheels(right: Array, left: Array) -> Motion:
    """Steps of the wheels (N,), one after the other."""
    right, left = (np.concatenate([[0.0], np.cumsum(way)]) for way in (right, left))
    samples = Samples(0.02 * np.arange(right.size, dtype=np.float64), right, left)
    return Odometer(Encoder(noise_k_m=K, ticks_per_rev=10_000_000), BASE).motion(samples)


def line_bearings(lines: Array, pose: Array, mount: Array = MOUNT) -> Array:
    phi, rho, psi = mount
    x, y, heading = pose
    camera = np.array([x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi)])
    sight = lines - camera
    return np.asarray(wrap(np.arctan2(sight[:, 1], sight[:, 0]) - heading - phi - psi))


def step_of(right: float, left: float) -> Motion:
    return motion_from_wheels(np.full(10, right / 10), np.full(10, left / 10))


def driven(rules: Rules, frames: int = 60, start: Array = MOUNT, seed: int = 0) -> tuple[Filter, list[Array]]:
    """A filter that has seen a drive of straight parts and turns; its states' covariances on the way."""
    rng = np.random.default_rng(seed)
    lines = rng.uniform(-3.0, 3.0, (12, 2))
    lines = lines[np.hypot(*lines.T) > 1.2]
    names = np.arange(lines.shape[0])
    kalman = Filter(start.copy(), SPREAD.copy(), rules)
    pose = np.zeros(3)
    seen = []
    for frame in range(frames):
        wheels = np.full((10, 2), 0.005) if frame % 20 < 10 else np.tile([0.001, -0.001], (10, 1))
        real = wheels + np.sqrt(K * np.abs(wheels)) * rng.standard_normal(wheels.shape)
        kalman.predict(motion_from_wheels(wheels[:, 0], wheels[:, 1]))
        for right, left in real:
            pose = after(pose, motion_from_wheels(np.array([right]), np.array([left])).pose)
        beta = wrap(line_bearings(lines, pose) + STD * rng.standard_normal(names.size))
        kalman.update(names, beta, np.full(names.size, STD))
        seen.append(kalman.P.copy())
    return kalman, seen


def test_the_layout_names_every_part_of_the_state() -> None:
    layout = Layout(2)
    x = np.arange(layout.size)
    assert x[layout.distance].tolist() == [0, 2]
    assert x[layout.heading].tolist() == [1, 3]
    assert x[layout.mount].tolist() == [4, 5, 6]


@pytest.mark.parametrize("rules", [Rules(), rules_of_the_paper(BASE, K)])
def test_covariance_stays_symmetric_and_positive(rules: Rules) -> None:
    _, seen = driven(rules)
    for covariance in seen:
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12)
        assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_a_good_start_gets_better_and_stays_honest() -> None:
    chi = []
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        start = MOUNT + np.sqrt(np.diag(SPREAD)) * rng.standard_normal(3)
        kalman, _ = driven(Rules(), 60, start, seed)
        off = kalman.mount - MOUNT
        chi.append(off @ np.linalg.solve(kalman.mount_covariance, off))
        assert kalman.mount_covariance[0, 0] < SPREAD[0, 0]
    assert np.mean(chi) < 3.0 + 3.0 * np.sqrt(6.0 / 8)  # chi-square of 3 degrees of freedom, mean of 8


@settings(deadline=None, max_examples=30)
@given(beta=st.floats(-3.0, 3.0), phi=st.floats(-3.0, 3.0), rho=st.floats(0.05, 0.5), psi=st.floats(-3.0, 3.0))
def test_a_new_line_is_correlated_with_the_mount_as_finite_differences_say(
    beta: float, phi: float, rho: float, psi: float
) -> None:
    mount = np.array([phi, rho, psi])
    spread = np.array([[4e-4, 1e-5, -3e-4], [1e-5, 3e-5, 0.0], [-3e-4, 0.0, 5e-4]])
    rules = Rules()
    kalman = Filter(mount, spread, rules)
    kalman.update(np.array([7]), np.array([beta]), np.array([STD]))

    def heading(values: Array) -> float:  # beta, w, phi, rho, psi
        b, w = values[:1], values[1:2]
        return float(np.ravel(model.heading_from_bearing(b, w, values[2], values[3], values[4]))[0])

    at = np.array([beta, rules.start, *mount])
    slopes = np.array([wrap(heading(at + h) - heading(at - h)) / 2e-6 for h in 1e-6 * np.eye(5)])
    inputs = np.zeros((5, 5))
    inputs[0, 0], inputs[1, 1], inputs[2:, 2:] = STD**2, rules.start_std**2, spread
    into = np.zeros((5, 5))
    into[0, 1], into[1], into[2:, 2:] = 1.0, slopes, np.eye(3)
    np.testing.assert_allclose(kalman.P, into @ inputs @ into.T, atol=1e-7)


def test_a_leaving_line_takes_nothing_from_the_others() -> None:
    kalman, _ = driven(Rules(), 10)
    mount, covariance = kalman.mount, kalman.mount_covariance
    kalman.forget_lines()
    assert kalman.tracks == []
    np.testing.assert_array_equal(kalman.mount, mount)
    np.testing.assert_array_equal(kalman.mount_covariance, covariance)


def test_lines_unseen_for_some_updates_leave() -> None:
    kalman, _ = driven(Rules(), 10)
    some = np.array(kalman.tracks[:2])
    for _ in range(Rules().unseen + 1):
        predicted, _ = kalman.expected()
        kalman.predict(step_of(0.0, 0.0))
        kalman.update(some, wrap(predicted[:2]), np.full(2, STD))
    assert kalman.tracks == some.tolist()


def test_one_wrong_bearing_is_rejected_and_a_common_error_is_not() -> None:
    kalman, _ = driven(Rules(), 20)
    kalman.predict(step_of(0.05, 0.05))
    predicted, _ = kalman.expected()
    names = np.array(kalman.tracks)
    wrong = predicted.copy()
    wrong[2] = wrap(wrong[2] + 0.5)
    assert kalman.update(names, wrong, np.full(names.size, STD)).rejected == 1

    kalman, _ = driven(Rules(), 20)
    kalman.predict(step_of(0.05, 0.05))
    predicted, _ = kalman.expected()
    heading_error = np.sqrt(step_of(0.05, 0.05).covariance[2, 2])
    turned = wrap(predicted + 2.5 * heading_error)
    assert kalman.update(names, turned, np.full(names.size, STD)).rejected == 0


def test_agreeing_keeps_what_the_majority_says() -> None:
    covariance = 0.05**2 * np.ones((6, 6)) + 0.003**2 * np.eye(6)
    innovation = np.array([0.1, 0.1, 0.101, 0.099, -0.1, 0.1])
    assert agreeing(innovation, np.asarray(np.linalg.inv(covariance), dtype=np.float64), 3.5).tolist() == [
        0,
        1,
        2,
        3,
        5,
    ]


def test_an_update_without_lines_changes_nothing_but_their_age() -> None:
    kalman, _ = driven(Rules(), 10)
    x, covariance = kalman.x.copy(), kalman.P.copy()
    innovation = kalman.update(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
    assert (innovation.used, innovation.new, innovation.rejected) == (0, 0, 0)
    np.testing.assert_array_equal(kalman.x, x)
    np.testing.assert_array_equal(kalman.P, covariance)


def test_a_negative_rho_is_told_as_the_same_place_with_a_positive_one() -> None:
    kalman = Filter(np.array([0.2, -0.1, 0.5]), SPREAD.copy(), Rules())
    phi, rho, psi = kalman.mount
    place = rho * np.array([np.cos(phi), np.sin(phi)])
    assert place == pytest.approx(-0.1 * np.array([np.cos(0.2), np.sin(0.2)]))
    assert wrap(phi + psi - 0.7) == pytest.approx(0.0, abs=1e-12)


def test_lost_definiteness_is_told_and_never_repaired() -> None:
    kalman, _ = driven(Rules(), 10)
    assert kalman.is_sound
    values, vectors = np.linalg.eigh(kalman.P)
    values[0] = -1e-3 * values[1]  # every variance stays positive
    kalman.P = vectors @ np.diag(values) @ vectors.T
    assert (np.diag(kalman.P) > 0.0).all()
    assert not kalman.is_sound
    for bad in (np.nan, np.inf):
        kalman, _ = driven(Rules(), 10)
        kalman.P[2, 5] = kalman.P[5, 2] = bad
        assert not kalman.is_sound
        kalman, _ = driven(Rules(), 10)
        kalman.x[3] = bad
        assert not kalman.is_sound


def test_bearings_that_cannot_have_their_spread_leave_the_filter_unsound() -> None:
    kalman, _ = driven(Rules(), 10)
    names, (predicted, _) = np.array(kalman.tracks), kalman.expected()
    kalman.P = -kalman.P
    assert kalman.update(names, predicted, np.full(names.size, STD)).used == 0
    assert not kalman.is_sound
    kalman.seed(MOUNT, np.zeros((0, 2)), SPREAD, [])
    assert kalman.is_sound


def test_how_often_a_line_was_seen_outlives_a_new_seed() -> None:
    kalman, _ = driven(Rules(), 10)
    names, (predicted, _) = np.array(kalman.tracks), kalman.expected()
    n = 2 * names.size
    kalman.seed(kalman.mount, kalman.x[:n].reshape(-1, 2), kalman.P, kalman.tracks[:])
    told = kalman.update(np.append(names, 99), np.append(predicted, 0.1), np.full(names.size + 1, STD))
    assert told.evidence is not None
    assert told.evidence.age.tolist() == [11] * names.size
    predicted, _ = kalman.expected()
    told = kalman.update(np.array([99]), predicted[-1:], np.array([STD]))
    assert told.evidence is not None
    assert told.evidence.age.tolist() == [2]


def test_the_evidence_is_what_the_filter_expected_before_it_was_corrected() -> None:
    kalman, _ = driven(Rules(), 20)
    predicted, slopes = kalman.expected()
    n = len(kalman.tracks)
    H = np.zeros((n, 2 * n + 3))
    for i in range(n):
        H[i, [2 * i, 2 * i + 1, -3, -2, -1]] = slopes[i]
    S = H @ kalman.P @ H.T + STD**2 * np.eye(n)
    seen = wrap(predicted + 0.001 * np.arange(n))
    seen[1] = wrap(seen[1] + 1.0)
    told = kalman.update(np.array(kalman.tracks), seen, np.full(n, STD)).evidence
    assert told is not None
    np.testing.assert_allclose(told.precision @ S, np.eye(n), atol=1e-8)
    np.testing.assert_allclose(told.nu, wrap(seen - predicted), atol=1e-12)


@pytest.mark.parametrize("reseed", [False, True])
def test_what_is_left_of_a_jump_is_followed_as_the_filter_itself_does(reseed: bool) -> None:
    """Two filters see the same world, but for a small jump of the mount in one: they part as it was foretold."""
    jump = 1e-6 * np.array([1.0, -2.0, 3.0])  # yaw, forward, left
    cartesian, _ = model.cartesian_from_polar(MOUNT)
    jumped, _ = model.polar_from_cartesian(cartesian + jump)
    lines = np.array([[2.0, 1.0], [-1.0, 2.0], [1.0, -2.0], [3.0, 0.2], [-2.0, -1.5], [0.5, 2.5], [2.2, -0.4]])
    start = np.diag([0.02**2, 0.005**2, 0.02**2])
    one, other = Filter(MOUNT.copy(), start, Rules()), Filter(MOUNT.copy(), start, Rules())
    pose, names = np.zeros(3), np.arange(6)
    for frame in range(-60, 14):  # long enough that what each filter expects is what comes
        names = np.arange(6) if frame < 10 else np.arange(1, 7)  # a line enters, and one leaves
        motion = step_of(0.05, 0.05) if frame % 4 < 2 else step_of(0.02, -0.02)
        pose = after(pose, motion.pose)
        for kalman, mount in ((one, MOUNT), (other, jumped if frame >= 6 else MOUNT)):
            kalman.predict(motion)
            kalman.follows = frame == 6  # one jump alone
            told = kalman.update(names, line_bearings(lines[names], pose, mount), np.full(6, STD))
            assert told.rejected == 0
            if reseed and frame == 8:
                n = 2 * len(kalman.tracks)
                lined = kalman.x[:n].reshape(-1, 2)
                kalman.seed(kalman.x[n:], lined, kalman.P, kalman.tracks)
    assert one.tracks == other.tracks
    at = one.layout.mount
    to_jumped, _ = model.polar_from_cartesian(cartesian + jump)
    left = np.zeros(one.x.size)  # truth less state changes by the jump, less by what the state has followed
    left[at] = to_jumped - MOUNT
    foretold, is_so = one.followed @ jump, left - (other.x - one.x)
    np.testing.assert_allclose(foretold, is_so, atol=0.05 * np.abs(is_so).max())
