"""How much innovations speak for a jump of the mount: the watchdog's inner loop, compiled."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.kalman.blocks import agree, without
from omnivert.compiled import compiled

Array = NDArray[np.float64]


@compiled
def scored(
    nu: Array,
    precision: Array,
    shift: Array,
    counts: NDArray[np.bool_],
    doubt: Array,
    gate: float,
    plain_gate: float,
    enough: int,
    scores: Array,
    informations: Array,
) -> Array:
    """How much a frame's innovations speak for jumps of the mount (yaw, forward, left) at J frames.

    nu            (N,)       rad
    precision     (N, N)     S^-1
    shift         (N, 3 J)   of the innovations by each jump, G; the last is a jump at this frame
    counts        (N,)       whether a line may speak
    doubt         (3,)       rad, m, m: sigmas of a jump that may be
    gate                     sigmas: the worst line, given all others and such a jump, goes until none is beyond it
    plain_gate               the same without a jump
    enough                   lines that must be left for a jump to be believed
    scores        (J, 3)     grow by G' S^-1 nu, in place
    informations  (J, 3, 3)  grow by G' S^-1 G, in place
    returns       (J,)       chi-square of 3 degrees of freedom of each sum when nothing has jumped

    A gate that allows no jump throws away what speaks for one; a gate that allows one lets three wrong bearings among
    few lines pass for it, or a single one whose line is not seen again. So the wider gate is believed only where it
    explains two lines more, and with enough to spare.
    """
    n, columns = nu.size, shift.shape[1]
    h = shift[:, columns - 3 :]
    left = precision.copy()
    kept = counts.copy()
    for i in range(n):
        if not kept[i]:
            without(left, i)
    # The inverse with a jump allowed, (S + H D H')^-1, by the matrix inversion lemma.
    bh, m = np.zeros((n, 3)), np.zeros((3, 3))
    for i in range(n):
        for j in range(n):
            for k in range(3):
                bh[i, k] += left[i, j] * h[j, k]
        for k in range(3):
            for c in range(3):
                m[k, c] += h[i, k] * bh[i, c]
    for k in range(3):
        m[k, k] += 1.0 / doubt[k] ** 2
    core = _inverse_of_three(m)
    wide, many = left.copy(), kept.copy()
    for i in range(n):
        for k in range(3):
            part = bh[i, 0] * core[0, k] + bh[i, 1] * core[1, k] + bh[i, 2] * core[2, k]
            for j in range(n):
                wide[i, j] -= part * bh[j, k]
    agree(nu, wide, many, gate)
    few, before = kept.copy(), left.copy()
    agree(nu, left, few, plain_gate)
    if many.sum() >= enough and many.sum() > few.sum() + 1:
        left = before
        for i in range(n):
            if kept[i] and not many[i]:
                without(left, i)
        kept = many
    else:
        kept = few
    row = np.empty(columns)
    for i in range(n):
        if kept[i]:
            pull = 0.0
            row[:] = 0.0
            for j in range(n):
                pull += left[i, j] * nu[j]
                for k in range(columns):
                    row[k] += left[i, j] * shift[j, k]
            for w in range(columns // 3):
                for k in range(3):
                    scores[w, k] += shift[i, 3 * w + k] * pull
                    for c in range(3):
                        informations[w, k, c] += shift[i, 3 * w + k] * row[3 * w + c]
    chi = np.zeros(columns // 3)
    for w in range(columns // 3):
        inverse = _inverse_of_three(informations[w])
        for k in range(3):
            for c in range(3):
                chi[w] += scores[w, k] * inverse[k, c] * scores[w, c]
    return chi


@compiled
def _inverse_of_three(m: Array) -> Array:
    """Of a positive definite (3, 3), by cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant
    return out
