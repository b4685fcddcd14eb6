"""What the way has shown: pieces, covariances, centres of rotation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import Kind, Piece, Unseen, centres, larger, pieces, seen
from omnivert.odometry import after, arc
from omnivert.simulation.robot import drive
from omnivert.simulation.world import lines_beside, seen_lines

Array = NDArray[np.float64]

BASE, K, TICK, STD = 0.4, 2e-4, 2.4e-4, 0.003
LIMIT_RAD, LIMIT_M = float(np.deg2rad(2.0)), 0.010


def wheels_of(path: str, seed: int, radius: float = 0.5) -> Array:
    rng = np.random.default_rng(seed)
    trip = drive(path, BASE, K, 0.02, rng, radius)  # type: ignore[arg-type]
    steps = np.diff(trip.wheels_m[::17], axis=0)
    return np.asarray(steps + np.sqrt(K * np.abs(steps)) * rng.standard_normal(steps.shape))


@pytest.mark.parametrize(("path", "kinds"), [("straight", 1), ("turn", 1), ("arc", 1), ("paper", 2), ("alternate", 2)])
def test_a_noisy_way_is_cut_into_its_manoeuvres(path: str, kinds: int) -> None:
    for seed in range(10):
        assert len(centres(pieces(wheels_of(path, seed), BASE, K, TICK))) == kinds


def test_standing_still_has_no_centre() -> None:
    assert centres(pieces(np.zeros((50, 2)), BASE, K, TICK)) == []


def test_forward_and_backward_are_the_same_centre() -> None:
    way = np.concatenate([np.full((20, 2), 0.05), np.full((20, 2), -0.05)])
    assert len(centres(pieces(way, BASE, K, TICK))) == 1


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_the_larger_covariance_is_no_smaller_than_either(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (a @ a.T + 0.01 * np.eye(3) for a in rng.standard_normal((2, 3, 3)))
    both = larger(first, second)
    for one in (first, second):
        assert np.linalg.eigvalsh(both - one).min() > -1e-9


def gathered(wheels: Array, mount: Array, seed: int, scale: float = 1.0, visible: float = 10.0) -> Array:
    """Information on eta, cx, cy that a drive leaves on its nominal way, lines as far as they may be.

    wheels  (F-1, 2)  m, as the encoders tell
    mount   (3,)      eta, cx, cy
    scale   of the lines' distances
    """
    rng = np.random.default_rng(seed)
    told = wheels.copy()
    at = 0
    for piece in pieces(wheels, BASE, K, TICK):
        ratio = np.array([piece.right_m, piece.left_m]) / max(np.hypot(piece.right_m, piece.left_m), 1e-12)
        told[at : at + piece.steps] = (wheels[at : at + piece.steps] @ ratio)[:, None] * ratio
        at += piece.steps
    pose = np.zeros((wheels.shape[0] + 1, 3))
    for i, step in enumerate(arc(told[:, 0], told[:, 1], BASE)):
        pose[i + 1] = after(pose[i], step)
    lines = lines_beside(pose[:, :2], 30, rng)
    is_seen = seen_lines(lines, pose[:, :2], visible, rng)
    frame, line = np.nonzero(is_seen[:, is_seen.any(axis=0)])
    lines = lines[is_seen.any(axis=0)] * scale
    direction, w = np.arctan2(lines[:, 1], lines[:, 0]), 1.0 / np.hypot(*lines.T)
    # One motion lets lines and camera shrink together into its centre, so the camera's place is held at first.
    near = min((float(np.hypot(*(mount[1:] - p.centre_m))) for p in pieces(wheels, BASE, K, TICK)), default=0.2)
    held = np.diag([0.0, 1.0, 1.0]) / (0.1 * min(near, 0.2)) ** 2
    matrix = _information(told, pose, mount, direction, w, frame, line) + _padded(held, pose, lines)
    w_std = np.sqrt(np.diag(np.linalg.inv(matrix[3:, 3:]))[-w.size :])
    matrix = _information(told, pose, mount, direction, np.maximum(w - 2.0 * w_std, 0.0), frame, line)[3:, 3:]
    n = 3 * (pose.shape[0] - 1)
    rest = np.delete(np.arange(matrix.shape[0]), np.arange(n, n + 3))
    m = slice(n, n + 3)
    return np.asarray(matrix[m, m] - matrix[m, rest] @ np.linalg.solve(matrix[np.ix_(rest, rest)], matrix[rest, m]))


def wheel_noise(right: float, left: float, samples: int = 8) -> Array:
    """Covariance (3, 3) of one increment: each wheel's noise at each encoder sample, to first order."""
    turn = (right - left) / BASE * (np.arange(samples) + 0.5) / samples
    step = 0.5 * (right + left) / samples * np.exp(1j * turn)
    left_to_go = step.sum() - np.cumsum(step) + 0.5 * step
    noise = np.zeros((3, 3))
    for way, sign in ((right, 1.0), (left, -1.0)):
        place = 0.5 * np.exp(1j * turn) + sign / BASE * 1j * left_to_go
        slope = np.stack([place.real, place.imag, np.full(samples, sign / BASE)])
        noise += K * abs(way) / samples * slope @ slope.T
    return noise


