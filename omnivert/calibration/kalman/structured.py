"""Matrices that know where they are zero, for formulas that were written for dense ones.

filterpy predicts by `dot(F, P).dot(F.T) + Q`, and corrects by `dot(P, H.T)`, `dot(H, PHT) + R` and Joseph's
`dot(I - dot(K, H), P).dot((I - dot(K, H)).T) + dot(K, R).dot(K.T)`. Of 100 lines F holds 400 numbers in 40 000, H 5 in
each row of 203, R only its diagonal. NumPy hands `dot` to an operand that is no array, so the formulas and their order
stay filterpy's, and what they spend on zeros goes: three quarters of all products at 100 lines.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Operand:
    """A matrix that `numpy.dot` asks how it is multiplied; arrays leave sums with it to its own operators."""

    __slots__ = ()
    __array_ufunc__ = None

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function is not np.dot or kwargs:
            return NotImplemented
        left, right = args
        return left.left_of(right) if isinstance(left, Operand) else right.right_of(left)

    @property
    def T(self) -> "Transposed":  # noqa: N802  # as of arrays
        return Transposed(self)

    def left_of(self, other: Any) -> Any:
        """self other"""
        raise TypeError(f"{type(self).__name__} is not used on the left")

    def right_of(self, other: Any) -> Any:
        """other self"""
        raise TypeError(f"{type(self).__name__} is not used on the right")


class Transposed(Operand):
    """The transpose of an operand."""

    __slots__ = ("of",)

    def __init__(self, of: Operand) -> None:
        self.of = of

    def right_of(self, other: Array) -> Array:
        assert isinstance(self.of, Slopes)
        return self.of.seen_from(other)


class Carried:
    """A P, until it is multiplied by A'."""

    __slots__ = ("by", "covariance")

    def __init__(self, by: "Moved | Kept", covariance: Array) -> None:
        self.by = by
        self.covariance = covariance

    def dot(self, other: Transposed) -> Array:
        """A P A'"""
        assert other.of is self.by
        return self.by.carried(self.covariance)


class Moved(Operand):
    """F: the slope of the moved state by the state, each line's two by themselves; the mount stays."""

    __slots__ = ("blocks",)

    def __init__(self, blocks: Array) -> None:
        """blocks (Z, 2, 2)"""
        self.blocks = blocks

    def left_of(self, other: Array) -> Carried:
        return Carried(self, other)

    def moved(self, columns: Array) -> Array:
        """F times columns (M, C)."""
        return carried_columns(self.blocks, np.ascontiguousarray(columns))

    def carried(self, covariance: Array) -> Array:
        return carried(self.blocks, covariance)


class Slopes(Operand):
    """H: the slope of some lines' bearings by the state, each by its line's own two and by phi, rho, psi."""

    __slots__ = ("lines", "slopes")

    def __init__(self, slopes: Array, lines: Index) -> None:
        """slopes (N, 5); lines (N,) which line of the state each one is"""
        self.slopes = slopes
        self.lines = lines

    def left_of(self, other: Array) -> Array:
        return seen(self.slopes, self.lines, np.ascontiguousarray(other))

    def right_of(self, other: Array) -> "Gained":
        return Gained(other, self)

    def seen_from(self, other: Array) -> Array:
        """other H'"""
        return seen_from(other, self.slopes, self.lines)


class Gained(Operand):
    """K H, until it is taken from the identity."""

    __slots__ = ("gain", "slopes")

    def __init__(self, gain: Array, slopes: Slopes) -> None:
        self.gain = gain
        self.slopes = slopes

    def __rsub__(self, identity: Array) -> "Kept":
        return Kept(self)


class Kept(Operand):
    """I - K H: what an update leaves of the state's error."""

    __slots__ = ("gone",)

    def __init__(self, gone: Gained) -> None:
        self.gone = gone

    def left_of(self, other: Array) -> Carried:
        return Carried(self, other)

    def carried(self, covariance: Array) -> Array:
        """(I - K H) P (I - K H)', factor by factor."""
        gain, slopes = self.gone.gain, self.gone.slopes
        half = covariance - gain @ slopes.left_of(covariance)
        half -= slopes.seen_from(half) @ gain.T
        return half


