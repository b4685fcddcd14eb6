"""The vertical edges in a picture, exactly: which of them are seen, how much of each, and how strongly."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.simulation.columns import FULL, THIN, Columns
from omnivert.simulation.panorama import Panorama
from omnivert.simulation.surfaces import Surfaces

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BESIDE_RAD = 1.0 / 150.0  # an edge's two sides are judged over so much: a pixel of the ring


class Sensor(NamedTuple):
    """What makes light grey, and the ring's rows in the panorama."""

    gain: float
    response: float
    first_row: int
    rows: int


class SeenEdges(NamedTuple):
    """N edges, by line id.

    line              (N,)
    azimuth           (N,)  rad, -pi to pi, of the camera
    distance          (N,)  m, level
    visible_fraction  (N,)  of the ring's radial extent
    contrast          (N,)  mean grey step where it is visible
    """

    line: Ints
    azimuth: Array
    distance: Array
    visible_fraction: Array
    contrast: Array


def seen_edges(columns: Columns, seen: Panorama, things: Surfaces, sensor: Sensor) -> SeenEdges:
    """Every vertical edge of which some row of the ring shows something."""
    ids, index = np.unique(things.line, return_inverse=True)
    azimuth, distance, rows, steps = _edges(columns, seen, things, sensor, index.reshape(-1, 2), ids.size)
    count = rows.sum(axis=1)
    found = np.flatnonzero(count)
    return SeenEdges(
        ids[found], azimuth[found], distance[found], count[found] / sensor.rows, steps[found] / count[found]
    )


@compiled
def _edges(
    columns: Columns, seen: Panorama, things: Surfaces, sensor: Sensor, index: Ints, many: int
) -> tuple[Array, Array, NDArray[np.bool_], Array]:
    """Of each line: azimuth, distance, the rows that show it, and the grey steps of these together.

    index  (P, 2)  which of the lines stands at each end of a surface
    """
    azimuth, distance, steps = np.zeros(many), np.zeros(many), np.zeros(many)
    shown = np.zeros((many, sensor.rows), dtype=np.bool_)
    total = columns.held.size
    for p in range(index.shape[0]):
        for side in range(2):
            bound = columns.end[p, side]
            if bound < 0:
                continue
            line = index[p, side]
            left = (bound - 1) % total
            while columns.bounds[left + 1] - columns.bounds[left] <= THIN:
                left = (left - 1) % total
            right = bound % total
            while columns.bounds[right + 1] - columns.bounds[right] <= THIN:
                right = (right + 1) % total
            azimuth[line] = columns.bounds[bound]
            distance[line] = _distance(columns, p, left, right)
            for i in range(sensor.rows):
                row = sensor.first_row + i
                a, b = seen.surface[left, row], seen.surface[right, row]
                if a != b and (a == p or b == p) and not shown[line, i]:
                    shown[line, i] = True
                    steps[line] += abs(
                        _grey(columns, seen, sensor, azimuth[line], row)
                        - _grey(columns, seen, sensor, azimuth[line] - BESIDE_RAD, row)
                    )
    return azimuth, distance, shown, steps


@compiled
def _distance(columns: Columns, p: int, left: int, right: int) -> float:
    """Of a surface beside one of two columns; 0 when neither of them holds it"""
    for c in (left, right):
        for k in range(columns.held[c]):
            if columns.surface[c, k] == p:
                return float(columns.distance[c, k])
    return 0.0


@compiled
def _grey(columns: Columns, seen: Panorama, sensor: Sensor, low: float, row: int) -> float:
    """Mean grey of a row over `BESIDE_RAD` from an azimuth on"""
    high = low + BESIDE_RAD
    light = _upto(columns, seen, high, row) - _upto(columns, seen, low, row)
    return float(255.0 * min(sensor.gain * light / BESIDE_RAD, 1.0) ** sensor.response)


@compiled
def _upto(columns: Columns, seen: Panorama, azimuth: float, row: int) -> float:
    """Integral of a row's light from -pi on, also beyond the full circle."""
    total = columns.held.size
    around, turned = azimuth, 0.0
    if azimuth < -np.pi:
        around, turned = azimuth + FULL, -seen.summed[total, row]
    elif azimuth >= np.pi:
        around, turned = azimuth - FULL, seen.summed[total, row]
    c = min(max(int(np.searchsorted(columns.bounds, around, side="right")) - 1, 0), total - 1)
    return float(turned + seen.summed[c, row] + (around - columns.bounds[c]) * seen.light[c, row])
