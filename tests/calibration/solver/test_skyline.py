"""Factor, solution and inverse inside the rows' spans, against dense algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.solver.skyline import corner, factored, inverse, solved, starts

Array = NDArray[np.float64]
Index = NDArray[np.int64]
calm = settings(deadline=None, max_examples=60)


def matrix(seed: int) -> tuple[Index, Index, Array, Array]:
    """Spans, and a positive definite matrix that has nothing outside of them: dense, and as stored."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 30))
    first = np.array([int(rng.integers(0, i + 1)) for i in range(size)], dtype=np.int64)
    lower = np.tril(rng.standard_normal((size, size)))
    lower[np.arange(size)[None, :] < first[:, None]] = 0.0
    np.fill_diagonal(lower, 1.0 + np.abs(np.diag(lower)))
    dense = lower @ lower.T
    return first, starts(first), dense, np.concatenate([dense[i, first[i] : i + 1] for i in range(size)])


@calm
@given(st.integers(0, 10_000))
def test_the_factor_solves(seed: int) -> None:
    first, start, dense, values = matrix(seed)
    assert factored(first, start, values)
    right = np.arange(1.0, first.size + 1.0)
    np.testing.assert_allclose(dense @ solved(first, start, values, right), right, atol=1e-6)


@calm
@given(st.integers(0, 10_000))
def test_the_inverse_inside_the_spans_is_that_of_the_dense_matrix(seed: int) -> None:
    first, start, dense, values = matrix(seed)
    assert factored(first, start, values)
    found, expected = inverse(first, start, values), np.linalg.inv(dense)
    scale = np.abs(expected).max()
    for i in range(first.size):
        np.testing.assert_allclose(
            found[start[i] : start[i + 1]] / scale, expected[i, first[i] : i + 1] / scale, atol=1e-8
        )


@calm
@given(st.integers(0, 10_000))
def test_the_corner_of_the_factor_is_that_of_the_schur_complement(seed: int) -> None:
    first, start, dense, values = matrix(seed)
    assert factored(first, start, values)
    begin = first.size // 2
    root = corner(first, start, values, begin)
    schur = dense[begin:, begin:].copy()
    if begin:
        schur -= dense[begin:, :begin] @ np.linalg.solve(dense[:begin, :begin], dense[:begin, begin:])
    np.testing.assert_allclose(root @ root.T, schur, atol=1e-7 * np.abs(dense).max())


@pytest.mark.parametrize("pivot", [0.0, -1.0, np.nan])
def test_what_is_not_positive_definite_is_said(pivot: float) -> None:
    first = np.array([0, 0], dtype=np.int64)
    assert not factored(first, starts(first), np.array([1.0, 0.0, pivot]))
