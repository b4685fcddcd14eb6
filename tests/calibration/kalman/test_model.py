"""The paper's equations against their meaning: world coordinates, slopes, limits."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import model
from omnivert.odometry import arc

Array = NDArray[np.float64]

calm = settings(deadline=None, max_examples=40)
angles = st.floats(-3.1, 3.1)
lengths = st.floats(0.05, 0.8)
distances = st.floats(1.0, 30.0)


def slope(function: Callable[[Array], Array], at: Array, width: float = 1e-6) -> Array:
    """Central differences, one column an argument."""
    columns = []
    for i in range(at.size):
        step = np.zeros(at.size)
        step[i] = width
        columns.append((function(at + step) - function(at - step)) / (2.0 * width))
    return np.stack(columns, axis=-1)


@calm
@given(x=st.floats(-9, 9), y=st.floats(-9, 9), heading=angles, phi=angles, rho=lengths, psi=angles)
def test_bearing_is_that_of_a_line_at_the_origin_in_absolute_coordinates(
    x: float, y: float, heading: float, phi: float, rho: float, psi: float
) -> None:
    distance = np.hypot(x, y)
    if distance < rho + 0.1:
        return
    camera = np.array([x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi)])
    seen = wrap(float(np.arctan2(-camera[1], -camera[0])) - heading - phi - psi)  # eq. 16, without its letters
    relative = np.array([wrap(heading - float(np.arctan2(y, x)))])
    told = model.bearing(np.array([distance]), relative, phi, rho, psi)[0]
    inverse = model.bearing_inverse(np.array([1.0 / distance]), relative, phi, rho, psi)[0]
    assert abs(wrap(told - seen)) < 1e-9
    assert abs(wrap(inverse - seen)) < 1e-9


@calm
@given(distance=distances, heading=angles, phi=angles, rho=lengths, psi=angles)
def test_jacobians_are_the_slopes_of_the_model(
    distance: float, heading: float, phi: float, rho: float, psi: float
) -> None:
    def by_distance(x: Array) -> Array:
        return np.unwrap(np.append(0.0, model.bearing(x[:1], x[1:2], x[2], x[3], x[4])))[1:]

    def by_inverse(x: Array) -> Array:
        return np.unwrap(np.append(0.0, model.bearing_inverse(x[:1], x[1:2], x[2], x[3], x[4])))[1:]

    at = np.array([distance, heading, phi, rho, psi])
    found = model.bearing_slopes(at[:1], at[1:2], phi, rho)
    if abs(abs(by_distance(at)[0]) - np.pi) > 0.01:
        np.testing.assert_allclose(slope(by_distance, at), found, atol=1e-7)
        at[0] = 1.0 / distance
        np.testing.assert_allclose(
            slope(by_inverse, at), model.bearing_inverse_slopes(at[:1], at[1:2], phi, rho), atol=1e-6
        )


@calm
@given(distance=distances, heading=angles, right=st.floats(-0.1, 0.1), left=st.floats(-0.1, 0.1))
def test_first_order_motion_has_the_slopes_of_the_appendix(
    distance: float, heading: float, right: float, left: float
) -> None:
    def moved(x: Array) -> Array:
        return np.concatenate(model.moved_first_order(x[:1], x[1:2], x[2], x[3], 0.4)[:2])

    at = np.array([distance, heading, right, left])
    _, _, by_state, by_wheel = model.moved_first_order(at[:1], at[1:2], right, left, 0.4)
    np.testing.assert_allclose(slope(moved, at), np.hstack([by_state[0], by_wheel[0]]), atol=1e-7)


@calm
@given(w=st.floats(0.0, 1.0), heading=angles, dx=st.floats(-0.2, 0.2), dy=st.floats(-0.1, 0.1), turn=angles)
def test_exact_motion_has_the_slopes_that_it_claims(
    w: float, heading: float, dx: float, dy: float, turn: float
) -> None:
    def moved(x: Array) -> Array:
        w1, heading1, _, _ = model.moved_exactly(x[:1], x[1:2], x[2:])
        return np.array([w1[0], np.cos(heading1[0]), np.sin(heading1[0])])

    at = np.array([w, heading, dx, dy, turn])
    _, heading1, by_state, by_step = model.moved_exactly(at[:1], at[1:2], at[2:])
    found = np.hstack([by_state[0], by_step[0]])
    expected = np.vstack([found[0], -np.sin(heading1) * found[1], np.cos(heading1) * found[1]])
    np.testing.assert_allclose(slope(moved, at), expected, atol=1e-6)


@calm
@given(distance=distances, heading=angles, right=st.floats(-0.3, 0.3), left=st.floats(-0.3, 0.3))
def test_exact_motion_agrees_with_fine_integration_of_the_paper_s_dynamics(
    distance: float, heading: float, right: float, left: float
) -> None:
    d, t = np.array([distance]), np.array([heading])
    for _ in range(300):  # eq. 26 in small steps is eq. 20
        d, t, _, _ = model.moved_first_order(d, t, right / 300, left / 300, 0.4)
    step = arc(np.array([right]), np.array([left]), 0.4)[0]
    w, heading1, _, _ = model.moved_exactly(np.array([1.0 / distance]), np.array([heading]), step)
    assert 1.0 / w[0] == pytest.approx(d[0], abs=2e-3)
    assert abs(wrap(float(heading1[0] - t[0]))) < 2e-3


@calm
@given(heading=angles, phi=angles, rho=lengths, psi=angles)
def test_a_far_line_shows_only_the_sum_of_heading_phi_and_psi(
    heading: float, phi: float, rho: float, psi: float
) -> None:
    told = model.bearing_inverse(np.array([0.0]), np.array([heading]), phi, rho, psi)[0]  # eq. 25
    assert abs(wrap(told - (np.pi - heading - phi - psi))) < 1e-9


@calm
@given(w=st.floats(0.0, 0.9), heading=angles, phi=angles, rho=lengths, psi=angles)
def test_a_line_s_heading_comes_back_from_its_bearing(
    w: float, heading: float, phi: float, rho: float, psi: float
) -> None:
    beta = model.bearing_inverse(np.array([w]), np.array([heading]), phi, rho, psi)
    assert abs(wrap(float(model.heading_from_bearing(beta, np.array([w]), phi, rho, psi)[0] - heading))) < 1e-7


@calm
@given(phi=angles, rho=lengths, psi=angles)
def test_polar_and_cartesian_mounts_are_inverse_with_inverse_slopes(phi: float, rho: float, psi: float) -> None:
    cartesian, forth = model.cartesian_from_polar(np.array([phi, rho, psi]))
    polar, back = model.polar_from_cartesian(cartesian)
    off = polar - [phi, rho, psi]
    assert abs(wrap(float(off[0]))) < 1e-9
    assert abs(off[1]) < 1e-9
    assert abs(wrap(float(off[2]))) < 1e-9
    np.testing.assert_allclose(back @ forth, np.eye(3), atol=1e-9)


def lie_rank(state: Array, straight: bool, turning: bool) -> int:
    """Rank of what bearings along the allowed motions show: that of the Lie derivatives of h, taken together."""

    def h(x: Array) -> float:
        # Without wrapping: sin and cos of eq. 27 are smooth where the angle itself jumps.
        return float(np.sin(model.bearing(x[:1], x[1:2], x[2], x[3], x[4])[0]))

    def flow(x: Array, v: float, omega: float) -> Array:
        step = arc(np.array([v + 0.2 * omega]), np.array([v - 0.2 * omega]), 0.4)[0]
        w, heading, _, _ = model.moved_exactly(1.0 / x[:1], x[1:2], step)
        return np.array([1.0 / w[0], heading[0], x[2], x[3], x[4]])

    motions = [(0.3, 0.0)] * straight + [(0.0, 0.6)] * turning

    def seen(x: Array) -> Array:
        """h before and after many motions: what all Lie derivatives together tell."""
        sights = [h(x)]
        for first in motions:
            for second in motions:
                for k in (-2, -1, 1, 2):
                    for m in (0, 1, 2):
                        sights.append(h(flow(flow(x, k * first[0], k * first[1]), m * second[0], m * second[1])))
        return np.array(sights)

    jacobian = slope(seen, state, 1e-5)
    jacobian = jacobian * np.array([1.0, 1.0, 1.0, 0.2, 1.0])
    values = np.linalg.svd(jacobian, compute_uv=False)
    return int(np.sum(values > 1e-6 * values[0]))


@pytest.mark.parametrize(
    ("distance", "straight", "turning", "rank"),
    [
        (2.0, True, True, 5),  # one line suffices
        (1e7, False, True, 1),  # turn, far: theta + phi + psi
        (2.0, False, True, 3),  # turn, close: lambda, theta + phi, psi
    ],
)
def test_what_one_line_shows_is_what_the_paper_derives(
    distance: float, straight: bool, turning: bool, rank: int
) -> None:
    assert lie_rank(np.array([distance, 0.7, -0.34, 0.23, 0.33]), straight, turning) == rank


def test_straight_driving_by_a_close_line_shows_less_than_everything() -> None:
    assert lie_rank(np.array([2.0, 0.7, -0.34, 0.23, 0.33]), True, False) < 5
