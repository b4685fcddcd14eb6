"""Synthetic pictures through a mirror: everything in them is known."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Scene = Callable[..., NDArray[np.uint8]]


def _scene(
    angles_rad: NDArray[np.float64],
    levels: NDArray[np.float64],
    *,
    center: tuple[float, float] = (321.5, 239.0),
    r_min: float = 63.0,
    r_max: float = 225.0,
    size: tuple[int, int] = (640, 480),
    noise: float = 0.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Grey (H, W): wedges between radial edges at sorted image angles; levels[k] from edge k on to the next.

    Every edge is a pixel wide across itself; black inside r_min and outside r_max.
    """
    v, u = np.mgrid[: size[1], : size[0]]
    x, y = u - center[0], -(v - center[1])
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    picture = np.full(r.shape, levels[-1], dtype=np.float64)
    for k, angle in enumerate(angles_rad):
        # Edge k against edge 0 the other way round: the step at pi is edge-free because both sides hold levels[-1].
        picture += np.clip(r * (theta - angle) + 0.5, 0.0, 1.0) * (levels[k] - levels[k - 1])
    inside = np.clip(r_max - r + 0.5, 0.0, 1.0) * np.clip(r - r_min + 0.5, 0.0, 1.0)
    picture = picture * inside + np.random.default_rng(seed).normal(0.0, 1.0, r.shape) * noise
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)


@pytest.fixture(scope="session")
def scene() -> Scene:
    return _scene


@pytest.fixture(scope="session")
def textured() -> NDArray[np.uint8]:
    """A busy picture 640x480 of blurred noise with a ring, the same every time."""
    rng = np.random.default_rng(5)
    rough = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (480, 640)), (0, 0), 4.0)
    rough = (rough - rough.min()) / (rough.max() - rough.min()) * 255.0
    v, u = np.mgrid[:480, :640]
    return np.where(np.hypot(u - 321.5, v - 239.0) <= 225.0, rough, 0.0).astype(np.uint8)
