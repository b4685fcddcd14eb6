"""Votes, and which line each is for -> every line's bearing, sigma, lean and ends (beyond II)."""

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.vision.turns import cell_of, short_way

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_LEAST_SPREAD = 0.02  # px^2; no line's points are better
_STRETCH_PX, _STRETCHES = 4.0, 512
_WIDTHS_PX = np.array((4.0, 2.5, 1.5, 1.0))  # points farther off a line have no say; step after step of the fit
_ON_LINE_PX = 1.5  # this far off a point still counts for its line's length
_CORRELATED_PX = 4.0  # neighbouring points of an edge share their error over about this many


@compiled
def fitted(
    theta: Float,
    radius: Float,
    polarity: Int,
    extent: Float,
    owner: Int,
    start: Float,
    horizon: float,
) -> Float:
    """Every line by robust least squares on its points' distances from it.

    owner  (2, sectors)  line of each sector of rising and of falling edges, or -1
    start  (N,)  rad
    returns  (8, N): angle, sigma, length px, inner and outer radius, lean and its sigma px, lever
    """
    lines, sectors = start.size, owner.shape[1]
    # Points line by line, so that a line's sums stay in registers.
    line, first = np.empty(theta.size, dtype=np.int64), np.zeros(lines + 2, dtype=np.int64)
    for k in range(theta.size):
        line[k] = owner[0 if polarity[k] > 0 else 1, cell_of(theta[k], sectors)]
        first[line[k] + 2] += 1  # those of no line come first
    for i in range(lines + 1):
        first[i + 1] += first[i]
    point, place = np.empty((3, theta.size)), first.copy()
    for k in range(theta.size):
        at = place[line[k] + 1]
        place[line[k] + 1] += 1
        point[0, at], point[1, at], point[2, at] = theta[k], radius[k], extent[k]
    fit = np.zeros((8, lines))
    for i in range(lines):
        low, high = first[i + 1], first[i + 2]
        one = _fit(point[0, low:high], point[1, low:high], point[2, low:high], start[i], horizon)
        for k in range(8):
            fit[k, i] = one[k] * np.sqrt(_CORRELATED_PX) if k == 1 or k == 6 else one[k]
    return fit


@compiled
def _fit(theta: Float, r: Float, extent: Float, start: float, horizon: float) -> Float:
    """One line, see `fitted`, as if its points' errors had nothing in common."""
    off, g, fit = np.empty(r.size), np.empty(r.size), np.zeros(8)
    for k in range(r.size):
        off[k] = r[k] * short_way(theta[k] - start)
        g[k] = 1.0 - r[k] / horizon
    turned = before = 0.0
    for width in _WIDTHS_PX:
        weights = r_r = r_e = e_e = g_r = g_g = g_e = 0.0
        sharpness = 1.0 / width
        for k in range(r.size):
            e = off[k] - r[k] * turned
            near = max(1.0 - (e * sharpness) ** 2, 0.0)
            w = near * near * extent[k]
            weights += w
            r_r += w * r[k] * r[k]
            r_e += w * r[k] * e
            e_e += w * e * e
            g_r += w * g[k] * r[k]
            g_g += w * g[k] * g[k]
            g_e += w * g[k] * e
        square = max(r_r, 1.0)
        turn = r_e / square
        variance = max(e_e / max(weights, 1e-9), _LEAST_SPREAD)
        rest = g_g - g_r * g_r / square  # of g, once the angle has taken its part
        lean, lean_std = ((g_e - g_r * turn) / rest, np.sqrt(variance / rest)) if rest > 1e-9 else (0.0, np.inf)
        before, turned = turned, turned + turn
        fit[0], fit[1] = start + turned, np.sqrt(variance / square)
        fit[5], fit[6], fit[7] = lean, lean_std, g_r / square
    support = np.zeros(_STRETCHES)
    for k in range(r.size):
        if abs(off[k] - r[k] * before) <= _ON_LINE_PX:
            fit[2] += extent[k]
            support[min(int(r[k] / _STRETCH_PX), _STRETCHES - 1)] += extent[k]
    fit[3], fit[4] = _ends(support)
    return fit


@compiled
def _ends(support: Float) -> tuple[float, float]:
    """Where a line begins and ends, px: as an evenly supported one would whose quartiles of support these are.

    support  (S,)  px of edge in each stretch of the radius
    The first and the last point are no ends: other edges happen to lie on a line's continuation. But beyond them, where
    that of the quartiles would lie of a line with a gap, there is none either.
    """
    total, sum_, at, first, last = 0.0, 0.0, np.zeros(3), support.size, 0
    for k in range(support.size):
        total += support[k]
        if support[k] > 0.0:
            first, last = min(first, k), k + 1
    i = 0
    for k in range(support.size):
        while i < 3 and sum_ + support[k] > 0.25 * (i + 1) * total:
            at[i] = (k + (0.25 * (i + 1) * total - sum_) / support[k]) * _STRETCH_PX
            i += 1
        sum_ += support[k]
    inner, outer = max(2.0 * at[0] - at[1], first * _STRETCH_PX), min(2.0 * at[2] - at[1], last * _STRETCH_PX)
    return (inner, outer) if total > 0.0 else (0.0, 0.0)
