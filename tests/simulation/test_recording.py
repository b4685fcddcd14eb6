"""The synthetic drive is what it says: exact where it is exact, noisy as told."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import model
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.simulation.recording import Drive, Knock, Scene, recorded
from omnivert.simulation.robot import drive


def test_a_seed_gives_the_same_drive_again() -> None:
    first, second = (recorded(Scene(path="paper"), Config(), 5) for _ in range(2))
    assert len(first.messages) == len(second.messages)
    for one, other in zip(first.messages, second.messages, strict=True):
        assert one.stamp_ns == other.stamp_ns
        if isinstance(one, Bearings):
            assert isinstance(other, Bearings)
            np.testing.assert_array_equal(one.bearing_rad, other.bearing_rad)


def test_messages_are_in_the_order_of_their_stamps() -> None:
    stamps = [m.stamp_ns for m in recorded(Scene(), Config(), 1).messages]
    assert stamps == sorted(stamps)


def test_bearings_are_those_of_the_model_within_their_noise() -> None:
    trip = recorded(Scene(path="alternate"), Config(), 7)
    frames = [m for m in trip.messages if isinstance(m, Bearings)]
    errors = []
    for frame, pose, good in zip(frames, trip.pose, trip.inlier, strict=True):
        for track, beta, inlier in zip(frame.track_id.tolist(), frame.bearing_rad.tolist(), good.tolist(), strict=True):
            off = pose[:2] - trip.line_of_track[track]
            theta = np.array([pose[2] - np.arctan2(off[1], off[0])])
            told = model.bearing(np.array([np.hypot(*off)]), theta, *trip.mount)[0]
            if inlier:
                errors.append(wrap(beta - told))
    assert np.std(errors) == pytest.approx(0.003, rel=0.1)
    assert abs(np.mean(errors)) < 0.0005


def test_outliers_are_as_many_as_asked_for() -> None:
    trip = recorded(Scene(outliers=0.2), Config(), 3)
    assert np.mean(~np.concatenate(trip.inlier)) == pytest.approx(0.2, abs=0.04)


@pytest.mark.parametrize(
    ("path", "way", "turn"), [("paper", 3.3, np.pi), ("straight", 6.0, 0.0), ("turn", 0.0, 2 * np.pi)]
)
def test_the_encoders_tell_the_commanded_way(path: str, way: float, turn: float) -> None:
    config = Config()
    ticks = [m for m in recorded(Scene(path=path), config, 0).messages if isinstance(m, Ticks)]  # type: ignore[arg-type]
    scale = config.encoder.metres_per_tick
    right, left = ticks[-1].right * scale, ticks[-1].left * scale
    assert (right + left) / 2 == pytest.approx(way, abs=0.002)
    assert (right - left) / config.robot.wheel_base_m == pytest.approx(turn, abs=0.002)


def test_wheel_noise_is_that_of_the_configuration() -> None:
    config = Config()
    base, k = config.robot.wheel_base_m, config.encoder.noise_k_m
    ends = np.array([drive("paper", base, k, 0.2, np.random.default_rng(seed), 0.5).pose[-1] for seed in range(60)])
    expected = np.sqrt(k * (2.0 * 3.3 + np.pi * base)) / base
    assert np.std(ends[:, 2]) == pytest.approx(expected, rel=0.25)


def bearings_of(trip: Drive) -> list[Bearings]:
    return [m for m in trip.messages if isinstance(m, Bearings)]


def test_a_late_camera_stamps_what_it_saw_before() -> None:
    for offset in (0.083, -0.083):
        trip = recorded(Scene(time_offset_s=offset, bearing_std_rad=1e-9, outliers=0.0), Config(), 2)
        frames = bearings_of(trip)
        stamps = np.array([frame.stamp_ns for frame in frames]) * 1e-9
        np.testing.assert_allclose(stamps - trip.time_s, offset, atol=1e-8)
        assert stamps.min() >= 0.0
        assert stamps.max() <= trip.sample_time_s[-1]  # the counts cover every frame
        np.testing.assert_allclose(seen_from(trip, trip.time_s), 0.0, atol=1e-7)
        moving = np.abs(np.interp(stamps, trip.sample_time_s, np.gradient(trip.sample_wheels_m[:, 0]))) > 1e-4
        assert np.abs(seen_from(trip, stamps)[moving[inside(trip)]]).max() > 1e-3


def inside(trip: Drive) -> NDArray[np.int64]:
    """The frame of each bearing."""
    return np.repeat(np.arange(trip.pose.shape[0]), [frame.track_id.size for frame in bearings_of(trip)])


def seen_from(trip: Drive, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bearings told less those of the model, with the robot where it was at these times, one for each frame."""
    errors = []
    for frame, t, mount in zip(bearings_of(trip), time_s.tolist(), trip.mount_at, strict=True):
        pose = np.array([np.interp(t, trip.sample_time_s, trip.sample_pose[:, k]) for k in range(3)])
        for track, beta in zip(frame.track_id.tolist(), frame.bearing_rad.tolist(), strict=True):
            off = pose[:2] - trip.line_of_track[track]
            theta = np.array([pose[2] - np.arctan2(off[1], off[0])])
            errors.append(wrap(beta - model.bearing(np.array([np.hypot(*off)]), theta, *mount)[0]))
    return np.array(errors)


def test_wrong_wheels_change_the_world_and_not_what_the_encoders_tell() -> None:
    config = Config.model_validate({"encoder": {"noise_k_m": 1e-12}})
    base = config.robot.wheel_base_m
    right_way = recorded(Scene(path="paper"), config, 4)
    wrong = recorded(Scene(path="paper", wheel_ratio=1.02, base_factor=1.05), config, 4)
    np.testing.assert_array_equal(wrong.sample_wheels_m, right_way.sample_wheels_m)
    corner = int(np.flatnonzero(np.diff(wrong.sample_wheels_m[:, 1]) < 0.0)[0])
    ratio_turn = 3.3 * (2.0 * 1.02 - 2.0) / 2.02 / (1.05 * base)  # (right - left) / true base
    assert wrong.sample_pose[corner, 2] == pytest.approx(ratio_turn, rel=1e-4)
    turned = wrong.sample_pose[-1, 2] - wrong.sample_pose[corner, 2]
    assert turned == pytest.approx(np.pi / 1.05, rel=1e-4)


def test_a_knock_moves_the_camera_as_a_rigid_body() -> None:
    knock = Knock(at_s=10.0, yaw_rad=0.1, forward_m=0.02, left_m=-0.03)
    trip = recorded(Scene(knock=knock, outliers=0.0, bearing_std_rad=1e-9), Config(), 5)
    before, after = trip.mount, trip.mount_at[-1]
    assert (trip.mount_at[trip.time_s < 10.0] == before).all()
    assert (trip.mount_at[trip.time_s >= 10.0] == after).all()
    place = [m[1] * np.array([np.cos(m[0]), np.sin(m[0])]) for m in (before, after)]
    np.testing.assert_allclose(place[1] - place[0], [0.02, -0.03], atol=1e-12)
    assert wrap(after[0] + after[2] - before[0] - before[2]) == pytest.approx(0.1)
    np.testing.assert_allclose(seen_from(trip, trip.time_s), 0.0, atol=1e-7)


def test_a_world_may_have_no_lines() -> None:
    frames = bearings_of(recorded(Scene(lines=0), Config(), 1))
    assert sum(frame.track_id.size for frame in frames) == 0
    assert len(frames) > 100
