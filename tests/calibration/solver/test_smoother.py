"""The whole stretch at once: normal equations, joint covariance, start from nothing."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.judging.corrections import first_prior
from omnivert.calibration.kalman import model
from omnivert.calibration.solver.layout import Layout
from omnivert.calibration.solver.normal import (
    Unknowns,
    bearing_errors,
    increment_information,
    normal,
    step_errors,
)
from omnivert.calibration.solver.problem import GLOBALS, Prior, Problem, dead_reckoned, with_frames, with_lines
from omnivert.calibration.solver.smoother import Search, joint, marginal
from omnivert.calibration.solver.start import started, unknowns
from omnivert.calibration.solver.stretch import Stretch
from omnivert.calibration.solver.triangulation import line_from_sights
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND, Odometer
from omnivert.simulation.recording import Drive, Scene, recorded

Array = NDArray[np.float64]


def stretch_of(drive: Drive, config: Config, jump_at: int | None = None) -> Stretch:
    """Every frame a keyframe; from `jump_at` on the first track shows another line."""
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    for message in drive.messages:
        if isinstance(message, Ticks):
            odometer.push(message)
    newest = odometer.newest_ns or 0
    stretch = Stretch(config)
    last = None
    for index, frame in enumerate(m for m in drive.messages if isinstance(m, Bearings)):
        if frame.stamp_ns > newest:
            continue
        beta = frame.bearing_rad.copy()
        if jump_at is not None and index >= jump_at:
            beta[0] = wrap(beta[0] + 1.0)
        wheels = None if last is None else odometer.samples(last, frame.stamp_ns)
        stretch.append(frame.stamp_ns / SECOND, wheels, frame.track_id, beta, frame.std_rad)
        last = frame.stamp_ns
    return stretch


def problem_of(drive: Drive, config: Config) -> Problem:
    return stretch_of(drive, config).posed(first_prior(), 200, 4).problem


def short(problem: Problem, frames: int) -> Problem:
    return with_frames(problem, 0, frames)[0]


def mount_error(mount: Array, drive: Drive) -> Array:
    off = model.polar_from_cartesian(mount)[0] - drive.mount
    off[[0, 2]] = wrap(off[[0, 2]])
    return off


@pytest.mark.parametrize("free", [(True, True, True), (False, True, False)])
def test_normal_equations_are_those_of_the_numerical_jacobian(free: tuple[bool, ...]) -> None:
    config = Config()
    problem = short(problem_of(recorded(Scene(path="alternate"), config, 0), config), 24)
    rng = np.random.default_rng(0)
    information = np.diag(rng.uniform(1.0, 5.0, GLOBALS))
    prior = Prior(rng.normal(0.0, 0.1, GLOBALS), information, np.array([True, True, True, *free]), np.zeros(3))
    problem = replace(problem, prior=prior)
    moved = problem.increments(np.zeros(3))
    pose = dead_reckoned(moved.step)
    pose[1:] += 0.01 * rng.standard_normal((problem.frames - 1, 3))
    x = unknowns(problem, pose, np.array([0.3, 0.2, 0.1, 0.0, 0.0, 0.0]))
    x = Unknowns(x.pose, x.shared, x.anchor, x.u, np.clip(x.w, 0.2, 1.0))
    told = increment_information(moved.covariance) * 1e-6
    root = np.linalg.cholesky(told)
    weight = np.linspace(1.0, 2.0, problem.beta.size)
    layout = Layout.of(problem)

    def at(z: Array) -> Unknowns:
        poses = np.concatenate([np.zeros((1, 3)), z[layout.pose[1:, None] + np.arange(3)]])
        return Unknowns(poses, z[layout.shared :], x.anchor, z[layout.line], z[layout.line + 1])

    def residuals(z: Array) -> Array:
        y = at(z)
        p = problem
        bearing = bearing_errors(p.frame, p.line, p.beta, y.pose, y.mount, y.anchor, y.u, y.w)
        step = moved.step + moved.slope @ np.where(free, y.corrections, 0.0)
        return np.concatenate(
            [
                np.sqrt(weight) * bearing,
                -np.einsum("nji,nj->ni", root, step_errors(y.pose, step)).ravel(),
                np.sqrt(np.diag(information)) * (prior.mean - y.shared),
                -y.w / 3.0,
            ]
        )

    z = np.zeros(layout.shared + GLOBALS)
    z[layout.pose[1:, None] + np.arange(3)] = x.pose[1:]
    z[layout.line], z[layout.line + 1], z[layout.shared :] = x.u, x.w, x.shared
    jacobian = np.array([(residuals(z + h) - residuals(z - h)) / 2e-6 for h in 1e-6 * np.eye(z.size)]).T
    whole, gradient = jacobian.T @ jacobian, -jacobian.T @ residuals(z)
    whole[layout.line, layout.line] += 1e-6
    held = layout.shared + 3 + np.flatnonzero(~np.array(free))
    whole[held], whole[:, held], gradient[held] = 0.0, 0.0, 0.0
    whole[held, held] = 1.0
    p = problem
    error = bearing_errors(p.frame, p.line, p.beta, x.pose, x.mount, x.anchor, x.u, x.w)
    found = normal(problem, layout, x, error, weight, moved, told, 0.0)
    for row in range(z.size):
        begin = int(layout.first[row])
        stored = found.values[layout.start[row] : layout.start[row + 1]]
        np.testing.assert_allclose(stored, whole[row, begin : row + 1], atol=2e-4)
        np.testing.assert_array_equal(whole[row, :begin], 0.0)
    np.testing.assert_allclose(found.vector, gradient, atol=2e-4)


def dense(layout: Layout, values: Array) -> Array:
    size = layout.shared + GLOBALS
    matrix = np.zeros((size, size))
    for row in range(size):
        begin = int(layout.first[row])
        matrix[row, begin : row + 1] = values[layout.start[row] : layout.start[row + 1]]
    return matrix + np.tril(matrix, -1).T


def test_joint_covariance_is_that_of_the_full_inverse() -> None:
    config = Config()
    problem = short(problem_of(recorded(Scene(), config, 3), config), 60)
    found = started(problem, 1.0, 4, 60)
    assert found is not None
    solution = found.solution
    n = solution.normal
    inverse = np.linalg.inv(dense(n.layout, n.values))
    lines = np.unique(problem.line[problem.frame == problem.frames - 1])[:2]
    rows = [
        *range(int(n.layout.pose[-1]), int(n.layout.pose[-1]) + 3),
        *range(n.layout.shared, n.layout.shared + 3),
        *(int(n.layout.line[k]) + i for k in lines for i in (0, 1)),
    ]
    expected = inverse[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        joint(solution, lines) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-4
    )
    w_std = np.sqrt(np.diag(inverse)[n.layout.line + 1])
    np.testing.assert_allclose(solution.inverse_distance_std(), w_std, rtol=1e-4)
    shared = inverse[n.layout.shared : n.layout.shared + 3, n.layout.shared : n.layout.shared + 3]
    np.testing.assert_allclose(np.linalg.inv(solution.mount_information), shared, rtol=1e-3)


def test_what_is_free_is_taken_off_the_information() -> None:
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 6))
    information = root @ root.T
    free = np.array([False, True, True])
    kept = np.array([0, 1, 2, 4, 5])
    expected = np.linalg.inv(np.linalg.inv(information[np.ix_(kept, kept)])[:3, :3])
    np.testing.assert_allclose(marginal(information, free), expected)


@pytest.mark.parametrize(("path", "seed"), [("paper", 8), ("alternate", 1)])
def test_the_start_needs_no_guess_and_ends_where_the_truth_leads(path: str, seed: int) -> None:
    config = Config()
    drive = recorded(Scene(path=path), config, seed)  # type: ignore[arg-type]
    problem = problem_of(drive, config)
    found = started(problem, 1.0, 4, 60)
    assert found is not None
    assert found.gap > 25.0
    mount, _ = model.cartesian_from_polar(drive.mount)
    search = Search(problem)
    begin = unknowns(problem, drive.pose[: problem.frames].copy(), np.concatenate([mount, np.zeros(3)]))
    told = search.polished(search.solved(begin, problem.std, 20))
    assert found.solution.score < told.score + 3.0
    error = mount_error(found.solution.x.mount, drive)
    slope = model.polar_from_cartesian(found.solution.x.mount)[1]
    sigma = np.sqrt(np.diag(slope @ np.linalg.inv(found.solution.mount_information) @ slope.T))
    assert (np.abs(error) < 4.0 * sigma).all()
    assert 0.9 < found.solution.inlier_share < 0.99


def test_half_a_drive_is_a_problem_of_its_own() -> None:
    config = Config()
    problem = problem_of(recorded(Scene(), config, 3), config)
    part, lines = with_frames(problem, 20, 60)
    assert part.frames == 40
    assert part.lines == lines.size
    whole = problem.increments(np.zeros(3)).step
    np.testing.assert_allclose(part.increments(np.zeros(3)).step, whole[20:59], atol=1e-12)
    assert int(part.frame.max()) < 40


def test_chosen_lines_keep_their_bearings() -> None:
    config = Config()
    problem = problem_of(recorded(Scene(), config, 3), config)
    part = with_lines(problem, np.array([5, 2]))
    np.testing.assert_array_equal(part.beta[part.line == 0], problem.beta[problem.line == 5])
    np.testing.assert_array_equal(part.beta[part.line == 1], problem.beta[problem.line == 2])


def test_a_line_is_found_among_wrong_sights() -> None:
    rng = np.random.default_rng(5)
    eye = np.column_stack([np.linspace(0.0, 2.0, 20), np.zeros(20)])
    line = np.array([1.5, 2.0])
    angle = np.arctan2(line[1] - eye[:, 1], line[0] - eye[:, 0]) + 0.003 * rng.standard_normal(20)
    angle[[3, 4, 5, 11, 17]] = rng.uniform(-np.pi, np.pi, 5)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    anchor = np.array([1.0, 0.0])
    u, w, _ = line_from_sights(eye, direction, np.full(20, 0.003), anchor)
    assert anchor + np.array([np.cos(u), np.sin(u)]) / w == pytest.approx(line, abs=0.1)


def test_a_track_that_jumps_to_another_line_becomes_two() -> None:
    config = Config()
    drive = recorded(Scene(path="alternate", lasting=True, lines=8, outliers=0.0), config, 4)
    stretch = stretch_of(drive, config, jump_at=80)
    posed = stretch.posed(first_prior(), 200, 4)
    found = started(posed.problem, 1.0, 4, 60)
    assert found is not None
    stretch.remember(posed, found.solution, clear=True)
    names = stretch.posed(first_prior(), 200, 4).names
    assert names.size == posed.names.size + 1
    assert names.min() < 0
