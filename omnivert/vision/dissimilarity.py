"""Rows A and B -> how unlike they are: every measure that the paper names (IV; eqs. 6, 12, 13).

The functions are the equations. Their values are of different sizes, some of them of second order in the difference;
`matching.distances` brings them to the size of the L2 distance, which F1 and the tracker know.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from omnivert.config import Dissimilarity

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]

PATCHES: frozenset[Dissimilarity] = frozenset(("ssd", "zncc"))
"""Those that compare patches of the panorama, not descriptors."""

_TILE = 2**16  # numbers of the broadcast difference at a time, half a megabyte: it stays in the cache
_SIMILAR = 1.0 / 16.0  # of a turn: orientations this far apart are similar by 1/e
_TINY = np.finfo(np.float64).tiny


def l2(A: Float32, B: Float32) -> Float:
    """L2 distances sqrt(sum (h - k)^2) by the scalar product; (N, K), (M, K) -> (N, M) (eq. 6).

    Rounding leaves some 1e-4 between equal rows; `minkowski(A, B, 2)` gives 0 there, at several times the cost.
    """
    a, b = (np.einsum("nk,nk->n", rows, rows) for rows in (A, B))
    square = a[:, None] + b[None, :] - 2.0 * (A @ B.T)
    return np.asarray(np.sqrt(np.maximum(square, 0.0)), dtype=np.float64)


def minkowski(A: Float32, B: Float32, p: float) -> Float:
    """Minkowski's form (sum |h - k|^p)^(1/p), p >= 1, or max |h - k| for p = inf; (N, K), (M, K) -> (N, M)."""
    if not p >= 1.0:
        raise ValueError(f"Minkowski's form is a distance from p = 1 on, not for p = {p:g}")
    if p == np.inf:
        return _between(A, B, "chebyshev")
    if p == 1.0:
        return _between(A, B, "cityblock")
    return _between(A, B, "euclidean") if p == 2.0 else _between(A, B, "minkowski", p=p)


def jeffrey(A: Float32, B: Float32) -> Float:
    """Jeffrey divergence sum h ln(h / m) + k ln(k / m), m = (h + k) / 2; (N, K), (M, K) >= 0 -> (N, M).

    An empty bin adds nothing of its own, as t ln t -> 0; a pair of empty bins adds nothing at all.
    """

    def kernel(h: Float, k: Float) -> Float:
        total = h + k
        return np.asarray(np.einsum("nmk,nmk->nm", total, np.log(np.maximum(0.5 * total, _TINY))))

    a, b = A.astype(np.float64), B.astype(np.float64)
    own_a, own_b = (np.einsum("nk,nk->n", x, np.log(np.maximum(x, _TINY))) for x in (a, b))
    return np.asarray(np.maximum(own_a[:, None] + own_b[None, :] - _tiled(a, b, kernel), 0.0), dtype=np.float64)


def chi_square(A: Float32, B: Float32) -> Float:
    """Chi-square statistic sum (h - m)^2 / m, m = (h + k) / 2; (N, K), (M, K) >= 0 -> (N, M).

    A pair of empty bins adds nothing.
    """

    def kernel(h: Float, k: Float) -> Float:
        return np.asarray(0.5 * np.sum((h - k) ** 2 / np.maximum(h + k, _TINY), axis=2))  # = (h - m)^2 / m

    return _tiled(A.astype(np.float64), B.astype(np.float64), kernel)


def bhattacharyya(A: Float32, B: Float32) -> Float:
    """Bhattacharyya distance sqrt(1 - sum sqrt(p q)), p = h / sum h, q = k / sum k; (N, K), (M, K) >= 0 -> (N, M).

    # Paper: names it, gives no formula. Here: this bounded form rather than -ln sum sqrt(p q), which is infinite where
    # no bin is common to both and would then spoil the mean of eq. 9.

    An empty row has 0 to another empty one and sqrt(1/2) to all others, from 1 - sum sqrt(p q) =
    sum (sqrt p - sqrt q)^2 / 2, which is also what keeps equal rows at exactly 0.
    """
    a, b = (np.sqrt(x / np.maximum(np.sum(x, axis=1, keepdims=True, dtype=np.float64), _TINY)) for x in (A, B))
    return np.asarray(np.sqrt(0.5) * _between(a, b, "euclidean"), dtype=np.float64)