def _padded(held: Array, pose: Array, lines: Array) -> Array:
    n = pose.size
    matrix = np.zeros((n + 3 + 2 * lines.shape[0],) * 2)
    matrix[n : n + 3, n : n + 3] = held
    return matrix


def _information(
    told: Array,
    pose: Array,
    mount: Array,
    direction: Array,
    w: Array,
    frame: NDArray[np.int64],
    line: NDArray[np.int64],
) -> Array:
    """Of poses, mount, directions and inverse distances from the first place; places as complex numbers."""
    frames, lines = pose.shape[0], w.size
    n = 3 * frames
    matrix = np.zeros((n + 3 + 2 * lines,) * 2)
    turn = np.exp(1j * pose[frame, 2])
    c = mount[1] + 1j * mount[2]
    place = pose[frame, 0] + 1j * pose[frame, 1] + turn * c
    u = np.exp(1j * direction[line])
    sight = u - w[line] * place
    slope = np.zeros((frame.size, matrix.shape[0]))
    row = np.arange(frame.size)
    for column, change in (
        (3 * frame, -w[line]),
        (3 * frame + 1, -1j * w[line]),
        (3 * frame + 2, -1j * w[line] * turn * c),
        (np.full(frame.size, n + 1), -w[line] * turn),
        (np.full(frame.size, n + 2), -1j * w[line] * turn),
        (n + 3 + line, 1j * u),
        (n + 3 + lines + line, -place),
    ):
        slope[row, column] = (change / sight).imag  # of the angle of the sight
    slope[row, 3 * frame + 2] -= 1.0
    slope[:, n] = -1.0
    matrix += slope.T @ slope / STD**2
    matrix[np.arange(n + 3, n + 3 + lines), np.arange(n + 3, n + 3 + lines)] += 1e-6
    matrix[np.arange(n + 3 + lines, n + 3 + 2 * lines), np.arange(n + 3 + lines, n + 3 + 2 * lines)] += 1.0 / 3.0**2
    for i in range(frames - 1):
        noise = wheel_noise(told[i, 0], told[i, 1])
        information = np.linalg.inv(noise + np.diag([2e-5, 2e-5, 5e-5]) ** 2)
        d = pose[i + 1] - pose[i]
        back = np.exp(-1j * pose[i, 2])
        rotation = np.array([[back.real, -back.imag, 0.0], [back.imag, back.real, 0.0], [0.0, 0.0, 1.0]])
        seen_d = (d[0] + 1j * d[1]) * back
        before = -rotation.copy()
        before[:2, 2] = seen_d.imag, -seen_d.real
        both = np.hstack([before, rotation])
        matrix[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += both.T @ information @ both
    return matrix


def any_mount(seed: int) -> Array:
    rng = np.random.default_rng(10_000 + seed)
    rho, phi = rng.uniform(0.08, 0.40), rng.uniform(-np.pi, np.pi)
    return np.array([rng.uniform(-np.pi, np.pi), rho * np.cos(phi), rho * np.sin(phi)])


def named(path: str, seed: int, radius: float = 0.5, scale: float = 1.0) -> Unseen:
    wheels, mount = wheels_of(path, seed, radius), any_mount(seed)
    found = tuple(centres(pieces(wheels, BASE, K, TICK)))
    return seen(gathered(wheels, mount, seed, scale), mount, found, LIMIT_RAD, LIMIT_M).unseen


RUNS = 12


@pytest.mark.parametrize(
    ("path", "radius", "scale", "name"),
    [
        ("straight", 0.5, 1.0, Unseen.PLACE),
        ("turn", 0.5, 1.0, Unseen.PHI_AND_RHO),
        ("arc", 0.3, 1.0, Unseen.SLIDE),
        ("arc", 0.5, 1.0, Unseen.SLIDE),
        ("arc", 1.9, 1.0, Unseen.SLIDE),
        ("still", 0.5, 1.0, Unseen.EVERYTHING),
        ("alternate", 0.5, 100.0, Unseen.EVERYTHING),
        ("alternate", 0.5, 1.0, Unseen.NOTHING),
        ("paper", 0.5, 1.0, Unseen.NOTHING),
    ],
)
def test_what_a_noisy_drive_leaves_unseen_is_named_rightly(
    path: str, radius: float, scale: float, name: Unseen
) -> None:
    assert [named(path, seed, radius, scale) for seed in range(RUNS)] == [name] * RUNS


def test_without_information_nothing_is_seen_whatever_was_driven() -> None:
    for found in ((), (Piece(9, 0.6, 0.6, 0.6, 0.01),), (Piece(9, 0.6, 0.6, 0.6, 0.0), Piece(9, 0.2, -0.2, 0.0, 1.0))):
        shown = seen(np.zeros((3, 3)), np.array([0.1, 0.2, 0.0]), found, LIMIT_RAD, LIMIT_M)
        assert shown.unseen is Unseen.EVERYTHING
        assert min(shown.rho_m, shown.psi_rad, shown.sum_rad, shown.to_centre_rad) > 50.0


@settings(deadline=None, max_examples=60)
@given(
    radius=st.one_of(st.floats(0.05, 3.0), st.floats(-3.0, -0.05), st.just(0.0)),
    shrink=st.floats(0.2, 3.0),
    turn=st.floats(-3.0, 3.0),
    seed=st.integers(0, 10_000),
)
def test_sliding_about_the_centre_of_rotation_leaves_every_bearing(
    radius: float, shrink: float, turn: float, seed: int
) -> None:
    """The theorem behind the names: camera, its heading and lines scaled and turned about C = (0, R)."""
    rng = np.random.default_rng(seed)
    centre, heading = 1j * radius, rng.uniform(-np.pi, np.pi, 20)  # of a robot on its way about C, which stays
    lines = rng.normal(size=5) * 3.0 + 1j * rng.normal(size=5) * 3.0
    camera, eta = complex(*rng.normal(size=2) * 0.3), rng.uniform(-np.pi, np.pi)

    def bearing(c: complex, eta: float, m: NDArray[np.complex128]) -> NDArray[np.complex128]:
        place = centre + np.exp(1j * heading) * (c - centre)
        sight = (m[None, :] - place[:, None]) * np.exp(-1j * (heading + eta))[:, None]
        return np.asarray(sight / np.abs(sight))

    slide = shrink * np.exp(1j * turn)
    moved = bearing(centre + slide * (camera - centre), eta + turn, centre + slide * (lines - centre))
    np.testing.assert_allclose(moved, bearing(camera, eta, lines), atol=1e-9)


@pytest.mark.parametrize(
    ("right", "left", "kind", "radius"),
    [
        (0.6, 0.6, Kind.STRAIGHT, np.inf),
        (-0.6, -0.6, Kind.STRAIGHT, np.inf),
        (0.3, -0.3, Kind.TURN, 0.0),
        (0.7, 0.3, Kind.CIRCLE, 0.5),
        (0.3, 0.7, Kind.CIRCLE, -0.5),
        (-0.3, -0.7, Kind.CIRCLE, -0.5),
        (2.1, 1.7, Kind.CIRCLE, 1.9),
        (0.1, -0.5, Kind.CIRCLE, -0.4 / 3.0),
    ],
)
def test_a_piece_knows_its_centre(right: float, left: float, kind: Kind, radius: float) -> None:
    piece = pieces(np.tile([right / 20, left / 20], (20, 1)), BASE, K, TICK)[0]
    assert piece.kind is kind
    np.testing.assert_allclose(piece.centre_m, [0.0, radius], atol=1e-9)


@pytest.mark.parametrize(
    ("open_way", "name"),
    [
        ([0.0, -0.15, 0.1], Unseen.PHI_AGAINST_PSI),
        ([0.0, 0.1, 0.15], Unseen.RHO),
        ([1.0, 0.0, 0.0], Unseen.HEADING),
    ],
)
def test_with_two_centres_the_one_open_direction_is_named(open_way: list[float], name: Unseen) -> None:
    unit = np.array([LIMIT_RAD, LIMIT_M, LIMIT_M])
    way = np.array(open_way) / unit
    way /= np.linalg.norm(way)
    information = (np.eye(3) * 25.0 - 24.99 * np.outer(way, way)) / np.outer(unit, unit)
    two = (Piece(9, 0.6, 0.6, 0.6, 0.0), Piece(9, 0.2, -0.2, 0.0, 1.0))
    shown = seen(information, np.array([0.3, 0.1, 0.15]), two, LIMIT_RAD, LIMIT_M)
    assert shown.unseen is name
    assert abs(shown.weakest @ way) > 0.99


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_sigmas_of_what_is_seen_are_those_of_the_information(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((3, 3))
    information = 1e3 * (a @ a.T + 0.1 * np.eye(3))
    mount = any_mount(seed)
    draws = mount + rng.multivariate_normal(np.zeros(3), 1e-6 * np.linalg.inv(information), 20_000)
    shown = seen(information, mount, (), LIMIT_RAD, LIMIT_M)
    phi = np.angle((draws[:, 1] + 1j * draws[:, 2]) / (mount[1] + 1j * mount[2]))
    told = [shown.phi_rad, shown.rho_m, shown.psi_rad, shown.sum_rad]
    drawn = [phi, np.hypot(draws[:, 1], draws[:, 2]), draws[:, 0] - phi, draws[:, 0]]
    np.testing.assert_allclose([1e3 * np.std(d) for d in drawn], told, rtol=0.05)
