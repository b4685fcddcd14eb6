"""Symmetric positive definite systems whose rows begin late: Cholesky inside the rows' own spans.

Poses and lines in the order of time, each line behind the last pose that sees it, give such a matrix: a pose's row
begins at the pose before it, a line's at the first pose that sees it, and elimination fills nothing outside. Row i
holds its entries first[i]..i at values[start[i]..start[i + 1]].
"""

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def starts(first: Index) -> Index:
    """Where each row begins, (N + 1,); `first` (N,) is the column of each row's first entry."""
    return np.concatenate([[0], np.cumsum(np.arange(first.size) - first + 1)]).astype(np.int64)


@compiled
def factored(first: Index, start: Index, values: Array) -> bool:
    """Cholesky in place: values become those of L with L L' = the matrix. False when it is not positive definite."""
    for i in range(first.size):
        row, begin = start[i], first[i]
        for j in range(begin, i):
            other, low = start[j], first[j]
            k = max(begin, low)
            left, right, count = row + k - begin, other + k - low, j - k
            # Four sums side by side: one alone would wait for each addition.
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            whole = count - count % 4
            for m in range(0, whole, 4):
                a += values[left + m] * values[right + m]
                b += values[left + m + 1] * values[right + m + 1]
                c += values[left + m + 2] * values[right + m + 2]
                d += values[left + m + 3] * values[right + m + 3]
            for m in range(whole, count):
                a += values[left + m] * values[right + m]
            values[row + j - begin] = (values[row + j - begin] - (a + b + c + d)) / values[start[j + 1] - 1]
        pivot = values[row + i - begin]
        for k in range(row, row + i - begin):
            pivot -= values[k] * values[k]
        if not pivot > 0.0:
            return False
        values[row + i - begin] = np.sqrt(pivot)
    return True


@compiled
def solved(first: Index, start: Index, lower: Array, right: Array) -> Array:
    """x (N,) with L L' x = right."""
    x = right.copy()
    for i in range(x.size):
        row, begin = start[i], first[i]
        rest = x[i]
        for k in range(begin, i):
            rest -= lower[row + k - begin] * x[k]
        x[i] = rest / lower[start[i + 1] - 1]
    for i in range(x.size - 1, -1, -1):
        row, begin = start[i], first[i]
        x[i] /= lower[start[i + 1] - 1]
        for k in range(begin, i):
            x[k] -= lower[row + k - begin] * x[i]
    return x


@compiled
def inverse(first: Index, start: Index, lower: Array) -> Array:
    """The inverse's entries inside the spans (Takahashi's recursion), stored as the matrix is."""
    size = first.size
    found = np.zeros(lower.size)
    members = np.empty(size, dtype=np.int64)
    for j in range(size - 1, -1, -1):
        pivot = lower[start[j + 1] - 1]
        count = 0
        for i in range(j + 1, size):
            if first[i] <= j:
                members[count] = i
                count += 1
        for m in range(count - 1, -1, -1):
            i = members[m]
            rest = 0.0
            for n in range(count):
                k = members[n]
                high, low = (i, k) if i >= k else (k, i)
                rest += found[start[high] + low - first[high]] * lower[start[k] + j - first[k]]
            found[start[i] + j - first[i]] = -rest / pivot
        own = 1.0 / pivot
        for n in range(count):
            k = members[n]
            own -= found[start[k] + j - first[k]] * lower[start[k] + j - first[k]]
        found[start[j + 1] - 1] = own / pivot
    return found


@compiled
def corner(first: Index, start: Index, values: Array, begin: int) -> Array:
    """Rows and columns from `begin` on as a full lower triangle; of a factor: that of the Schur complement."""
    size = first.size - begin
    block = np.zeros((size, size))
    for i in range(size):
        row = begin + i
        for j in range(max(first[row], begin), row + 1):
            block[i, j - begin] = values[start[row] + j - first[row]]
    return block
