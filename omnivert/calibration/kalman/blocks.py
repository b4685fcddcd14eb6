"""The filter's covariance by blocks, compiled: what dense algebra would do with a hundred times the zeros.

The state is line by line (first, theta), then phi, rho, psi; `ekf.Layout` names its parts.
"""

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@compiled
def driven(by_input: Array, noise: Array) -> Array:
    """What spread a motion adds to the state, Q.

    by_input  (Z, 2, U)  slope of each line's two by the motion
    noise     (U, U)     of the motion
    returns   (2 Z + 3, 2 Z + 3): the mount gets none
    """
    lines, inputs = by_input.shape[0], noise.shape[0]
    q = np.zeros((2 * lines + 3, 2 * lines + 3))
    spread = np.zeros((2 * lines, inputs))
    for i in range(2 * lines):
        for k in range(inputs):
            for u in range(inputs):
                spread[i, k] += by_input[i // 2, i % 2, u] * noise[u, k]
    for i in range(2 * lines):
        for j in range(i + 1):
            total = 0.0
            for k in range(inputs):
                total += spread[i, k] * by_input[j // 2, j % 2, k]
            q[i, j] = total
            q[j, i] = total
    return q


@compiled
def foretold(covariance: Array, slopes: Array, lines: Index, std: Array) -> Array:
    """What spread the innovations of some lines should have, S = H P H' + R; symmetric to the last digit.

    covariance  (M, M)  of the state, P
    slopes      (N, 5)  of the bearings by the line's own two and by phi, rho, psi
    lines       (N,)    which line of the state each one is
    std         (N,)    rad
    returns     (N, N)
    """
    size, count = covariance.shape[0], lines.size
    mount = size - 3
    s, hp = np.empty((count, count)), np.zeros((count, size))
    for i in range(count):
        for k in range(5):
            column = 2 * lines[i] + k if k < 2 else mount + k - 2
            slope = slopes[i, k]
            for j in range(size):
                hp[i, j] += slope * covariance[column, j]
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for k in range(5):
                column = 2 * lines[j] + k if k < 2 else mount + k - 2
                total += hp[i, column] * slopes[j, k]
            s[i, j] = total
            s[j, i] = total
        s[i, i] += std[i] ** 2
    return s


@compiled
def picked(matrix: Array, rows: Index) -> Array:
    """These rows and columns of a matrix (N, N) alone (K, K)."""
    out = np.empty((rows.size, rows.size))
    for i in range(rows.size):
        for j in range(rows.size):
            out[i, j] = matrix[rows[i], rows[j]]
    return out


@compiled
def without(precision: Array, k: int) -> None:
    """The inverse of a covariance, in place, becomes that of the covariance without its row and column k.

    precision  (N, N)  rows and columns that are gone are zero

    The inverse of a part is B - b b' / d, with b the column that goes and d its diagonal: no new inverse is needed.
    """
    gone = precision[k].copy()
    scale = 1.0 / gone[k]
    for i in range(gone.size):
        factor = gone[i] * scale
        if factor != 0.0:
            for j in range(gone.size):
                precision[i, j] -= factor * gone[j]
    precision[k, :] = 0.0
    precision[:, k] = 0.0


@compiled
def agree(nu: Array, precision: Array, kept: NDArray[np.bool_], gate: float) -> None:
    """`agreeing` among those that are kept (N,), in place; the precision becomes that of those that stay."""
    for _ in range(nu.size):
        worst, most = -1, gate
        for i in range(nu.size):
            if kept[i]:
                # S^-1 nu / sqrt(diag S^-1) is each innovation minus what the others foretell, in its own sigma.
                total = 0.0
                for j in range(nu.size):
                    total += precision[i, j] * nu[j]
                odd = abs(total) / np.sqrt(precision[i, i])
                if not odd <= most:
                    worst, most = i, odd
        if worst < 0:
            return
        kept[worst] = False
        without(precision, worst)


@compiled
def agreeing(innovation: Array, precision: Array, gate: float) -> Index:
    """Which innovations agree with each other: the worst, given all others, goes until none is beyond the gate.

    innovation  (N,)    rad, nu
    precision   (N, N)  S^-1
    gate                sigmas
    returns     (K,)    indices, rising
    """
    kept = np.ones(innovation.size, dtype=np.bool_)
    agree(innovation, precision.copy(), kept, gate)
    return np.flatnonzero(kept)


@compiled
def entered(covariance: Array, by_first: Array, by_mount: Array, by_beta: Array, first_std: float, std: Array) -> Array:
    """The covariance with new lines between the known ones and the mount, each correlated with all that is known.

    covariance  (M, M)  before
    by_first    (N,)    slope of a new line's theta by the first of it
    by_mount    (N, 3)  by phi, rho, psi
    by_beta     (N,)    by the bearing that it was seen at
    first_std           of the first, which nothing is known about
    std         (N,)    rad, of that bearing
    returns     (M + 2 N, M + 2 N)
    """
    size, count = covariance.shape[0], by_first.size
    mount, new_size = size - 3, size + 2 * count
    out = np.zeros((new_size, new_size))
    place = np.arange(size)  # of what was there before
    place[mount:] += 2 * count
    for i in range(size):
        for j in range(size):
            out[place[i], place[j]] = covariance[i, j]
    across = np.zeros((count, new_size))  # theta of a new line with everything
    for n in range(count):
        for k in range(3):
            for j in range(size):
                across[n, place[j]] += by_mount[n, k] * covariance[mount + k, j]
    for n in range(count):
        for m in range(count):
            total = 0.0
            for k in range(3):
                total += across[n, new_size - 3 + k] * by_mount[m, k]
            across[n, mount + 2 * m + 1] = total
    for n in range(count):
        theta = mount + 2 * n + 1
        out[theta, :] = across[n]
        out[:, theta] = across[n]
    for n in range(count):
        first, theta = mount + 2 * n, mount + 2 * n + 1
        out[first, first] = first_std**2
        out[first, theta] = by_first[n] * first_std**2
        out[theta, first] = by_first[n] * first_std**2
        out[theta, theta] += (by_first[n] * first_std) ** 2 + (by_beta[n] * std[n]) ** 2
    return out
