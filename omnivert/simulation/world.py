"""Vertical lines beside the robot's way, and which of them a tracker sees when."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAREST_M, BAND_M = 1.3, 0.2  # walls this far off the way, and this thick
RANGE_M = 3.5
MEAN_LIFE = 40.0  # frames that a line stays tracked, on average


def lines_beside(way: Array, count: int, rng: np.random.Generator) -> Array:
    """Lines on walls along a way; none nearer to it than the walls.

    way      (S, 2)  m
    returns  (count, 2)  m
    """
    found: list[Array] = []
    spread = np.array([way.min(axis=0), way.max(axis=0)]) + np.array([[-1.0], [1.0]]) * (NEAREST_M + BAND_M)
    thin = way[:: max(1, way.shape[0] // 400)]
    while len(found) < count:
        for place in rng.uniform(spread[0], spread[1], (200, 2)):
            off = float(np.hypot(*(thin - place).T).min())
            if NEAREST_M <= off <= NEAREST_M + BAND_M:
                found.append(place)
    return np.array(found[:count]).reshape(-1, 2)


def seen_lines(lines: Array, way: Array, visible: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which line is tracked in which frame: within range, with births and deaths.

    lines    (L, 2)  m
    way      (F, 2)  m  the robot at each frame
    visible  lines seen in a frame, on average
    returns  (F, L)
    """
    near = np.hypot(lines[None, :, 0] - way[:, None, 0], lines[None, :, 1] - way[:, None, 1]) < RANGE_M
    share = min(0.95, visible / max(1.0, float(near.sum(axis=1).mean())))
    die = 1.0 / MEAN_LIFE
    born = die * share / (1.0 - share)
    alive = np.empty(near.shape, dtype=np.bool_)
    alive[0] = rng.random(lines.shape[0]) < share
    for frame in range(1, way.shape[0]):
        chance = rng.random(lines.shape[0])
        alive[frame] = np.where(alive[frame - 1], chance >= die, chance < born)
    return alive & near
