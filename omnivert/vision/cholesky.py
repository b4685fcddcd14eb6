"""Small positive definite systems inside compiled loops; numpy.linalg there takes seconds to compile."""

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Float = NDArray[np.float64]


@compiled
def factored(matrix: Float) -> Float:
    """The lower triangular L with L L' = matrix (N, N), positive definite."""
    size = matrix.shape[0]
    lower = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(max(rest, 1e-300)) if i == j else rest / lower[j, j]
    return lower


@compiled
def solved(lower: Float, right: Float) -> Float:
    """x (N,) with L L' x = right."""
    x = right.copy()
    for i in range(x.size):
        for k in range(i):
            x[i] -= lower[i, k] * x[k]
        x[i] /= lower[i, i]
    for i in range(x.size - 1, -1, -1):
        for k in range(i + 1, x.size):
            x[i] -= lower[k, i] * x[k]
        x[i] /= lower[i, i]
    return x
