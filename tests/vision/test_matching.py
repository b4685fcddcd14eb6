from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.config import Dissimilarity
from omnivert.vision.dissimilarity import dissimilarity
from omnivert.vision.matching import distances, matches

F = (1.05, 0.75, 0.8)
ANY = 1e9  # a rule that everything passes


@given(st.integers(0, 6), st.integers(0, 6), st.integers(0, 1000))
def test_distances_are_the_norms_of_the_differences(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, 192)).astype(np.float32), rng.normal(size=(m, 192)).astype(np.float32)
    slow = np.array([[np.linalg.norm(a - b) for b in B] for a in A]).reshape(n, m)
    assert np.allclose(distances(A, B), slow, atol=1e-3)


def test_the_l2_distance_is_what_it_is() -> None:
    A, B = np.eye(3, 192, dtype=np.float32), np.zeros((2, 192), dtype=np.float32)
    assert np.array_equal(distances(A, B), np.ones((3, 2)))


@pytest.mark.parametrize("kind", [kind for kind in get_args(Dissimilarity) if kind != "l2"])
def test_every_distance_keeps_the_order_of_its_dissimilarity_and_grows_with_the_first_order(
    kind: Dissimilarity,
) -> None:
    rng = np.random.default_rng(1)
    A, change = rng.uniform(0.2, 1.0, (1, 192)), 0.01 * rng.normal(size=192)
    B = (A + np.arange(1, 6)[:, None] * change).astype(np.float32)
    A32 = A.astype(np.float32)
    D = distances(A32, B, kind)
    raw = dissimilarity(A32, B, kind, 32)
    assert np.array_equal(np.argsort(D[0]), np.argsort(raw[0]))
    assert np.allclose(D[0] / D[0, 0], np.arange(1, 6), rtol=0.15)  # twice the difference, twice the distance


def test_the_distance_of_patches_does_not_depend_on_their_number_of_cells() -> None:
    A, B = (np.full((1, 48), grey, dtype=np.float32) for grey in (100.0, 110.0))
    assert np.allclose(distances(A, B, "ssd"), distances(np.tile(A, 4), np.tile(B, 4), "ssd"))


def test_rule_one_is_a_border_on_the_least_distance() -> None:
    for least, match in ((1.0499, 1), (1.05, -1), (1.06, -1)):
        assert matches(np.array([[5.0, least, 5.0]]), 1.05, ANY, ANY).tolist() == [match]


def test_rule_two_compares_with_the_mean_of_all_the_least_included() -> None:
    # (d + 1 + 1) / 3 * 0.75 = d  <=>  d = 2/3
    for least, match in ((0.666, 0), (2.0 / 3.0 + 1e-9, -1)):
        assert matches(np.array([[least, 1.0, 1.0]]), ANY, 0.75, ANY).tolist() == [match]


def test_rule_three_is_a_border_on_the_second_smallest() -> None:
    for least, match in ((0.799, 2), (0.8, -1)):
        assert matches(np.array([[1.0, 3.0, least]]), ANY, ANY, 0.8).tolist() == [match]


def test_all_three_rules_must_hold() -> None:
    D = np.array([[0.3, 0.9, 0.9], [0.9, 0.3, 0.32], [1.2, 9.0, 9.0], [0.9, 0.9, 0.9]])
    assert matches(D, *F).tolist() == [0, -1, -1, -1]


def test_a_lone_candidate_is_judged_by_its_distance_alone() -> None:
    assert matches(np.array([[0.5]]), *F).tolist() == [0]
    assert matches(np.array([[1.1]]), *F).tolist() == [-1]


def test_nothing_matches_nothing() -> None:
    assert matches(np.empty((0, 4)), *F).size == 0
    assert matches(np.empty((3, 0)), *F).tolist() == [-1, -1, -1]


def test_of_two_that_want_the_same_the_nearer_gets_it() -> None:
    assert matches(np.array([[0.5, 2.0], [0.2, 2.0], [0.2, 2.0]]), *F).tolist() == [-1, 0, -1]


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 1000))
def test_no_candidate_is_given_twice_and_every_match_obeys_the_rules(n: int, m: int, seed: int) -> None:
    D = np.random.default_rng(seed).uniform(0.01, 1.8, (n, m))
    match = matches(D, *F)
    taken = match[match >= 0]
    assert np.unique(taken).size == taken.size
    for i in np.flatnonzero(match >= 0):
        row = np.sort(D[i])
        assert D[i, match[i]] == row[0] < F[0]
        assert m == 1 or (row[0] < F[1] * row.mean() and row[0] < F[2] * row[1])


def test_a_mutual_match_is_the_nearest_on_both_sides() -> None:
    D = np.array([[0.3, 0.6], [0.1, 0.7], [0.9, 0.55]])
    assert matches(D, ANY, ANY, ANY).tolist() == [-1, 0, 1]
    assert matches(D, ANY, ANY, ANY, mutual=True).tolist() == [-1, 0, 1]


def test_a_nearer_one_that_fails_a_rule_blocks_the_farther_one_only_when_it_must_be_mutual() -> None:
    D = np.array([[0.5, 2.0, 2.0], [0.4, 0.42, 2.0]])  # the second is nearer to 0, and cannot tell 0 from 1
    assert matches(D, *F).tolist() == [0, -1]
    assert matches(D, *F, mutual=True).tolist() == [-1, -1]


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 1000))
def test_mutual_matches_are_those_that_both_sides_would_choose(n: int, m: int, seed: int) -> None:
    D = np.random.default_rng(seed).uniform(0.01, 1.8, (n, m))
    free, both = matches(D, *F), matches(D, *F, mutual=True)
    chosen = {(i, int(j)) for i, j in enumerate(both) if j >= 0}
    assert chosen == {(i, int(j)) for i, j in enumerate(free) if j >= 0 and np.argmin(D[:, j]) == i}
    there = matches(D, ANY, ANY, ANY, mutual=True)
    back = matches(D.T, ANY, ANY, ANY, mutual=True)
    assert {(i, int(j)) for i, j in enumerate(there) if j >= 0} == {(int(i), j) for j, i in enumerate(back) if i >= 0}


@pytest.mark.parametrize("shape", [(0, 4), (3, 0), (0, 0)])
def test_nothing_matches_nothing_mutually_either(shape: tuple[int, int]) -> None:
    assert matches(np.empty(shape), *F, mutual=True).tolist() == [-1] * shape[0]
