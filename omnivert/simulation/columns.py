"""The world around a camera in columns of azimuth, cut exactly at every vertical edge, and what stands in each column.

A column lies wholly on a surface or wholly beside it, so that a pixel which looks at an edge gets exactly its share of
both sides: nothing is sampled across an edge.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GRID = 1536  # columns of a bare circle: as many as the rim has pixels
LAYERS = 24  # surfaces behind one another; beyond them the farthest are left out
FULL = 2.0 * np.pi
THIN = 1e-12  # rad; a column of no width, between two edges at one place


class Columns(NamedTuple):
    """C columns around a camera.

    bounds    (C+1,)       rad, -pi to pi, rising; column c lies between bounds c and c + 1
    first     (GRID+1,)    the column at which each cell of the bare grid begins
    span      (P, 2)       rad, azimuth of each surface's clockwise end, and of the other one, which is not smaller
    end       (P, 2)       bound at each end of a surface, in the order of its line ids; -1: not in view
    held      (C,)         surfaces in the column
    surface   (C, LAYERS)  which, the nearest first
    distance  (C, LAYERS)  m, level
    along     (C, LAYERS)  m, from the surface's start; of a round one the cosine between its normal and the view
    """

    bounds: Array
    first: Ints
    span: Array
    end: Ints
    held: Ints
    surface: Ints
    distance: Array
    along: Array


@compiled
def columns(place: Array, flat: int, x: float, y: float, heading: float) -> Columns:
    """Everything upright as seen from a place.

    place    (P, 4)  m  see `Surfaces`
    x, y             m  the camera
    heading          rad  of its x axis in the world
    """
    many = place.shape[0]
    span, ends = _spans(place, flat, x, y, heading)
    bounds = np.empty(GRID + 1 + 2 * many)
    for k in range(GRID + 1):
        bounds[k] = -np.pi + FULL * k / GRID
    used = GRID + 1
    for p in range(many):
        if span[p, 1] > span[p, 0]:
            for side in range(2):
                bounds[used] = ends[p, side]
                used += 1
    bounds = np.sort(bounds[:used])
    first = np.empty(GRID + 1, dtype=np.int64)
    c = 0
    for k in range(GRID + 1):
        grid = -np.pi + FULL * k / GRID
        while bounds[c] < grid:
            c += 1
        first[k] = c
    total = used - 1
    count = np.zeros(total, dtype=np.int64)
    surface = np.empty((total, LAYERS), dtype=np.int64)
    distance = np.empty((total, LAYERS))
    along = np.empty((total, LAYERS))
    end = np.full((many, 2), -1, dtype=np.int64)
    for p in range(many):
        if span[p, 1] <= span[p, 0]:
            continue
        for side in range(2):
            end[p, side] = np.searchsorted(bounds, ends[p, side])
        c = np.searchsorted(bounds, span[p, 0])
        around = 0.0
        while bounds[c] + around < span[p, 1]:
            if bounds[c + 1] - bounds[c] > THIN:
                azimuth = 0.5 * (bounds[c] + bounds[c + 1])
                _hit(place, flat, p, x, y, heading, azimuth, c, count, surface, distance, along)
            c += 1
            if c == total:
                c, around = 0, FULL
    return Columns(bounds, first, span, end, count, surface, distance, along)


@compiled
def wrapped(angle: float) -> float:
    """The same direction, -pi to pi, pi itself excluded."""
    turned = (angle + np.pi) % FULL - np.pi
    return turned if turned < np.pi else -np.pi


@compiled
def _spans(place: Array, flat: int, x: float, y: float, heading: float) -> tuple[Array, Array]:
    """Where each surface begins and ends, and the azimuth of each of its ends; a span is empty when it is not seen."""
    many = place.shape[0]
    span, ends = np.zeros((many, 2)), np.zeros((many, 2))
    for p in range(many):
        ax, ay = place[p, 0] - x, place[p, 1] - y
        if p < flat:
            bx, by = place[p, 2] - x, place[p, 3] - y
            ends[p, 0] = wrapped(np.arctan2(ay, ax) - heading)
            ends[p, 1] = wrapped(np.arctan2(by, bx) - heading)
            cross = ax * by - ay * bx
            low = ends[p, 0] if cross > 0.0 else ends[p, 1]
            high = ends[p, 1] if cross > 0.0 else ends[p, 0]
            if abs(cross) < 1e-9:  # seen from its edge
                continue
        else:
            away = np.hypot(ax, ay)
            if away <= 1.001 * place[p, 2]:  # from inside nothing is seen of it
                continue
            middle, half = np.arctan2(ay, ax) - heading, np.arcsin(place[p, 2] / away)
            low = ends[p, 0] = wrapped(middle - half)
            high = ends[p, 1] = wrapped(middle + half)
        span[p, 0], span[p, 1] = low, high if high >= low else high + FULL
    return span, ends


@compiled
def _hit(
    place: Array,
    flat: int,
    p: int,
    x: float,
    y: float,
    heading: float,
    azimuth: float,
    c: int,
    count: Ints,
    surface: Ints,
    distance: Array,
    along: Array,
) -> None:
    """Puts a surface among those of a column, by its distance in the column's middle."""
    dx, dy = np.cos(azimuth + heading), np.sin(azimuth + heading)
    ax, ay = place[p, 0] - x, place[p, 1] - y
    if p < flat:
        ex, ey = place[p, 2] - place[p, 0], place[p, 3] - place[p, 1]
        slope = dx * ey - dy * ex
        if abs(slope) < 1e-12:
            return
        far = (ax * ey - ay * ex) / slope
        where = (ax * dy - ay * dx) / slope * np.hypot(ex, ey)
    else:
        radius = place[p, 2]
        near = ax * dx + ay * dy
        inside = radius * radius - (ax * ax + ay * ay - near * near)
        depth = np.sqrt(max(inside, 0.0))
        far, where = near - depth, depth / radius
    if far <= 0.0:
        return
    k = min(count[c], LAYERS - 1)
    if count[c] == LAYERS and distance[c, k] <= far:
        return
    while k > 0 and distance[c, k - 1] > far:
        surface[c, k], distance[c, k], along[c, k] = surface[c, k - 1], distance[c, k - 1], along[c, k - 1]
        k -= 1
    surface[c, k], distance[c, k], along[c, k] = p, far, where
    count[c] = min(count[c] + 1, LAYERS)


@compiled
def nearest(columns: Columns, heights: Array, azimuth: Array, height: float) -> Array:
    """Level distance (m) to what stands at a height in each direction; 0 where nothing does.

    heights  (P, 2)  m  low and high of the surfaces
    azimuth  (N,)    rad, -pi to pi
    """
    found = np.zeros(azimuth.size)
    for n in range(azimuth.size):
        c = np.searchsorted(columns.bounds, azimuth[n], side="right") - 1
        c = min(max(c, 0), columns.held.size - 1)
        for k in range(columns.held[c]):
            p = columns.surface[c, k]
            if heights[p, 0] <= height <= heights[p, 1]:
                found[n] = columns.distance[c, k]
                break
    return found
