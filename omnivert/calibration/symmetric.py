"""Symmetric matrices, of one that is so but for its rounding, or of one triangle; no repair of anything else."""

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]


@compiled
def evened(matrix: Array) -> Array:
    """The mean of a matrix (N, N) and its transpose."""
    out = np.empty(matrix.shape)
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            mean = 0.5 * (matrix[i, j] + matrix[j, i])
            out[i, j] = mean
            out[j, i] = mean
    return out


@compiled
def mirrored(upper: Array) -> Array:
    """The symmetric matrix (N, N) that has this upper triangle."""
    whole = np.empty(upper.shape)
    for i in range(upper.shape[0]):
        for j in range(i, upper.shape[0]):
            whole[i, j] = upper[i, j]
            whole[j, i] = upper[i, j]
    return whole