class Spread(Operand):
    """R: bearings err each by themselves."""

    __slots__ = ("variance",)

    def __init__(self, variance: Array) -> None:
        """variance (N,) rad^2"""
        self.variance = variance

    def __radd__(self, other: Array) -> Array:
        total = other.copy()
        total.ravel()[:: self.variance.size + 1] += self.variance
        return total

    def right_of(self, other: Array) -> Array:
        return other * self.variance


@compiled
def carried_columns(blocks: Array, columns: Array) -> Array:
    """F times columns (M, C)."""
    out = columns.copy()
    for line in range(blocks.shape[0]):
        i = 2 * line
        for c in range(columns.shape[1]):
            out[i, c] = blocks[line, 0, 0] * columns[i, c] + blocks[line, 0, 1] * columns[i + 1, c]
            out[i + 1, c] = blocks[line, 1, 0] * columns[i, c] + blocks[line, 1, 1] * columns[i + 1, c]
    return out


@compiled
def carried(blocks: Array, covariance: Array) -> Array:
    """F P F' (M, M) of a symmetric P; symmetric to the last digit."""
    size, lines = covariance.shape[0], blocks.shape[0]
    out = np.empty((size, size))
    for a in range(lines):
        i = 2 * a
        f00, f01, f10, f11 = blocks[a, 0, 0], blocks[a, 0, 1], blocks[a, 1, 0], blocks[a, 1, 1]
        for b in range(a + 1):
            j = 2 * b
            # Rows of the one line, then columns of the other.
            p00 = f00 * covariance[i, j] + f01 * covariance[i + 1, j]
            p01 = f00 * covariance[i, j + 1] + f01 * covariance[i + 1, j + 1]
            p10 = f10 * covariance[i, j] + f11 * covariance[i + 1, j]
            p11 = f10 * covariance[i, j + 1] + f11 * covariance[i + 1, j + 1]
            g00, g01, g10, g11 = blocks[b, 0, 0], blocks[b, 0, 1], blocks[b, 1, 0], blocks[b, 1, 1]
            out[i, j] = p00 * g00 + p01 * g01
            out[i, j + 1] = p00 * g10 + p01 * g11
            out[i + 1, j] = p10 * g00 + p11 * g01
            out[i + 1, j + 1] = p10 * g10 + p11 * g11
        for k in range(2 * lines, size):
            out[k, i] = f00 * covariance[k, i] + f01 * covariance[k, i + 1]
            out[k, i + 1] = f10 * covariance[k, i] + f11 * covariance[k, i + 1]
    for i in range(2 * lines, size):
        for j in range(2 * lines, i + 1):
            out[i, j] = covariance[i, j]
    for i in range(size):
        for j in range(i):
            out[j, i] = out[i, j]
    return out


@compiled
def seen(slopes: Array, lines: Index, columns: Array) -> Array:
    """H times columns (M, C); (N, C)."""
    count, mount, width = lines.size, columns.shape[0] - 3, columns.shape[1]
    out = np.empty((count, width))
    for n in range(count):
        i = 2 * lines[n]
        a, b, c, d, e = slopes[n, 0], slopes[n, 1], slopes[n, 2], slopes[n, 3], slopes[n, 4]
        for k in range(width):
            out[n, k] = (
                a * columns[i, k]
                + b * columns[i + 1, k]
                + c * columns[mount, k]
                + d * columns[mount + 1, k]
                + e * columns[mount + 2, k]
            )
    return out


@compiled
def seen_from(rows: Array, slopes: Array, lines: Index) -> Array:
    """Rows (C, M) times H'; (C, N)."""
    count, mount, height = lines.size, rows.shape[1] - 3, rows.shape[0]
    out = np.empty((height, count))
    for k in range(height):
        for n in range(count):
            i = 2 * lines[n]
            out[k, n] = (
                slopes[n, 0] * rows[k, i]
                + slopes[n, 1] * rows[k, i + 1]
                + slopes[n, 2] * rows[k, mount]
                + slopes[n, 3] * rows[k, mount + 1]
                + slopes[n, 4] * rows[k, mount + 2]
            )
    return out
