"""What the way has shown: pieces, covariances, centres of rotation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.calibration.observability import centres, larger, pieces
from omnivert.simulation.robot import drive

BASE, K, TICK = 0.4, 2e-4, 2.4e-4


def wheels_of(path: str, seed: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    rng = np.random.default_rng(seed)
    trip = drive(path, BASE, K, 0.02, rng)  # type: ignore[arg-type]
    steps = np.diff(trip.wheels_m[::17], axis=0)
    return np.asarray(steps + np.sqrt(K * np.abs(steps)) * rng.standard_normal(steps.shape))


@pytest.mark.parametrize(("path", "kinds"), [("straight", 1), ("turn", 1), ("arc", 1), ("paper", 2), ("alternate", 2)])
def test_a_noisy_way_is_cut_into_its_manoeuvres(path: str, kinds: int) -> None:
    for seed in range(10):
        assert len(centres(pieces(wheels_of(path, seed), BASE, K, TICK))) == kinds


def test_standing_still_has_no_centre() -> None:
    assert centres(pieces(np.zeros((50, 2)), BASE, K, TICK)) == []


def test_forward_and_backward_are_the_same_centre() -> None:
    way = np.concatenate([np.full((20, 2), 0.05), np.full((20, 2), -0.05)])
    assert len(centres(pieces(way, BASE, K, TICK))) == 1


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_the_larger_covariance_is_no_smaller_than_either(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (a @ a.T + 0.01 * np.eye(3) for a in rng.standard_normal((2, 3, 3)))
    both = larger(first, second)
    for one in (first, second):
        assert np.linalg.eigvalsh(both - one).min() > -1e-9
