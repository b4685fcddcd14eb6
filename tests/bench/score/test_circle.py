"""Clusters and cover of the circle, wherever on it they lie."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from omnivert.angles import TURN, wrap
from omnivert.bench.score.circle import clusters, covered, nearest
from omnivert.bench.score.truth import Float

bearings = arrays(np.float64, st.integers(1, 40), elements=st.floats(-3.1, 3.1))
widths = st.floats(0.001, 0.5)


@given(bearing=bearings, width=widths)
def test_a_cluster_is_never_wider_than_its_width(bearing: Float, width: float) -> None:
    label = clusters(bearing, width)
    assert set(label.tolist()) == set(range(int(label.max()) + 1))
    for k in range(int(label.max()) + 1):
        mine = bearing[label == k]
        assert np.max(np.abs(wrap(mine[:, None] - mine[None, :]))) <= min(2 * width, width + 1e-9)


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0, -2.5])
def test_clusters_turn_with_the_circle(turn: float) -> None:
    bearing = np.array([0.0, 0.005, 0.011, 0.5, 2.0, 2.012, -3.0])
    assert len(set(clusters(bearing, 0.0121).tolist())) == 4
    turned = clusters(wrap(bearing + turn), 0.0121)
    assert [turned[0], turned[4]] == [turned[2], turned[5]]
    assert len(set(turned.tolist())) == 4


def test_a_cluster_lies_across_the_cut_at_pi() -> None:
    assert len(set(clusters(np.array([3.14, -3.14, 0.0]), 0.01))) == 2


@given(bearing=bearings, tolerance=st.floats(0.001, 0.3))
def test_cover_is_the_share_of_random_bearings_that_are_near(bearing: Float, tolerance: float) -> None:
    sample = np.linspace(-np.pi, np.pi, 20000, endpoint=False)
    share = np.mean(nearest(sample, bearing) <= tolerance)
    assert covered(bearing, tolerance) == pytest.approx(share, abs=bearing.size * 2 / 20000 + 1e-9)


def test_nothing_covers_nothing_and_one_covers_twice_its_tolerance() -> None:
    assert covered(np.empty(0), 0.1) == 0.0
    assert covered(np.array([1.0]), 0.1) == pytest.approx(0.2 / TURN)
    assert clusters(np.empty(0), 0.1).size == 0
    assert np.isinf(nearest(np.array([1.0]), np.empty(0))).all()
