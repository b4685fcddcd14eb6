"""The synthetic drive is what it says: exact where it is exact, noisy as told."""

import numpy as np
import pytest

from omnivert.angles import wrap
from omnivert.calibration import model
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.simulation.recording import Scene, recorded
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
