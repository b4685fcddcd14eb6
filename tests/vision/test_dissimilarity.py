"""Each dissimilarity against its equation, one number after the other."""

import math
import tracemalloc
from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.config import Dissimilarity, Vision
from omnivert.vision.dissimilarity import (
    bhattacharyya,
    bin_similarity,
    chi_square,
    dissimilarity,
    jeffrey,
    l2,
    minkowski,
    quadratic_form,
    ssd,
    zncc,
)
from omnivert.vision.matching import distances

Rows = NDArray[np.float32]
KINDS: tuple[Dissimilarity, ...] = get_args(Dissimilarity)
BINS = 8


def _rows(seed: int, n: int, k: int = 2 * BINS, *, empty: float = 0.3) -> Rows:
    """Histograms, some of their bins empty."""
    rng = np.random.default_rng(seed)
    return (rng.uniform(0.0, 1.0, (n, k)) * (rng.uniform(size=(n, k)) >= empty)).astype(np.float32)


def _x_ln(x: float, y: float) -> float:
    return x * math.log(x / y) if x > 0.0 else 0.0


def _jeffrey(h: list[float], k: list[float]) -> float:
    return sum(_x_ln(a, (a + b) / 2.0) + _x_ln(b, (a + b) / 2.0) for a, b in zip(h, k, strict=True))


def _chi_square(h: list[float], k: list[float]) -> float:
    pairs = [(a, (a + b) / 2.0) for a, b in zip(h, k, strict=True)]
    return sum((a - m) ** 2 / m for a, m in pairs if m > 0.0)


def _bhattacharyya(h: list[float], k: list[float]) -> float:
    shared = sum(math.sqrt(a / sum(h) * b / sum(k)) for a, b in zip(h, k, strict=True))
    return math.sqrt(max(1.0 - shared, 0.0))


def _quadratic(h: list[float], k: list[float]) -> float:
    total = 0.0
    for part in range(0, len(h), BINS):
        for i in range(BINS):
            for j in range(BINS):
                steps = min((i - j) % BINS, (j - i) % BINS)
                similar = math.exp(-steps / BINS * 16.0)
                total += (h[part + i] - k[part + i]) * similar * (h[part + j] - k[part + j])
    return math.sqrt(total)


def _zncc(p: list[float], q: list[float]) -> float:
    a, b = sum(p) / len(p), sum(q) / len(q)
    above = sum((x - a) * (y - b) for x, y in zip(p, q, strict=True))
    return 1.0 - above / math.sqrt(sum((x - a) ** 2 for x in p) * sum((y - b) ** 2 for y in q))


def _power(p: float) -> Callable[[list[float], list[float]], float]:
    return lambda h, k: sum(abs(a - b) ** p for a, b in zip(h, k, strict=True)) ** (1.0 / p)


LITERAL: dict[Dissimilarity, Callable[[list[float], list[float]], float]] = {
    "l1": _power(1.0),
    "l2": _power(2.0),
    "linf": lambda h, k: max(abs(a - b) for a, b in zip(h, k, strict=True)),
    "jeffrey": _jeffrey,
    "chi-square": _chi_square,
    "bhattacharyya": _bhattacharyya,
    "quadratic": _quadratic,
    "ssd": lambda h, k: sum((a - b) ** 2 for a, b in zip(h, k, strict=True)),
    "zncc": _zncc,
}


@pytest.mark.parametrize("kind", KINDS)
@given(n=st.integers(0, 4), m=st.integers(0, 5), seed=st.integers(0, 1000))
def test_each_is_its_equation(kind: Dissimilarity, n: int, m: int, seed: int) -> None:
    A, B = _rows(seed, n), _rows(seed + 5000, m)
    slow = np.array([[LITERAL[kind](a, b) for b in B.tolist()] for a in A.tolist()]).reshape(n, m)
    D = dissimilarity(A, B, kind, BINS)
    assert D.shape == (n, m)
    assert D.dtype == np.float64
    assert np.allclose(D, slow, atol=1e-3 if kind == "l2" else 1e-7)


@pytest.mark.parametrize("p", [1.0, 1.5, 2.0, 3.0])
def test_minkowskis_form_holds_for_any_power(p: float) -> None:
    A, B = _rows(1, 3), _rows(2, 4)
    assert np.allclose(minkowski(A, B, p), [[_power(p)(a, b) for b in B.tolist()] for a in A.tolist()])


def test_minkowskis_form_below_one_is_refused() -> None:
    for p in (0.5, math.nan):
        with pytest.raises(ValueError, match="p = 1"):
            minkowski(_rows(1, 2), _rows(2, 2), p)


