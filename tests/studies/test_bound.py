"""The bound is what its closed forms, its numerical slopes and earlier measurements say."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import model
from omnivert.config import Config
from omnivert.messages import Bearings
from omnivert.odometry import after, arc
from omnivert.simulation.recording import Drive, Knock, Scene, recorded
from omnivert.studies.bound import CORRECTIONS, Bound, bound_of, knock_bound, slopes_of, twists, wheel_slopes

Array = NDArray[np.float64]
STEP = 1e-6


def sigmas(bound: Bound) -> Array:
    return np.sqrt(np.diag(bound.covariance))


def medians(scene: Scene, seeds: int, free: tuple[str, ...] = (), noise_k_m: float = 2e-4) -> Array:
    """Of the bounds of several drives."""
    config = Config.model_validate({"encoder": {"noise_k_m": noise_k_m}})
    return np.median([sigmas(bound_of(recorded(scene, config, k), config, free)) for k in range(seeds)], axis=0)


def told(pose: Array, line: Array, mount: Array) -> float:
    off = pose[:2] - line
    theta = np.array([pose[2] - np.arctan2(off[1], off[0])])
    return float(model.bearing(np.array([np.hypot(*off)]), theta, *mount)[0])


def test_slopes_of_the_bearings_are_those_of_the_model() -> None:
    drive = recorded(Scene(visible=4.0), Config(), 3)
    slopes = slopes_of(drive, drive.pose)
    std = drive.scene.bearing_std_rad
    for row in range(0, slopes.frame.size, 37):
        pose, line = drive.pose[slopes.frame[row]], drive.line_of_track[int(slopes.track[row])]
        given = np.concatenate([pose, line, drive.mount])
        numeric = np.array(
            [
                wrap(told(high[:3], high[3:5], high[5:]) - told(low[:3], low[3:5], low[5:])) / (2.0 * STEP)
                for high, low in ((given + STEP * e, given - STEP * e) for e in np.eye(8))
            ]
        )
        analytic = std * np.concatenate([slopes.pose[row], slopes.line[row], slopes.mount[row]])
        np.testing.assert_allclose(analytic, numeric, atol=1e-7)


def driven(wheels: Array, base: float) -> Array:
    pose = np.zeros((wheels.shape[0] + 1, 3))
    for k, step in enumerate(arc(wheels[:, 0], wheels[:, 1], base)):
        pose[k + 1] = after(pose[k], step)
    return pose


def test_a_wheels_noise_moves_all_that_follows_as_one_rigid_body() -> None:
    rng = np.random.default_rng(0)
    base = 0.4
    wheels = np.where(rng.random((40, 1)) < 0.5, 1.0, -1.0) * rng.uniform(0.0, 0.01, (40, 2))
    pose = driven(wheels, base)
    found = twists(pose[:-1], wheels, base)
    for sample in (0, 7, 23):
        for side in (0, 1):
            step = np.zeros_like(wheels)
            step[sample, side] = STEP
            numeric = (driven(wheels + step, base) - driven(wheels - step, base))[sample + 1 :] / (2.0 * STEP)
            a, b, delta = found[sample, :, side]
            later = pose[sample + 1 :]
            analytic = np.column_stack([a - later[:, 1] * delta, b + later[:, 0] * delta, np.full(len(later), delta)])
            # The middle of the chord, for a turn inside one sample that is small.
            np.testing.assert_allclose(analytic, numeric, atol=2e-4)


def test_the_slope_of_the_wheels_is_numerical() -> None:
    high, low = wheel_slopes(1.02 + STEP)[0], wheel_slopes(1.02 - STEP)[0]
    np.testing.assert_allclose(wheel_slopes(1.02)[1], (high - low) / (2.0 * STEP), atol=1e-8)
    assert wheel_slopes(1.02)[0].mean() == pytest.approx(1.0)


def test_base_and_ratio_are_known_as_well_as_the_wheels_noise_allows() -> None:
    """sigma(base) = sqrt(K / (e turn)), sigma(ratio) = sqrt(2 K / way), whatever the camera sees."""
    for path, way, turn in (("paper", 3.3, np.pi), ("alternate", 2.25, 1.5 * np.pi)):
        ratio, base = medians(Scene(path=path, bearing_std_rad=1e-4), 2, CORRECTIONS)[-2:]  # type: ignore[arg-type]
        assert base == pytest.approx(np.sqrt(2e-4 / (0.4 * turn)), rel=0.02)
        assert ratio == pytest.approx(np.sqrt(2.0 * 2e-4 / way), rel=0.02)


def test_three_times_straight_and_turn_has_the_limit_that_was_measured_before() -> None:
    phi, rho, psi = medians(Scene(), 12)
    assert np.degrees(phi) == pytest.approx(0.46, rel=0.15)
    assert 1e3 * rho == pytest.approx(2.77, rel=0.2)
    assert np.degrees(psi) == pytest.approx(0.44, rel=0.15)


def test_what_is_unknown_too_costs_little_and_never_gains() -> None:
    drive = recorded(Scene(), Config(), 1)
    held, freed = bound_of(drive, Config()), bound_of(drive, Config(), CORRECTIONS)
    assert (np.linalg.eigvalsh(freed.mount - held.mount) > -1e-12).all()
    assert (sigmas(freed)[:3] < 1.35 * sigmas(held)).all()
    assert freed.names == ("phi", "rho", "psi", *CORRECTIONS)
    assert freed.std("time_offset") == pytest.approx(0.008, rel=0.3)


def test_the_time_offset_is_seen_at_starts_and_stops_alone() -> None:
    """A straight way at constant speed, cut out of the drive by its frames, shows none of it."""
    drive = recorded(Scene(path="straight"), Config(), 1)
    assert bound_of(drive, Config(), ("time_offset",)).std("time_offset") < 0.1
    middle = (drive.time_s > 1.0) & (drive.time_s < 38.0)
    assert bound_of(only(drive, middle), Config(), ("time_offset",)).std("time_offset") > 1.0


def only(drive: Drive, frames: NDArray[np.bool_]) -> Drive:
    """The drive with the bearings of these frames called outliers elsewhere."""
    inlier = tuple(good & keep for good, keep in zip(drive.inlier, frames.tolist(), strict=True))
    return Drive(**{**{name: getattr(drive, name) for name in Drive.__slots__}, "inlier": inlier})


@pytest.mark.parametrize("path", ["straight", "turn", "arc", "still"])
def test_without_the_wheels_noise_one_motion_shows_no_mount(path: str) -> None:
    drive = recorded(Scene(path=path), Config(), 2)  # type: ignore[arg-type]
    bound = bound_of(drive, Config(), nominal=True)
    assert bound.std("phi") > 1.0
    assert bound.std("rho") > 1.0
    alternate = recorded(Scene(), Config(), 2)
    ratio = sigmas(bound_of(alternate, Config(), nominal=True)) / sigmas(bound_of(alternate, Config()))
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)


def test_a_longer_drive_knows_more_and_one_without_lines_nothing() -> None:
    drive = recorded(Scene(), Config(), 4)
    first, whole = bound_of(drive, Config(), until_s=25.0), bound_of(drive, Config())
    assert (np.linalg.eigvalsh(first.mount - whole.mount) > 0.0).all()
    assert (sigmas(bound_of(recorded(Scene(lines=0), Config(), 4), Config())) > 5.0).all()
    knocked = recorded(Scene(knock=Knock(at_s=25.0, yaw_rad=0.05)), Config(), 4)
    np.testing.assert_allclose(bound_of(knocked, Config()).covariance, first.covariance, rtol=1e-9)


def test_outliers_carry_no_information() -> None:
    drive = recorded(Scene(outliers=0.0), Config(), 5)
    frames = sum(isinstance(m, Bearings) for m in drive.messages)
    none = np.zeros(frames, dtype=np.bool_)
    assert (sigmas(bound_of(only(drive, none), Config())) > 5.0).all()


# ------------------------------------------------------------------ a knock


def test_the_bound_of_a_knock_is_that_of_least_squares_over_everything() -> None:
    """By numbers: the slopes of all bearings and wheel noises by all unknowns, the jump among them, at the truth."""
    config = Config.model_validate({"encoder": {"noise_k_m": 2e-4}})
    scene = Scene(path="alternate", lines=6, lasting=True, frame_s=1.0, sample_s=0.1, knock=Knock(9.5, yaw_rad=1e-9))
    drive = recorded(scene, config, 4)
    found = knock_bound(drive, config, 14.2)
    frames = int((drive.time_s < 14.2).sum())
    messages = [m for m in drive.messages if isinstance(m, Bearings)][:frames]
    names = sorted({name for m in messages for name in m.track_id.tolist()})
    told = np.diff(drive.sample_wheels_m, axis=0)
    last = int(np.searchsorted(drive.sample_time_s, drive.time_s[frames - 1], side="right"))
    moves = told[:last]
    rolled = np.flatnonzero(np.abs(moves).ravel() > 0.0)

    def bearings(noise: Array, mount: Array, jump: Array, lines: Array) -> Array:
        wheels = moves.copy()
        wheels.ravel()[rolled] += noise * np.sqrt(2e-4 * np.abs(wheels.ravel()[rolled]))
        pose = np.zeros((last + 1, 3))
        for i, step in enumerate(arc(wheels[:, 0], wheels[:, 1], config.robot.wheel_base_m)):
            pose[i + 1] = after(pose[i], step)
        at = np.stack([np.interp(drive.time_s[:frames], drive.sample_time_s[: last + 1], pose[:, k]) for k in range(3)])
        out = []
        for f, m in enumerate(messages):
            x, y, heading = at[:, f]
            hit = drive.time_s[f] >= 9.5
            place = np.array([mount[1] * np.cos(mount[0]), mount[1] * np.sin(mount[0])]) + hit * jump[1:]
            c, s = np.cos(heading), np.sin(heading)
            camera = np.array([x + c * place[0] - s * place[1], y + s * place[0] + c * place[1]])
            sight = lines[[names.index(n) for n in m.track_id.tolist()]] - camera
            out.append(np.arctan2(sight[:, 1], sight[:, 0]) - heading - mount[0] - mount[2] - hit * jump[0])
        return np.concatenate(out)

    # The drive as the encoders tell it, and the lines where they then stand: the bound is linearised there.
    lines = np.array([drive.line_of_track[name] for name in names])
    parts = [np.zeros(rolled.size), drive.mount, np.zeros(3), lines.ravel()]
    cuts = np.cumsum([part.size for part in parts])[:-1]

    def of(x: Array) -> Array:
        noise, mount, jump, places = np.split(x, cuts)
        return bearings(noise, mount, jump, places.reshape(-1, 2))

    x = np.concatenate(parts)
    good = np.concatenate(drive.inlier[:frames])
    slope = np.stack([wrap(of(x + h) - of(x - h))[good] / (2.0 * STEP) for h in STEP * np.eye(x.size)], axis=1)
    information = slope.T @ slope / scene.bearing_std_rad**2
    information[np.diag_indices(rolled.size)] += 1.0
    everything = np.linalg.inv(information + 1e-9 * np.eye(x.size))
    jump = slice(cuts[1], cuts[2])
    np.testing.assert_allclose(found, everything[jump, jump], rtol=0.05, atol=1e-9)
