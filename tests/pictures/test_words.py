"""Numbers are rounded to two digits of their sigma, and every state has one word."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.messages import Mount, State
from omnivert.pictures.words import Quantity, amounts, counted, heading, mark, printable, quantities, short, word


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (33.1044, 0.3812, "33.10 ± 0.38 deg"),
        (18.2, 17.3, "18 ± 17 deg"),
        (30.11, 4.32, "30.1 ± 4.3 deg"),
        (0.10093, 0.0996, "0.10 ± 0.10 deg"),
        (1234.5, 217.0, "1234 ± 217 deg"),
        (1.0, 0.0, "1.0000 ± 0.0000 deg"),
        (1.0, math.nan, "1.0000 ± nan deg"),
    ],
)
def test_a_number_shows_two_digits_of_its_sigma(value: float, sigma: float, text: str) -> None:
    assert str(Quantity("phi", value, sigma, "deg")) == text


@given(sigma=st.floats(1e-4, 9.94))
def test_sigma_keeps_two_digits_over_all_sizes(sigma: float) -> None:
    shown = float(Quantity("phi", 1.0, sigma, "deg").sigma_text)
    assert abs(shown - sigma) <= 0.051 * sigma


def test_the_heading_is_known_when_the_errors_of_phi_and_psi_cancel() -> None:
    covariance = np.diag([0.1**2, 0.01**2, 0.1**2])
    covariance[0, 2] = covariance[2, 0] = -0.999 * 0.1**2
    total = heading(Mount(3.0, 0.2, 1.0, covariance))
    assert total.value == pytest.approx(math.degrees(4.0 - math.tau))
    assert total.sigma == pytest.approx(math.degrees(0.1 * math.sqrt(0.002)), rel=1e-6)
    assert quantities(Mount(3.0, 0.2, 1.0, covariance))[0].sigma == pytest.approx(math.degrees(0.1))


def test_states_are_told_by_words_and_marks_not_by_colour_alone() -> None:
    assert [word(state) for state in State] == ["waiting", "not yet", "usable", "calibrated", "moved", "invalid"]
    assert {mark(State.CALIBRATED), mark(State.NOT_YET), mark(State.INVALID), mark(State.WAITING)} == set("✓!✗–")


@given(text=st.text())
def test_a_text_from_the_network_is_printed_without_what_moves_a_cursor(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert len(shown) == len(text)
    assert printable(shown) == shown


def test_texts_and_counts_keep_to_their_room() -> None:
    assert [short("abcd", 4), short("abcde", 4)] == ["abcd", "abc…"]
    assert [counted(9999), counted(10_000), counted(15.04, 1), counted(2**62)] == ["9999", ">9999", "15.0", ">9999"]


def test_messages_are_counted_in_plain_words() -> None:
    assert amounts({"Frame": 2, "Ticks": 1, "Scan": 0, "estimate": 1}) == "2 frames · 1 ticks · 0 scans · 1 estimate"
