"""The best that anybody could do with a synthetic drive: the smoother, begun at the truth, with the inliers alone."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.corrections import first_prior
from omnivert.calibration.kalman import model
from omnivert.calibration.solver.marginal import marginal_mean
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.smoother import Search, marginal
from omnivert.calibration.solver.stretch import Stretch
from omnivert.calibration.solver.triangulation import anchors
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND, Odometer
from omnivert.simulation.recording import Drive

Array = NDArray[np.float64]


def oracle(drive: Drive, config: Config) -> tuple[Array, Array] | None:
    """phi, rho, psi (3,) and covariance (3, 3), all corrections known to be nothing; None on a drive without lines."""
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    for message in drive.messages:
        if isinstance(message, Ticks):
            odometer.push(message)
    stretch = Stretch(config)
    last: int | None = None
    frames: list[int] = []
    seen = [message for message in drive.messages if isinstance(message, Bearings)]
    for index, (frame, inlier) in enumerate(zip(seen, drive.inlier, strict=True)):
        if frame.stamp_ns > (odometer.newest_ns or 0):
            continue
        wheels = None if last is None else odometer.samples(last, frame.stamp_ns)
        beta, std = frame.bearing_rad[inlier], frame.std_rad[inlier]
        stretch.append(frame.stamp_ns / SECOND, wheels, frame.track_id[inlier], beta, std)
        last = frame.stamp_ns
        frames.append(index)
    posed = stretch.posed(first_prior(), 10_000, 2)
    problem = posed.problem
    if problem.frames < 3 or not problem.lines:
        return None
    x, y, heading = drive.pose[frames[0]]
    c, s = np.cos(heading), np.sin(heading)
    back = np.array([[c, s], [-s, c]])
    at = drive.pose[frames]
    pose = np.column_stack([(at[:, :2] - [x, y]) @ back.T, at[:, 2] - heading])
    anchor = anchors(problem, pose)
    line = np.array([back @ (drive.line_of_track[int(name)] - [x, y]) for name in posed.names]) - anchor
    mount = model.cartesian_from_polar(drive.mount)[0]
    truth = Unknowns(
        pose,
        np.concatenate([mount, np.zeros(3)]),
        anchor,
        np.arctan2(line[:, 1], line[:, 0]),
        1.0 / np.hypot(line[:, 0], line[:, 1]),
    )
    search = Search(replace(problem, prior=first_prior()))
    solution = search.polished(search.solved(truth, problem.std, 30))
    found, slope = model.polar_from_cartesian(marginal_mean(search, solution).mount)
    information = marginal(solution.shared_information, np.zeros(3, dtype=np.bool_))
    return found, slope @ np.linalg.inv(information) @ slope.T