@pytest.mark.parametrize("kind", KINDS)
def test_a_row_is_nearest_to_itself_and_all_is_symmetric(kind: Dissimilarity) -> None:
    A = _rows(3, 12)
    D = dissimilarity(A, A, kind, BINS)
    assert np.allclose(D, D.T, atol=1e-12)
    assert np.max(np.abs(np.diag(D))) < (1e-3 if kind == "l2" else 1e-12)
    assert np.array_equal(np.argmin(D, axis=1), np.arange(12))
    assert np.min(D) >= 0.0


def test_of_equal_rows_exactly_zero_is_left_where_no_product_is_taken() -> None:
    A = _rows(4, 6)
    for D in (minkowski(A, A, 2.0), bhattacharyya(A, A), quadratic_form(A, A, BINS), ssd(A, A), chi_square(A, A)):
        assert np.all(np.diag(D) == 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_empty_rows_give_numbers(kind: Dissimilarity) -> None:
    A = np.concatenate((np.zeros((2, 2 * BINS), dtype=np.float32), _rows(5, 2)))
    D = distances(A, A, kind, BINS)
    assert np.all(np.isfinite(D))
    assert np.all(D[:2, 2:] > 0.0)


def test_the_bounded_ones_keep_their_bounds_without_a_bin_in_common() -> None:
    h = np.eye(2, 2 * BINS, dtype=np.float32)
    assert jeffrey(h, h)[0, 1] == pytest.approx(2.0 * math.log(2.0))  # the greatest for two unit histograms
    assert chi_square(h, h)[0, 1] == pytest.approx(1.0)
    assert bhattacharyya(h, h)[0, 1] == pytest.approx(1.0)


@pytest.mark.parametrize("bins", [8, 16, 32])
def test_every_difference_of_histograms_counts_in_the_quadratic_form(bins: int) -> None:
    S = bin_similarity(bins)
    assert np.allclose(S, np.roll(S, (3, 3), axis=(0, 1)))  # the bins lie on a circle
    assert np.min(np.linalg.eigvalsh(S)) > 0.02


def test_a_vote_next_door_is_nearer_than_one_far_away_only_in_the_quadratic_form() -> None:
    one = np.eye(1, 64, dtype=np.float32)
    moved = np.stack([np.roll(one[0, :32], s) for s in (1, 2, 8, 16, 31)])
    moved = np.concatenate((moved, np.zeros_like(moved)), axis=1)
    D = quadratic_form(one, moved, 32)[0]
    assert D[0] < D[1] < D[2] < D[3]
    assert D[4] == pytest.approx(D[0])  # over the end, bin 31 is next to bin 0
    assert np.ptp(l2(one, moved)) < 1e-6
    other_side = np.roll(one, 32, axis=1)  # the same bin of another histogram is not next door
    assert quadratic_form(one, other_side, 32)[0, 0] == pytest.approx(math.sqrt(2.0))


@given(gain=st.floats(0.2, 5.0), offset=st.floats(-100.0, 100.0), seed=st.integers(0, 100))
def test_zncc_does_not_see_gain_and_offset(gain: float, offset: float, seed: int) -> None:
    P, Q = 255.0 * _rows(seed, 3, empty=0.0), 255.0 * _rows(seed + 500, 4, empty=0.0)
    assert np.allclose(zncc((gain * P + offset).astype(np.float32), Q), zncc(P, Q), atol=1e-4)
    assert np.allclose(zncc((-gain * P + offset).astype(np.float32), Q), 2.0 - zncc(P, Q), atol=1e-4)


def test_a_patch_without_contrast_is_like_nothing() -> None:
    flat = np.full((1, 48), 200.1, dtype=np.float32)
    assert zncc(flat, flat)[0, 0] == 1.0
    assert np.all(zncc(flat, _rows(1, 3, 48)) == 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_four_hundred_tracks_need_no_large_array(kind: Dissimilarity) -> None:
    A, B = _rows(1, 200, 192), _rows(2, 400, 192)
    distances(A, B, kind)
    tracemalloc.start()
    distances(A, B, kind)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6 * 2**20  # the whole difference would be 123 MB; measured 3.8 MB, all arrays together


@pytest.mark.parametrize("kind", ["jeffrey", "chi-square"])
def test_tiles_join_without_a_seam(kind: Dissimilarity) -> None:
    A, B = _rows(1, 9, 192), _rows(2, 700, 192)
    at_once = dissimilarity(A, B, kind, BINS)
    one_by_one = np.stack([np.concatenate([dissimilarity(a[None], b[None], kind, BINS)[0] for b in B]) for a in A])
    assert np.allclose(at_once, one_by_one, atol=1e-9)


def test_every_choice_of_the_configuration_is_known() -> None:
    for kind in KINDS:
        assert Vision(dissimilarity=kind).dissimilarity == kind
    assert Vision().dissimilarity == Vision(mode="paper").dissimilarity == "l2"
