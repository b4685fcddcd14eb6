"""Bearings on the circle: how far apart, in which clusters, how much of the circle they cover."""

import numpy as np

from omnivert.angles import TURN, wrap
from omnivert.bench.score.truth import Float, Int


def apart(a: Float, b: Float) -> Float:
    """Distances, the short way round, (N, M) rad."""
    return np.abs(wrap(a[:, None] - b[None, :]))


def nearest(a: Float, b: Float) -> Float:
    """Distance of each a from the nearest b, (N,) rad; infinite without any b."""
    return np.asarray(np.min(apart(a, b), axis=1, initial=np.inf))


def clusters(bearing: Float, width: float) -> Int:
    """Which cluster each bearing lies in, counted from 0, (N,).

    Going round from the widest gap, a cluster is its first bearing and all within `width` of it: never wider, and the
    same however the circle is turned.
    """
    if bearing.size == 0:
        return np.empty(0, dtype=np.int64)
    order = np.argsort(np.mod(bearing, TURN), kind="stable")
    around = np.mod(bearing, TURN)[order]
    gap = np.diff(around, prepend=around[-1] - TURN)
    start = int(np.argmax(gap))
    order = np.roll(order, -start)
    along = np.mod(np.roll(around, -start) - around[start], TURN)
    label = np.empty(bearing.size, dtype=np.int64)
    first, count = along[0], 0
    for index, place in zip(order, along, strict=True):
        if place - first > width:
            first, count = place, count + 1
        label[index] = count
    return label


def covered(bearing: Float, tolerance: float) -> float:
    """Share of the circle that lies within the tolerance of a bearing."""
    if bearing.size == 0:
        return 0.0
    around = np.sort(np.mod(bearing, TURN))
    gap = np.diff(around, append=around[0] + TURN)
    return float(np.sum(np.minimum(gap, 2.0 * tolerance)) / TURN)
