import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from omnivert.vision.matching import distances, matches

F = (1.05, 0.75, 0.8)
ANY = 1e9  # a rule that everything passes


@given(st.integers(0, 6), st.integers(0, 6), st.integers(0, 1000))
def test_distances_are_the_norms_of_the_differences(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, 192)).astype(np.float32), rng.normal(size=(m, 192)).astype(np.float32)
    slow = np.array([[np.linalg.norm(a - b) for b in B] for a in A]).reshape(n, m)
    assert np.allclose(distances(A, B), slow, atol=1e-3)


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
