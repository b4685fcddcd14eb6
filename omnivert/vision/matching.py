"""Rows A and B -> how far apart, and which match: the paper's three rules (IV, eqs. 6 to 10)."""

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Dissimilarity
from omnivert.vision.dissimilarity import dissimilarity

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]

# The median of one line in two consecutive frames of the corridor: 2659 pairs of lines without a neighbour within
# 1.2 deg, 3 x 2 x 32 bins. Behind it: the 95 % of them, the 1 % of two different lines of one polarity.
_SAME_LINE: dict[Dissimilarity, float] = {
    "l2": 0.335,  # 0.52, 1.01
    "l1": 2.22,  # 3.75, 7.90
    "linf": 0.142,  # 0.25, 0.24
    "jeffrey": 0.406,  # 0.89, 3.38
    "chi-square": 0.363,  # 0.77, 2.72
    "bhattacharyya": 0.128,  # 0.191, 0.374
    "quadratic": 0.346,  # 0.58, 1.44
    "ssd": 11.5,  # 39, 188; square grey steps a cell, as the sum grows with their number
    "zncc": 0.0108,  # 0.045, 0.269
}
_SECOND_ORDER: frozenset[Dissimilarity] = frozenset(("jeffrey", "chi-square", "ssd", "zncc"))


def distances(A: Float32, B: Float32, kind: Dissimilarity = "l2", bins: int = 32) -> Float:
    """Distances d(A_i, B_j) at the size of the L2 distance, (N, K), (M, K) -> (N, M) (eq. 6).

    kind  "l2": the paper's distance as it is; any other: the dissimilarity, or the square root of one that is of second
          order in the difference, times what makes it 0.335, the median of l2, for the median line in two frames
    bins  of each histogram that a row is made of

    So F1 cuts at about the same share of equal lines for all of them, and F2 and F3 compare lengths, never squares.
    """
    D = dissimilarity(A, B, kind, bins)
    if kind == "l2":
        return D
    same = _SAME_LINE[kind] * (max(A.shape[1], 1) if kind == "ssd" else 1)
    D = D / same
    return _SAME_LINE["l2"] * (np.sqrt(D) if kind in _SECOND_ORDER else D)


def matches(D: Float, f1: float, f2: float, f3: float, *, mutual: bool = False) -> Int:
    """For each A_i the j of its match, or -1; (N,).

    D       (N, M)  distances of A_i from B_j
    mutual  a match also needs A_i to be the nearest of all A to B_j

    <D> averages all distances of A_i, the least one included: as eq. 9 is printed, not as its text says. With one B
    there is no second smallest and no mean of others; eqs. 9 and 10 then have nothing to say and eq. 8 decides.
    Where two A take the same B, the nearer one keeps it (the first, when equal).

    # Paper: no mutual rule. Here: on request. It differs from "the nearer one keeps it" where the nearer A_i fails a
    # rule or has a still nearer B: then the farther one goes without a match, too.
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
    if mutual:
        good &= np.argmin(D, axis=0)[j] == np.arange(n)
    taken = np.zeros(m, dtype=np.bool_)
    for i in np.flatnonzero(good)[np.argsort(least[good], kind="stable")]:
        if not taken[j[i]]:
            taken[j[i]], match[i] = True, j[i]
    return match