def quadratic_form(A: Float32, B: Float32, bins: int) -> Float:
    """Quadratic form sqrt((h - k)^T S (h - k)); (N, K), (M, K) -> (N, M), K a multiple of `bins`.

    S = `bin_similarity` within each histogram, 0 between bins of different ones.
    """
    root = _similarity_root(bins)  # S = L L^T, so the form is the L2 norm of L^T (h - k)
    a, b = ((x.reshape(x.shape[0], x.shape[1] // bins, bins) @ root).reshape(x.shape) for x in (A, B))
    return _between(a, b, "euclidean")


def bin_similarity(bins: int) -> Float:
    """S_ij = exp(-16 d_ij / bins), d_ij = min(|i - j|, bins - |i - j|): the bins lie on a circle; (bins, bins).

    # Paper: does not give S. Here: not the usual 1 - d / max d, which is blind on a circle: there it sees nothing of
    # every second harmonic of a difference. This one is positive definite for any number of bins.
    """
    apart = np.abs(np.arange(bins)[:, None] - np.arange(bins)[None, :])
    return np.asarray(np.exp(-np.minimum(apart, bins - apart) / (_SIMILAR * bins)), dtype=np.float64)


def ssd(A: Float32, B: Float32) -> Float:
    """Sums of squared differences of patches, sum (p - q)^2; (N, K), (M, K) -> (N, M) (eq. 12)."""
    return _between(A, B, "sqeuclidean")


def zncc(A: Float32, B: Float32) -> Float:
    """1 - ZNCC of patches, 0..2: 0 for equal ones, as the paper turns it round; (N, K), (M, K) -> (N, M) (eq. 13).

    ZNCC = sum (p - <p>)(q - <q>) / sqrt(sum (p - <p>)^2 sum (q - <q>)^2). A patch without any contrast is like nothing,
    not even itself: its ZNCC is 0.
    """
    a, b = _standard(A), _standard(B)
    return np.asarray(np.clip(1.0 - a @ b.T, 0.0, 2.0), dtype=np.float64)


def dissimilarity(A: Float32, B: Float32, kind: Dissimilarity, bins: int) -> Float:
    """The values of the equation itself, (N, K), (M, K) -> (N, M).

    bins  of each histogram that a row is made of; for the quadratic form
    """
    match kind:
        case "l1":
            return minkowski(A, B, 1.0)
        case "l2":
            return l2(A, B)
        case "linf":
            return minkowski(A, B, np.inf)
        case "jeffrey":
            return jeffrey(A, B)
        case "chi-square":
            return chi_square(A, B)
        case "bhattacharyya":
            return bhattacharyya(A, B)
        case "quadratic":
            return quadratic_form(A, B, bins)
        case "ssd":
            return ssd(A, B)
        case "zncc":
            return zncc(A, B)


def _between(A: NDArray[np.floating], B: NDArray[np.floating], metric: str, **settings: float) -> Float:
    """By scipy, which reads float64 in place and holds nothing but the result."""
    return np.asarray(cdist(A.astype(np.float64), B.astype(np.float64), metric, **settings), dtype=np.float64)


def _tiled(a: Float, b: Float, kernel: Callable[[Float, Float], Float]) -> Float:
    """`kernel` of (n, 1, K) and (1, m, K) -> (n, m), over tiles of at most `_TILE` numbers or one pair of rows."""
    result = np.empty((a.shape[0], b.shape[0]))
    length = max(a.shape[1], 1)
    wide = max(min(b.shape[0], _TILE // length), 1)
    high = max(_TILE // (length * wide), 1)
    for i in range(0, a.shape[0], high):
        for j in range(0, b.shape[0], wide):
            result[i : i + high, j : j + wide] = kernel(a[i : i + high, None], b[None, j : j + wide])
    return result


def _standard(rows: Float32) -> Float:
    """Rows less their mean, at unit length; 0 where only rounding would be left."""
    x = rows.astype(np.float64)
    mean = np.mean(x, axis=1, keepdims=True)
    x -= mean
    length = np.sqrt(np.sum(x**2, axis=1, keepdims=True))
    flat = length <= 1e-6 * np.abs(mean) * np.sqrt(max(x.shape[1], 1))
    return np.where(flat, 0.0, x / np.where(flat, 1.0, length))


@lru_cache(maxsize=8)
def _similarity_root(bins: int) -> Float:
    return np.asarray(np.linalg.cholesky(bin_similarity(bins)), dtype=np.float64)
