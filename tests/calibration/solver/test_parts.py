"""Parts of a drive against each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.calibration.solver.parts import AGREE, Parts, from_prior, widened
from omnivert.calibration.solver.problem import Prior


def spread(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(6, 6))
    return root @ root.T + 0.1 * np.eye(6)


@given(st.integers(0, 2**31))
def test_a_stretch_lies_as_far_from_its_prior_as_two_estimates_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = spread(rng), spread(rng)  # covariances
    one, two = 0.1 * rng.normal(size=6), 0.1 * rng.normal(size=6)
    before, own = np.linalg.inv(first), np.linalg.inv(second)
    both = np.linalg.solve(before + own, before @ one + own @ two)
    found = from_prior(Prior(one, before, np.ones(6, dtype=np.bool_), np.zeros(3)), both, before + own)
    assert found.chi == pytest.approx((one - two) @ np.linalg.solve(first + second, one - two), rel=1e-5, abs=1e-9)
    assert found.freedom == 6


def test_the_first_stretch_has_nothing_to_disagree_with() -> None:
    prior = Prior(np.zeros(6), np.diag([0.0, 0.0, 0.0, 25.0, 100.0, 100.0]), np.ones(6, dtype=np.bool_), np.zeros(3))
    assert from_prior(prior, np.ones(6), np.eye(6)) == AGREE


def test_variances_grow_only_where_chance_does_not_explain_the_parts() -> None:
    rng = np.random.default_rng(7)
    told = [Parts(float(chi), 9) for chi in rng.chisquare(9, 2000)]
    assert sum(part.scatter() > 1.0 for part in told) <= 8  # 2 are foreseen, more than 8 in 1 of 10 000
    tripled = np.array([Parts(float(9.0 * chi), 9).scatter() for chi in rng.chisquare(9, 2000)])
    assert np.median(tripled) == pytest.approx(9.0, rel=0.15)  # sigmas three times too small are found so


def test_disagreement_is_as_unlikely_as_that_of_two_halves() -> None:
    assert Parts(25.0, 3).disagreement == pytest.approx(25.0)
    assert Parts(25.0, 9).disagreement == pytest.approx(13.95, abs=0.01)  # by tables: both 3 in 1000
    assert (Parts(25.0, 3) + AGREE).disagreement == pytest.approx(25.0)


def test_a_model_that_is_known_to_be_wrong_gets_no_benefit_of_the_doubt() -> None:
    likely = Parts(14.0, 9)
    assert likely.scatter() == 1.0
    assert likely.scatter(chance=1.0) == pytest.approx(14.0 / 9.0)
    assert Parts(4.0, 9).scatter(chance=1.0) == 1.0


def test_a_doubted_camera_near_the_axis_may_look_from_anywhere_along_a_known_heading() -> None:
    covariance = np.array([[0.16, 0.0, -0.15], [0.0, 0.05**2, 0.0], [-0.15, 0.0, 0.16]])
    near, away = np.array([0.3, 0.05, 0.1]), np.array([0.3, 0.5, 0.1])
    both = np.array([1.0, 0.0, 1.0])
    assert np.array_equal(widened(near, covariance, 1.0, False), covariance)
    assert np.allclose(widened(away, covariance, 4.0, True), 4.0 * covariance)
    wide = widened(near, covariance, 4.0, True)
    assert 3.0 * np.sqrt(wide[0, 0]) > np.pi  # no direction is excluded
    assert both @ wide @ both == pytest.approx(4.0 * both @ covariance @ both)
    assert wide[1, 1] == pytest.approx(4.0 * covariance[1, 1])
