"""Lines and tracks -> which belong together, by least total cost: descriptor, bearing, and how a line looks."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from omnivert.angles import TURN
from omnivert.compiled import compiled

Float = NDArray[np.float64]
Int = NDArray[np.int64]

KNOWN_STD_RAD = np.deg2rad(0.2)  # how well a line's next bearing is known when its own motion is
NEW_COST = 14.0  # a pair that costs more is less believable than a new line
_GATE_RAD = np.deg2rad(8.0)
_ENDS_STD = 0.1  # of a line's length: how well its ends are seen again
_STRENGTH_STD = 0.1
_TAIL = 10.0  # degrees of freedom of Student's t


@compiled
def costs(
    D: Float,
    angle: Float,
    polarity: Int,
    shape: Float,
    predicted: Float,
    std: Float,
    track_polarity: Int,
    track_shape: Float,
    far: float,
    descriptor_std: float,
) -> Float:
    """-2 log likelihood of pairs, less that of a sure one (N, T): descriptor, bearing, and where lines begin and end.

    predicted, std  (T,)  rad
    far                   descriptors farther apart are no pair
    Infinite where a pair cannot be.
    """
    cost = np.full(D.shape, np.inf)
    for i in range(D.shape[0]):
        for j in range(D.shape[1]):
            if polarity[i] != track_polarity[j] or D[i, j] >= far:
                continue
            surprise = abs(angle[i] - predicted[j])
            surprise = min(surprise, TURN - surprise)
            if surprise >= _GATE_RAD:
                continue
            value = (D[i, j] / descriptor_std) ** 2
            value += _TAIL * np.log1p((surprise / std[j]) ** 2 / _TAIL) + 2.0 * np.log(max(std[j] / KNOWN_STD_RAD, 1.0))
            length = max(shape[i, 2] - shape[i, 1], track_shape[j, 2] - track_shape[j, 1], 1.0) * _ENDS_STD
            for end in range(1, 3):
                value += np.log1p(((shape[i, end] - track_shape[j, end]) / length) ** 2)
            value += np.log1p(((shape[i, 0] - track_shape[j, 0]) / _STRENGTH_STD) ** 2)
            if value < NEW_COST:
                cost[i, j] = value
    return cost


@compiled
def mutual_best(cost: Float) -> tuple[Int, Int]:
    """Rows and columns of the pairs that are each other's best; the first of equals."""
    rows, columns = cost.shape
    best_row, least = np.zeros(columns, dtype=np.int64), np.full(columns, np.inf)
    best_column = np.full(rows, -1, dtype=np.int64)
    for i in range(rows):
        lowest = np.inf
        for j in range(columns):
            if cost[i, j] < lowest:
                lowest, best_column[i] = cost[i, j], j
            if cost[i, j] < least[j]:
                least[j], best_row[j] = cost[i, j], i
    pair = np.empty((2, columns), dtype=np.int64)
    count = 0
    for j in range(columns):
        if least[j] < np.inf and best_column[best_row[j]] == j:
            pair[0, count], pair[1, count] = best_row[j], j
            count += 1
    return pair[0, :count], pair[1, :count]


def assigned(cost: Float, new_cost: float = NEW_COST) -> Int:
    """The column of each row, or -1, by least total cost; a row left alone costs `new_cost`; (N,).

    cost  (N, M)  pairs of `new_cost` and above are none
    """
    match, left_rows, left_columns = _unrivalled(cost, new_cost)
    rows, columns = np.flatnonzero(left_rows), np.flatnonzero(left_columns)
    if rows.size == 0:
        return match
    part = cost[np.ix_(rows, columns)]
    part[part >= new_cost] = np.inf
    alone = np.full((rows.size, rows.size), np.inf)
    np.fill_diagonal(alone, new_cost)
    row, column = linear_sum_assignment(np.hstack((part, alone)))
    real = column < columns.size
    match[rows[row[real]]] = columns[column[real]]
    return match


@compiled
def _unrivalled(cost: Float, new_cost: float) -> tuple[Int, NDArray[np.bool_], NDArray[np.bool_]]:
    """The column of each row where neither could pair with another, or -1; and the rows and columns that are left."""
    rows, columns = np.zeros(cost.shape[0], dtype=np.int64), np.zeros(cost.shape[1], dtype=np.int64)
    for i in range(rows.size):
        for j in range(columns.size):
            if cost[i, j] < new_cost:
                rows[i] += 1
                columns[j] += 1
    match = np.full(rows.size, -1, dtype=np.int64)
    for i in range(rows.size):
        for j in range(columns.size):
            if rows[i] == 1 and columns[j] == 1 and cost[i, j] < new_cost:
                match[i] = j
                rows[i] = columns[j] = 0
    return match, rows > 0, columns > 0
