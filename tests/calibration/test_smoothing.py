"""The smoother in the background: the same results, whenever it gets done; and the pulse goes on meanwhile."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.smoothing import Background, at_once
from omnivert.calibration.solver.result import Outcome
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, State, Ticks
from omnivert.simulation.recording import Drive, Knock, Scene, recorded
from omnivert.wire.codec import encode

Array = NDArray[np.float64]
Told = list[Estimate | Extrinsics]


def told(drive: Drive, background: Background[Outcome] = at_once) -> Told:
    calibrator = Calibrator(Config(), background=background)
    out: Told = []
    for message in drive.messages:
        out += calibrator.step(message)
    return [*out, *calibrator.close()]


def late(job: Callable[[], Outcome]) -> Callable[[], Outcome]:
    """Works only when the result is asked for."""
    return job


def test_results_do_not_depend_on_when_the_smoother_gets_done() -> None:
    drive = recorded(Scene(path="alternate"), Config(), 5)
    first = [encode(message) for message in told(drive)]
    assert [encode(message) for message in told(drive, late)] == first
    with ThreadPoolExecutor(1) as pool:
        assert [encode(message) for message in told(drive, lambda job: pool.submit(job).result)] == first


def test_the_last_frame_is_told_once_more_with_everything_solved() -> None:
    estimates = [m for m in told(recorded(Scene(path="alternate"), Config(), 5)) if isinstance(m, Estimate)]
    last, before = estimates[-1], estimates[-2]
    assert (last.stamp_ns, last.frame) == (before.stamp_ns, before.frame)
    assert last.smoother is not None
    assert last.mount is not None
    assert last.mount.phi_rad == last.smoother.phi_rad
    assert last.disagreement == 0.0
    assert before.disagreement < 1.0
    assert last.bound_std is not None
    assert (last.bound_std <= 1.001 * np.sqrt(np.diag(last.smoother.covariance))).all()


def test_a_knock_is_noticed_taken_back_and_the_new_place_is_found() -> None:
    knock = Knock(45.0, yaw_rad=float(np.deg2rad(2.0)))
    drive = recorded(Scene(path="alternate", repeat=2, bearing_std_rad=0.001, knock=knock), Config(), 2)
    out = told(drive)
    estimates = [m for m in out if isinstance(m, Estimate)]
    claims = [m for m in out if isinstance(m, Extrinsics)]
    moved = [e for e in estimates if e.state is State.MOVED]
    assert 45.0 <= 1e-9 * moved[0].stamp_ns < 48.0
    assert "the camera moved by" in moved[0].phi.reason
    assert [claim.state for claim in claims].count(State.MOVED) == 1
    taken_back = next(k for k, claim in enumerate(claims) if claim.state is State.MOVED)
    assert claims[taken_back].mount == claims[taken_back - 1].mount
    assert estimates[-1].state is State.CALIBRATED
    mount = estimates[-1].mount
    assert mount is not None
    off = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]) - drive.mount_at[-1]
    off[[0, 2]] = wrap(off[[0, 2]])
    assert off @ np.linalg.solve(mount.covariance, off) < 21.1  # chi-square of 3, 1 in 10 000


def test_nobody_is_told_that_a_camera_moved_that_did_not() -> None:
    out = told(recorded(Scene(path="alternate", repeat=2, bearing_std_rad=0.001), Config(), 2))
    assert [m for m in out if m.state is State.CALIBRATED]
    assert not [m for m in out if m.state is State.MOVED]


def with_people(drive: Drive, seed: int) -> tuple[Ticks | Bearings, ...]:
    """Three people walk around the robot all the time."""
    rng = np.random.default_rng(seed)
    phi, rho, psi = drive.mount
    out: list[Ticks | Bearings] = []
    frame = 0
    for message in drive.messages:
        if isinstance(message, Bearings):
            x, y, heading = drive.pose[frame]
            camera = np.array([x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi)])
            walk = 0.06 * frame + 2.0 * np.arange(3)
            people = (
                np.stack([1.5 * np.cos(walk) + 0.5, 1.5 * np.sin(walk) + 0.4 * np.arange(3) - 0.4], axis=1) - camera
            )
            beta = np.arctan2(people[:, 1], people[:, 0]) - heading - phi - psi + 0.003 * rng.standard_normal(3)
            message = replace(
                message,
                track_id=np.concatenate([message.track_id, 100_000 + np.arange(3)]),
                bearing_rad=np.concatenate([message.bearing_rad, wrap(beta)]),
                std_rad=np.concatenate([message.std_rad, np.full(3, 0.003)]),
                age_frames=np.concatenate([message.age_frames, np.zeros(3, dtype=np.int32)]),
                strength=np.concatenate([message.strength, np.ones(3, dtype=np.float32)]),
            )
            frame += 1
        out.append(message)
    return tuple(out)


def test_people_who_walk_about_are_left_out() -> None:
    for seed in (0, 1):
        drive = recorded(Scene(path="alternate"), Config(), seed)
        estimates = [m for m in told(replace(drive, messages=with_people(drive, seed))) if isinstance(m, Estimate)]
        last = estimates[-1]
        assert last.state is State.CALIBRATED
        assert last.mount is not None
        off = np.array([last.mount.phi_rad, last.mount.rho_m, last.mount.psi_rad]) - drive.mount
        off[[0, 2]] = wrap(off[[0, 2]])
        assert off @ np.linalg.solve(last.mount.covariance, off) < 16.3  # chi-square of 3, 1 in 1000
