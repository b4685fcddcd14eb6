"""The way between stamps: against arcs put together one by one, against noisy drives, against numerical slopes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.increments import Wheels, increments
from omnivert.odometry import after, arc

Array = NDArray[np.float64]
BASE, K = 0.4, 2e-4
NONE = np.zeros(3)


def wheels(noise: np.random.Generator | None = None, tick_m: float = 0.0) -> Wheels:
    """A smooth way with turns, told every 20 ms for two seconds."""
    time: Array = np.linspace(0.0, 2.0, 101)
    speed = np.stack([0.3 + 0.2 * np.sin(3.0 * time), 0.3 - 0.25 * np.sin(3.0 * time + 0.4)])
    steps = 0.02 * speed[:, 1:]
    if noise is not None:
        steps = steps + np.sqrt(K * np.abs(steps)) * noise.standard_normal(steps.shape)
    way = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
    return Wheels(time, way[0], way[1], BASE, K, tick_m)


def told(given: Wheels, stamps: Array, corrections: Array = NONE) -> Array:
    return increments(given, stamps, np.zeros(stamps.size - 1, dtype=np.bool_), corrections).step


def test_the_way_is_that_of_arcs_one_after_the_other() -> None:
    given = wheels()
    stamps = np.array([0.1, 0.5, 1.3])
    for found, (first, last) in zip(told(given, stamps), ((5, 25), (25, 65)), strict=True):
        pose = np.zeros(3)
        for k in range(first, last):
            step = arc(np.diff(given.right_m[k : k + 2]), np.diff(given.left_m[k : k + 2]), BASE)[0]
            pose = after(pose, step)
        np.testing.assert_allclose(found, pose, atol=1e-12)


def test_stamps_between_samples_share_the_arc() -> None:
    whole = told(wheels(), np.array([0.1, 1.3]))[0]
    first, second = told(wheels(), np.array([0.1, 0.507, 1.3]))
    np.testing.assert_allclose(after(first, second), whole, atol=1e-6)


def test_covariance_is_that_of_many_noisy_drives() -> None:
    rng = np.random.default_rng(1)
    stamps, broken = np.array([0.2, 1.8]), np.array([False])
    claimed = increments(wheels(), stamps, broken, NONE).covariance[0]
    drives = np.array([told(wheels(rng), stamps)[0] for _ in range(4000)])
    white = np.linalg.inv(np.linalg.cholesky(claimed))
    np.testing.assert_allclose(white @ np.cov(drives.T) @ white.T, np.eye(3), atol=0.12)


def test_rounded_counts_widen_the_covariance_by_both_ends() -> None:
    stamps, broken = np.array([0.2, 1.8]), np.array([False])
    fine, coarse = (increments(wheels(tick_m=t), stamps, broken, NONE).covariance[0] for t in (0.0, 0.01))
    assert coarse[2, 2] - fine[2, 2] == pytest.approx(2.0 * 0.01**2 / 6.0 / BASE**2, rel=1e-6)


@pytest.mark.parametrize("at", [NONE, np.array([0.04, 0.03, -0.05])])
@pytest.mark.parametrize("unknown", [0, 1, 2])
def test_slopes_by_the_corrections_are_the_numerical_ones(at: Array, unknown: int) -> None:
    stamps, broken = np.array([0.3, 0.9, 1.5]), np.zeros(2, dtype=np.bool_)
    small = 1e-3 * (np.arange(3) == unknown)
    slope = (told(wheels(), stamps, at + small) - told(wheels(), stamps, at - small)) / 2e-3
    found = increments(wheels(), stamps, broken, at).slope[:, :, unknown]
    np.testing.assert_allclose(found, slope, atol=0.02 if unknown == 0 else 1e-5)  # speeds are taken over 50 ms


def test_an_unknown_way_is_nothing() -> None:
    found = increments(wheels(), np.array([0.3, 0.9, 1.5]), np.array([True, False]), NONE)
    assert not found.step[0].any()
    assert not found.covariance[0].any()
    assert found.step[1].any()
