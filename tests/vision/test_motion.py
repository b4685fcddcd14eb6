"""Turn and flow against pairs whose motion is known."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.vision.motion import common_flow, sine_of

Float = NDArray[np.float64]


def _pairs(seed: int, count: int = 60) -> tuple[Float, Float, np.random.Generator]:
    """Angles, and drifts of lines at various distances."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, count)
    return angle, 0.03 * rng.uniform(0.3, 2.0, count) * np.sin(angle), rng


@pytest.mark.parametrize("seed", range(5))
def test_the_flow_is_found_although_every_tenth_pair_is_wrong(seed: int) -> None:
    angle, drift, rng = _pairs(seed)
    turn, more, scale, cos_part, sin_part = 1.2, 0.02, 1.4, 0.012, -0.008
    moved = turn + more + scale * drift + cos_part * np.cos(angle) + sin_part * np.sin(angle)
    moved += rng.normal(0.0, 5e-4, angle.size)
    moved[::10] += rng.uniform(0.15, 0.4, moved[::10].size)
    flow = common_flow(turn, angle, drift, wrap(moved))
    assert flow.turn == pytest.approx(turn + more, abs=1e-3)
    assert flow.scale == pytest.approx(scale, abs=0.05)
    assert flow.cos_part == pytest.approx(cos_part, abs=1e-3)
    assert flow.sin_part == pytest.approx(sin_part, abs=2e-3)
    assert flow.spread < 0.003
    expected = scale * drift + cos_part * np.cos(angle) + sin_part * np.sin(angle)
    assert np.max(np.abs(flow.of(angle, drift) - expected)) < 2e-3


def test_fewer_than_six_pairs_tell_no_more_than_the_turn() -> None:
    angle, drift, _ = _pairs(0, 5)
    assert common_flow(0.7, angle, drift, wrap(0.75 + 2.0 * drift))[:4] == (0.7, 1.0, 0.0, 0.0)
    assert sine_of(angle, drift) == (0.0, 0.0)


def test_the_sine_of_many_drifts_is_found_although_every_tenth_is_wrong() -> None:
    angle, _, rng = _pairs(1)
    drift = 0.01 * np.cos(angle) - 0.02 * np.sin(angle) + rng.normal(0.0, 5e-4, angle.size)
    drift[::10] += 0.3
    assert sine_of(angle, drift) == pytest.approx((0.01, -0.02), abs=1e-3)
