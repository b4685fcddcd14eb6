"""Angles: axioms, sampled at the seam on purpose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert import angles

seam = st.sampled_from([np.pi, -np.pi, np.nextafter(np.pi, 4), np.nextafter(-np.pi, -4), np.nextafter(-np.pi, 0)])
any_angle = st.floats(-1e4, 1e4) | seam


@given(any_angle)
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = angles.wrap(angle)
    assert -np.pi < wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


@given(any_angle)
def test_wrapping_twice_is_wrapping_once(angle: float) -> None:
    assert angles.wrap(angles.wrap(angle)) == pytest.approx(angles.wrap(angle), abs=1e-12)


@given(st.lists(any_angle, max_size=8))
def test_an_array_wraps_as_its_elements_do(values: list[float]) -> None:
    assert list(angles.wrap(np.array(values))) == [angles.wrap(value) for value in values]


@given(st.floats(-1.0, 1.0), st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=8))
def test_the_mean_turns_with_its_angles(turn: float, values: list[float]) -> None:
    turned = angles.mean(np.array(values) + np.pi + turn)
    assert angles.wrap(turned - angles.mean(values) - np.pi - turn) == pytest.approx(0.0, abs=1e-9)


def test_opposite_directions_have_no_mean() -> None:
    with pytest.raises(ValueError, match="no mean direction"):
        angles.mean([0.0, np.pi])
    with pytest.raises(ValueError, match="no mean direction"):
        angles.mean([])
