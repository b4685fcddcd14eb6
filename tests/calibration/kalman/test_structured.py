"""filterpy's own formulas give the same with matrices that know their zeros as with dense ones."""

from typing import Any

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.kalman.structured import Moved, Slopes, Spread

Array = NDArray[np.float64]


def dense_moved(blocks: Array) -> Array:
    full = np.eye(2 * blocks.shape[0] + 3)
    for k, block in enumerate(blocks):
        full[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    return full


def dense_slopes(slopes: Array, lines: NDArray[np.int64], size: int) -> Array:
    full = np.zeros((lines.size, size))
    for row, (line, slope) in enumerate(zip(lines, slopes, strict=True)):
        full[row, [2 * line, 2 * line + 1, size - 3, size - 2, size - 1]] = slope
    return full


def filter_at(x: Array, covariance: Array) -> ExtendedKalmanFilter:
    kalman = ExtendedKalmanFilter(dim_x=x.size, dim_z=1)
    kalman.x, kalman.P = x.copy(), covariance.copy()
    return kalman


@settings(max_examples=60, deadline=None)
@given(lines=st.integers(1, 12), seed=st.integers(0, 2**32 - 1), data=st.data())
def test_predict_and_update_are_those_of_dense_matrices(lines: int, seed: int, data: st.DataObject) -> None:
    seen = np.array(sorted(data.draw(st.sets(st.integers(0, lines - 1), min_size=1))), dtype=np.int64)
    rng = np.random.default_rng(seed)
    size = 2 * lines + 3
    half = rng.standard_normal((size, size)) * 10.0 ** rng.uniform(-4, 0, size)[:, None]
    x, covariance = rng.standard_normal(size), half @ half.T + np.diag(10.0 ** rng.uniform(-8, 0, size))
    blocks, noise = rng.standard_normal((lines, 2, 2)), np.diag(rng.uniform(0.0, 1e-4, size))
    slopes, std = rng.standard_normal((seen.size, 5)), 10.0 ** rng.uniform(-3, 0, seen.size)
    nu = rng.standard_normal(seen.size)
    plain, clever = filter_at(x, covariance), filter_at(x, covariance)
    clever.predict_x = lambda u=0: setattr(clever, "x", dense_moved(blocks) @ clever.x)
    plain.F, plain.Q, clever.F, clever.Q = dense_moved(blocks), noise, Moved(blocks), noise
    for kalman in (plain, clever):
        kalman.predict()
    np.testing.assert_allclose(clever.x, plain.x, rtol=1e-12)
    scale = np.sqrt(np.outer(np.diag(plain.P), np.diag(plain.P)))
    np.testing.assert_allclose(clever.P / scale, plain.P / scale, atol=1e-12)
    np.testing.assert_array_equal(clever.P, clever.P.T)
    h = dense_slopes(slopes, seen, size)
    plain.update(nu, lambda _: h, lambda _: np.zeros(nu.size), R=np.diag(std**2))
    clever.update(nu, lambda _: Slopes(slopes, seen), lambda _: np.zeros(nu.size), R=Spread(std**2))
    spread = np.sqrt(np.diag(plain.P))
    np.testing.assert_allclose((clever.x - plain.x) / spread, 0.0, atol=1e-9 * (1.0 + np.abs(plain.x / spread).max()))
    np.testing.assert_allclose(clever.S, plain.S, rtol=1e-9, atol=1e-12 * np.abs(plain.S).max())
    np.testing.assert_allclose(clever.P, plain.P, rtol=1e-9, atol=1e-9 * plain.P.max())


def test_what_a_formula_should_not_do_with_an_operand_is_refused() -> None:
    moved: Any = Moved(np.ones((2, 2, 2)))
    slopes: Any = Slopes(np.ones((1, 5)), np.array([0]))
    spread: Any = Spread(np.ones(2))
    with pytest.raises(TypeError):
        np.dot(np.eye(7), moved)
    with pytest.raises(TypeError):
        np.dot(spread, np.eye(2))
    with pytest.raises(TypeError):
        np.add(np.eye(7), moved)
    with pytest.raises(TypeError):
        np.linalg.inv(moved)
    with pytest.raises(TypeError):
        np.einsum("ij->ji", slopes)
    with pytest.raises(AssertionError):
        np.dot(moved, np.eye(7)).dot(Moved(np.ones((2, 2, 2))).T)


def test_what_was_followed_moves_as_the_state_does() -> None:
    rng = np.random.default_rng(3)
    blocks, columns = rng.standard_normal((4, 2, 2)), rng.standard_normal((11, 6))[:, ::2]
    np.testing.assert_allclose(Moved(blocks).moved(columns), dense_moved(blocks) @ columns, rtol=1e-12, atol=1e-12)
    slopes, lines = rng.standard_normal((2, 5)), np.array([1, 3])
    np.testing.assert_allclose(
        Slopes(slopes, lines).left_of(columns), dense_slopes(slopes, lines, 11) @ columns, rtol=1e-12, atol=1e-12
    )
