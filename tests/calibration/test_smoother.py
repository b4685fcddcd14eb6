"""The whole stretch at once: normal equations, joint covariance, start from nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration import model
from omnivert.calibration.normal import Unknowns, normal, sights, step_errors
from omnivert.calibration.problem import Problem, dead_reckoned, thinned, with_frames
from omnivert.calibration.smoother import joint, polished, solved
from omnivert.calibration.start import started, unknowns
from omnivert.calibration.stretch import Stretch
from omnivert.calibration.triangulation import line_from_sights
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import Odometer, nothing
from omnivert.simulation.recording import Drive, Scene, recorded

Array = NDArray[np.float64]


def problem_of(drive: Drive, config: Config) -> Problem:
    """Every frame a keyframe."""
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    frames = [m for m in drive.messages if isinstance(m, Bearings)]
    for message in drive.messages:
        if isinstance(message, Ticks):
            odometer.push(message)
    newest = odometer.newest_ns or 0
    stretch = Stretch()
    last = None
    for frame in frames:
        if frame.stamp_ns <= newest:
            motion = nothing() if last is None else odometer.motion(last, frame.stamp_ns)
            assert motion is not None
            stretch.append(motion, frame.track_id, frame.bearing_rad, frame.std_rad)
            last = frame.stamp_ns
    return stretch.posed(np.zeros(3), np.zeros((3, 3)), 200, 4).problem


def mount_error(mount: Array, drive: Drive) -> Array:
    off = model.polar_from_cartesian(mount)[0] - drive.mount
    off[[0, 2]] = wrap(off[[0, 2]])
    return off


def test_normal_equations_are_those_of_the_numerical_jacobian() -> None:
    config = Config()
    problem, _ = thinned(problem_of(recorded(Scene(path="paper"), config, 0), config), 8)
    rng = np.random.default_rng(0)
    pose = dead_reckoned(problem.step) + 0.01 * rng.standard_normal((problem.frames, 3))
    x = unknowns(problem, pose, np.array([0.3, 0.2, 0.1]))
    x = Unknowns(x.pose, x.mount, x.anchor, x.u, np.clip(x.w, 0.2, 1.0))
    information = problem.step_information() * 1e-6
    root = np.linalg.cholesky(information)
    weight = np.linspace(1.0, 2.0, problem.beta.size)
    size, lines = 3 * problem.frames + 3, problem.lines

    def residuals(z: Array) -> Array:
        at = Unknowns(
            z[: size - 3].reshape(-1, 3), z[size - 3 : size], x.anchor, z[size::2].copy(), z[size + 1 :: 2].copy()
        )
        error, _, _ = step_errors(problem, at.pose)
        return np.concatenate(
            [
                np.sqrt(weight) * sights(problem, at).error,
                -np.einsum("nji,nj->ni", root, error).ravel(),
                -at.w / 3.0,
            ]
        )

    z = np.concatenate([x.pose.ravel(), x.mount, np.stack([x.u, x.w], axis=1).ravel()])
    jacobian = np.array([(residuals(z + h) - residuals(z - h)) / 2e-6 for h in 1e-6 * np.eye(z.size)]).T
    whole, gradient = jacobian.T @ jacobian, -jacobian.T @ residuals(z)
    turns = np.arange(size, size + 2 * lines, 2)
    whole[turns, turns] += 1e-6
    back = np.linalg.solve(whole[size:, size:], np.column_stack([whole[size:, :size], gradient[size:]]))
    found = normal(problem, x, sights(problem, x), weight, information, 0.0)
    np.testing.assert_allclose(found.matrix, whole[:size, :size] - whole[:size, size:] @ back[:, :-1], atol=1e-4)
    np.testing.assert_allclose(found.vector, gradient[:size] - whole[:size, size:] @ back[:, -1], atol=1e-4)


def test_joint_covariance_is_that_of_the_full_inverse() -> None:
    config = Config()
    problem, _ = thinned(problem_of(recorded(Scene(), config, 3), config), 30)
    found = started(problem, 1.0, 4, 30, 60)
    assert found is not None
    solution = found.solution
    n = solution.normal
    lines = np.array([0, 2])
    size = n.matrix.shape[0]
    # The full matrix: what the elimination had taken away is put back.
    couplings = n.coupling.reshape(size, -1)
    blocks = np.zeros((couplings.shape[1], couplings.shape[1]))
    for k, block in enumerate(n.line_matrix):
        blocks[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    upper = n.matrix + couplings @ np.linalg.solve(blocks, couplings.T)
    inverse = np.linalg.inv(np.block([[upper[3:, 3:], couplings[3:]], [couplings[3:].T, blocks]]))
    rows = [*range(size - 9, size - 3), *(size - 3 + 2 * k + i for k in lines for i in (0, 1))]
    expected = inverse[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        joint(solution, lines) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-4
    )


@pytest.mark.parametrize(("path", "seed"), [("paper", 8), ("alternate", 1)])
def test_the_start_needs_no_guess_and_ends_where_the_truth_leads(path: str, seed: int) -> None:
    config = Config()
    drive = recorded(Scene(path=path), config, seed)  # type: ignore[arg-type]
    problem = problem_of(drive, config)
    found = started(problem, 1.0, 4, 64, 60)
    assert found is not None
    assert found.gap > 25.0
    mount, _ = model.cartesian_from_polar(drive.mount)
    told = polished(
        problem, solved(problem, unknowns(problem, drive.pose[: problem.frames].copy(), mount), problem.std, 20)
    )
    assert found.solution.score < told.score + 3.0
    error = mount_error(found.solution.x.mount, drive)
    slope = model.polar_from_cartesian(found.solution.x.mount)[1]
    sigma = np.sqrt(np.diag(slope @ np.linalg.inv(found.solution.mount_information()) @ slope.T))
    assert (np.abs(error) < 4.0 * sigma).all()
    assert 0.9 < found.solution.inlier_share() < 0.99


def test_half_a_drive_is_a_problem_of_its_own() -> None:
    config = Config()
    problem = problem_of(recorded(Scene(), config, 3), config)
    part, lines = with_frames(problem, 20, 60)
    assert part.frames == 40
    assert part.lines == lines.size
    np.testing.assert_array_equal(part.step, problem.step[20:59])
    assert int(part.frame.max()) < 40


def test_a_line_is_found_among_wrong_sights() -> None:
    rng = np.random.default_rng(5)
    eye = np.column_stack([np.linspace(0.0, 2.0, 20), np.zeros(20)])
    line = np.array([1.5, 2.0])
    direction = np.arctan2(line[1] - eye[:, 1], line[0] - eye[:, 0]) + 0.003 * rng.standard_normal(20)
    direction[[3, 4, 5, 11, 17]] = rng.uniform(-np.pi, np.pi, 5)
    anchor = np.array([1.0, 0.0])
    u, w, _ = line_from_sights(eye, direction, np.full(20, 0.003), anchor)
    assert anchor + np.array([np.cos(u), np.sin(u)]) / w == pytest.approx(line, abs=0.1)


def test_a_track_that_jumps_to_another_line_becomes_two() -> None:
    config = Config()
    drive = recorded(Scene(path="alternate", lasting=True, lines=8, outliers=0.0), config, 4)
    frames = [m for m in drive.messages if isinstance(m, Bearings)]
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    for message in drive.messages:
        if isinstance(message, Ticks):
            odometer.push(message)
    stretch = Stretch()
    last = None
    for index, frame in enumerate(frames[:-1]):
        motion = nothing() if last is None else odometer.motion(last, frame.stamp_ns)
        assert motion is not None
        last = frame.stamp_ns
        beta = frame.bearing_rad.copy()
        if index >= 80:
            beta[0] = wrap(beta[0] + 1.0)  # somewhere else, and it stays there
        stretch.append(motion, frame.track_id, beta, frame.std_rad)
    posed = stretch.posed(np.zeros(3), np.zeros((3, 3)), 200, 4)
    found = started(posed.problem, 1.0, 4, 64, 60)
    assert found is not None
    stretch.remember(posed, found.solution)
    names = stretch.posed(np.zeros(3), np.zeros((3, 3)), 200, 4).names
    assert len(names) == len(posed.names) + 1
    assert min(names) < 0
