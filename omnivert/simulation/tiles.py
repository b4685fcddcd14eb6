"""Surfaces' textures: noise without a scale of its own that could alias, in tiles that repeat, each at many sizes."""

from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Tone = NDArray[np.float32]

SIZE = 128  # texels along a side of a tile at its finest
LEVELS = 6  # 128, 64, ... 4
TEXEL_M = 0.012  # of the finest level
START = np.cumsum([0, *(SIZE * SIZE >> 2 * level for level in range(LEVELS))])  # where each level begins in a tile
_SEED = 2009


class Tile(IntEnum):
    """What a surface looks like close by; the order is that of the tiles."""

    PLAIN = 0
    PLASTER = 1
    WOOD = 2
    PAINTING = 3
    CARPET = 4


@lru_cache(maxsize=1)
def tiles() -> Tone:
    """(tiles, texels of all levels), each of mean 0 and, but for the plain one, of sigma 1."""
    rng = np.random.default_rng(_SEED)
    made = {
        Tile.PLAIN: np.zeros((SIZE, SIZE)),
        Tile.PLASTER: _noise(rng, 2.0, 1.0),
        Tile.WOOD: _noise(rng, 1.2, 9.0),
        Tile.PAINTING: np.tanh(1.5 * _noise(rng, 2.2, 1.0)),
        Tile.CARPET: _noise(rng, 0.8, 1.0),
    }
    return np.stack([_levels(made[tile]) for tile in Tile]).astype(np.float32)


def _noise(rng: np.random.Generator, steepness: float, stretched: float) -> NDArray[np.float64]:
    """Noise whose amplitude falls with the frequency to this power, and that is stretched so much in height."""
    along = np.fft.fftfreq(SIZE, 1.0 / SIZE)
    frequency = np.hypot(along[:, None] * stretched, along[None, :])  # rows go up, columns along the wall
    shape = np.where(frequency > 0.0, (frequency + 2.0) ** -steepness, 0.0) * (frequency < 0.4 * SIZE)
    field = np.fft.ifft2(np.fft.fft2(rng.standard_normal((SIZE, SIZE))) * shape).real
    return np.asarray(field / field.std())


def _levels(finest: NDArray[np.float64]) -> NDArray[np.float64]:
    """The tile at every size, each the mean of two by two texels of the one before."""
    levels = [finest]
    for _ in range(1, LEVELS):
        n = levels[-1].shape[0] // 2
        levels.append(levels[-1].reshape(n, 2, n, 2).mean(axis=(1, 3)))
    return np.concatenate([level.ravel() for level in levels])


@compiled
def level_of(footprint_m: float) -> int:
    """The level at which a texel is about as large as what one sample looks at."""
    level, texel = 0, 1.4 * TEXEL_M
    while level < LEVELS - 1 and footprint_m > texel:
        level, texel = level + 1, 2.0 * texel
    return level


@compiled
def tone(texels: Tone, level: int, across_m: float, up_m: float) -> float:
    """A tile's value at a place of its surface, between its four nearest texels."""
    size = SIZE >> level
    scale = 1.0 / (TEXEL_M * (1 << level))
    x, y = across_m * scale - 0.5, up_m * scale - 0.5
    i, j = np.floor(x), np.floor(y)
    fx, fy = x - i, y - j
    mask = size - 1
    left, low = int(i) & mask, int(j) & mask
    right, high = (left + 1) & mask, (low + 1) & mask
    at = START[level]
    below = texels[at + low * size + left] * (1.0 - fx) + texels[at + low * size + right] * fx
    above = texels[at + high * size + left] * (1.0 - fx) + texels[at + high * size + right] * fx
    return float(below * (1.0 - fy) + above * fy)
