"""Descriptors A and B -> which match: the paper's three rules (IV, eqs. 6 to 10)."""

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]


def distances(A: Float32, B: Float32) -> Float:
    """L2 distances d(A_i, B_j), (N, M) (eq. 6)."""
    product = (A @ B.T).astype(np.float64)
    a = np.sum(A.astype(np.float64) ** 2, axis=1)
    b = np.sum(B.astype(np.float64) ** 2, axis=1)
    return np.asarray(np.sqrt(np.maximum(a[:, None] + b[None, :] - 2.0 * product, 0.0)), dtype=np.float64)


def matches(D: Float, f1: float, f2: float, f3: float) -> Int:
    """For each A_i the j of its match, or -1; (N,).

    D  (N, M)  distances of A_i from B_j

    <D> averages all distances of A_i, the least one included: as eq. 9 is printed, not as its text says. With one B
    there is no second smallest and no mean of others; eqs. 9 and 10 then have nothing to say and eq. 8 decides.
    Where two A take the same B, the nearer one keeps it (the first, when equal).
    """
    n, m = D.shape
    match = np.full(n, -1, dtype=np.int64)
    if n == 0 or m == 0:
        return match
    j = np.argmin(D, axis=1)
    least = D[np.arange(n), j]
    good = least < f1  # eq. 8
    if m > 1:
        good &= least < f2 * np.mean(D, axis=1)  # eq. 9
        good &= least < f3 * np.partition(D, 1, axis=1)[:, 1]  # eq. 10
    taken = np.zeros(m, dtype=np.bool_)
    for i in np.flatnonzero(good)[np.argsort(least[good], kind="stable")]:
        if not taken[j[i]]:
            taken[j[i]], match[i] = True, j[i]
    return match
