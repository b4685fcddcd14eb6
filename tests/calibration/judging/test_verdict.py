"""What may be claimed: each condition alone keeps a claim back, and says why."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.judging.manoeuvre import Manoeuvre
from omnivert.calibration.judging.observability import Piece, Seen, Unseen
from omnivert.calibration.judging.telling import is_told
from omnivert.calibration.judging.verdict import (
    ODOMETER_UNITS,
    Condition,
    Shown,
    Verdict,
    paper_verdict,
    unmet,
    verdict,
)
from omnivert.config import Calibration
from omnivert.messages import State

Array = NDArray[np.float64]

LIMITS = Calibration()
LIMIT = np.array([np.deg2rad(2.0), 0.010, np.deg2rad(2.0)])
STRAIGHT = Piece(60, 1.5, 1.5, 1.5, 0.0)
TURN = Piece(30, 0.31, -0.31, 0.0, 1.57)
CIRCLE = Piece(60, 1.4, 0.6, 1.0, 2.0)  # of 0.5 m radius, to the left

GOOD = Shown(
    frames=100,
    lines=10,
    ticks=True,
    driven_m=2.3,
    turned_rad=4.7,
    centres=(STRAIGHT, TURN),
    covariance=np.diag((0.4 * LIMIT) ** 2),
    rho_m=0.23,
    disagreement=3.0,
    sum_rad=0.002,
    contradicted="",
    restored=False,
    filter_off=0.5,
    gap=400.0,
    inlier_share=0.95,
    phi_rad=-0.34,
)


def judged(shown: Shown, before: State = State.NOT_YET) -> Verdict:
    return verdict(shown, LIMITS, before)


def states(told: Verdict) -> tuple[State, State, State]:
    return told.phi.state, told.rho.state, told.psi.state


def spread(phi: float, rho: float, psi: float) -> Array:
    """Covariance of sigmas in units of their limits."""
    return np.asarray(np.diag((np.array([phi, rho, psi]) * LIMIT) ** 2))


def seen(unseen: Unseen, sigma: float = 0.0017) -> Seen:
    return Seen(100.0, 100.0, 100.0, sigma, sigma, 100.0, unseen, np.array([0.0, 1.0, 0.0]))


def test_where_everything_holds_all_is_claimed_in_odometer_units() -> None:
    told = judged(GOOD)
    assert unmet(GOOD, LIMITS) == {}
    assert states(told) == (State.CALIBRATED,) * 3
    assert (told.state, told.next_manoeuvre, told.phi.reason) == (State.CALIBRATED, "", "")
    assert told.notes == (ODOMETER_UNITS,)


BROKEN: list[tuple[Condition, Shown, str]] = [
    (Condition.SOUND, replace(GOOD, covariance=np.diag([-1e-6, 1e-6, 1e-6])), "covariance"),
    (Condition.SOUND, replace(GOOD, covariance=np.full((3, 3), np.nan)), "covariance"),
    (Condition.NEAR, replace(GOOD, rho_m=1.2), "rho = 1.20 m"),
    (Condition.NEAR, replace(GOOD, rho_m=float("nan")), "rho"),
    (Condition.NEAR, replace(GOOD, rho_m=6e7, phi_rad=1.0), "rho"),
    (Condition.CENTRES, replace(GOOD, centres=(STRAIGHT,)), "only as a sum"),
    (Condition.CENTRES, replace(GOOD, centres=()), "hardly moved"),
    (Condition.OFF_CENTRE, replace(GOOD, centres=(STRAIGHT, CIRCLE), rho_m=0.49, phi_rad=np.pi / 2), "0.50 m radius"),
    (Condition.OFF_CENTRE, replace(GOOD, rho_m=0.005), "axis"),
    (Condition.CLEAR, replace(GOOD, gap=24.0), "another mount"),
    (Condition.CLEAR, replace(GOOD, gap=float("nan")), "another mount"),
    (Condition.INLIERS, replace(GOOD, inlier_share=0.85), "85 %"),
    (Condition.HALVES, replace(GOOD, disagreement=26.0), "halves"),
    (Condition.STEADY, replace(GOOD, steady=10), "hold over a little more"),
    (Condition.FILTER, replace(GOOD, filter_off=5.1), "filter and smoother differ by 5.1 sigmas"),
    (Condition.TOGETHER, replace(GOOD, covariance=spread(0.4, 3.5, 0.4)), "others"),
]


@pytest.mark.parametrize(("condition", "shown", "said"), BROKEN)
def test_each_condition_alone_keeps_every_claim_back_and_says_why(
    condition: Condition, shown: Shown, said: str
) -> None:
    assert list(unmet(shown, LIMITS)) == [condition]
    for before in (State.NOT_YET, State.CALIBRATED):
        told = judged(shown, before)
        assert State.CALIBRATED not in states(told)
        assert told.state is not State.CALIBRATED
        assert told.phi.reason.startswith("because ")
        assert said in told.phi.reason
        assert told.next_manoeuvre


def test_every_condition_is_tried() -> None:
    assert {condition for condition, _, _ in BROKEN} == set(Condition)


def test_into_a_circles_centre_slides_any_fit_but_not_past_two_other_centres() -> None:
    trapped = replace(GOOD, centres=(CIRCLE, STRAIGHT), rho_m=0.5, phi_rad=np.pi / 2, covariance=spread(0.01, 0.1, 0.4))
    assert Condition.OFF_CENTRE in unmet(trapped, LIMITS)
    assert Condition.OFF_CENTRE in unmet(replace(trapped, centres=(STRAIGHT, CIRCLE)), LIMITS)
    assert unmet(replace(trapped, centres=(CIRCLE, STRAIGHT, TURN)), LIMITS) == {}
    assert unmet(replace(trapped, phi_rad=-np.pi / 2), LIMITS) == {}  # as far on the other side: not its centre
    assert unmet(replace(trapped, rho_m=0.497), LIMITS)  # 3 mm off, sigma 1 mm: just inside
    assert unmet(replace(trapped, rho_m=0.49), LIMITS) == {}


def test_of_a_camera_on_the_axis_only_rho_is_claimed() -> None:
    told = judged(replace(GOOD, centres=(STRAIGHT, CIRCLE), rho_m=0.005))
    assert states(told) == (State.USABLE, State.CALIBRATED, State.USABLE)
    assert "on the robot's axis" in told.phi.reason
    assert states(judged(replace(GOOD, centres=(STRAIGHT, CIRCLE), rho_m=0.05))) == (State.CALIBRATED,) * 3


def test_one_circle_alone_claims_nothing_however_sure_the_fit_is() -> None:
    told = judged(replace(GOOD, centres=(CIRCLE,), rho_m=0.5, phi_rad=np.pi / 2, covariance=spread(0.001, 0.01, 0.1)))
    assert states(told) == (State.NOT_YET,) * 3
    assert told.next_manoeuvre == "drive 0.7 m straight"


@pytest.mark.parametrize(
    ("piece", "unseen", "said"),
    [
        (STRAIGHT, Unseen.PLACE, "because you drove straight for 2.3 m, phi and psi are seen only as a sum (known to"),
        (TURN, Unseen.PHI_AND_RHO, "because you only turned on the spot, by 269 deg, only psi is seen (known to"),
        (CIRCLE, Unseen.SLIDE, "because you drove one circle of 0.50 m radius, only the camera's heading relative to"),
        (STRAIGHT, Unseen.EVERYTHING, "nothing is seen"),
    ],
)
def test_a_reason_says_which_combination_is_seen_and_how_well(piece: Piece, unseen: Unseen, said: str) -> None:
    told = judged(replace(GOOD, centres=(piece,), covariance=None, seen=seen(unseen)))
    for part in (told.phi, told.rho, told.psi):
        assert said in part.reason
        assert ("(known to 0.097 deg)" in part.reason) == (unseen is not Unseen.EVERYTHING)


def test_far_lines_are_said_to_show_nothing_whatever_is_driven() -> None:
    told = judged(replace(GOOD, covariance=spread(9.0, 9.0, 9.0), seen=seen(Unseen.EVERYTHING)))
    assert states(told) == (State.NOT_YET,) * 3
    assert "too far away" in told.psi.reason


def test_where_the_place_is_roughly_known_it_is_told_and_nobody_says_that_nothing_is_seen() -> None:
    one_near_line = replace(seen(Unseen.EVERYTHING), place_m=0.06)
    covariance = spread(9.0, 3.0, 9.0)
    told = judged(replace(GOOD, covariance=covariance, seen=one_near_line))
    assert states(told) == (State.NOT_YET, State.USABLE, State.NOT_YET)
    reasons = [part.reason for part in (told.phi, told.rho, told.psi)]
    assert not any("nothing is seen" in reason for reason in reasons)
    assert all(reason.endswith("; the lines are too far away or too few for this way") for reason in reasons)
    several = judged(replace(GOOD, covariance=None, seen=one_near_line))
    assert several.phi.reason == (
        "because several mounts explain the drive so far about equally well; "
        "the lines are too far away or too few for this way"
    )
    assert is_told(covariance, one_near_line, doubted=False)
    assert not is_told(covariance, seen(Unseen.EVERYTHING), doubted=False)


def test_a_claim_flickers_neither_up_nor_down() -> None:
    between = replace(GOOD, covariance=spread(1.1, 0.5, 0.5))
    assert judged(between).phi.state is State.USABLE
    assert judged(between, State.CALIBRATED).phi.state is State.CALIBRATED
    assert judged(replace(GOOD, covariance=spread(1.3, 0.5, 0.5)), State.CALIBRATED).phi.state is State.USABLE
    assert judged(replace(GOOD, covariance=spread(6.0, 0.5, 0.5))).phi.state is State.NOT_YET
    assert judged(replace(GOOD, covariance=spread(1.1, 0.5, 0.5))).rho.state is State.USABLE  # none without the others


def test_a_sigma_above_its_limit_is_told_beside_the_limit() -> None:
    told = judged(replace(GOOD, covariance=spread(1.9, 0.5, 0.5)))
    assert told.phi.reason == "sigma 3.8 deg is above the limit of 2 deg"


def test_a_moved_camera_stays_moved_until_it_is_calibrated_anew() -> None:
    said = "because the camera has been turned by about 2 deg at 12 s"
    for shown in (GOOD, replace(GOOD, lines=0, covariance=None), replace(GOOD, contradicted="because of a sign")):
        for before in State:
            told = judged(replace(shown, moved=said), before)
            assert (told.state, states(told)) == (State.MOVED, (State.MOVED,) * 3)
            assert told.phi.reason == said
            assert told.next_manoeuvre
    assert judged(GOOD, State.MOVED).state is State.CALIBRATED


def test_the_manoeuvre_that_was_foreseen_is_the_one_that_is_told() -> None:
    todo = Manoeuvre(((0.0, np.pi), (0.3, 0.0)), None, "phi 3.8 -> 0.6 deg")
    told = judged(replace(GOOD, covariance=spread(1.9, 0.5, 0.5), todo=todo))
    assert (told.next_manoeuvre, told.brings) == (
        "turn about 180 deg on the spot, then drive 0.3 m straight",
        "phi 3.8 -> 0.6 deg",
    )
    assert judged(replace(GOOD, todo=todo)).next_manoeuvre == ""


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (replace(GOOD, frames=0), "no frame yet"),
        (replace(GOOD, ticks=False), "no wheel counts at the frames yet"),
        (replace(GOOD, covariance=None, lines=0), "no vertical line is seen"),
    ],
)
def test_before_there_are_data_one_waits(shown: Shown, said: str) -> None:
    told = judged(shown)
    assert (told.state, told.phi.reason) == (State.WAITING, said)


def test_data_against_the_model_are_invalid_and_the_paper_claims_nothing() -> None:
    assert judged(replace(GOOD, contradicted="because of a sign")).state is State.INVALID
    assert states(paper_verdict()) == (State.NOT_YET,) * 3


def test_a_stored_mount_needs_no_drive_but_its_filter_must_agree() -> None:
    stored = replace(GOOD, restored=True, frames=0, centres=(), lines=0, gap=0.0, inlier_share=0.0, driven_m=0.0)
    assert judged(stored).state is State.CALIBRATED
    assert judged(replace(stored, filter_off=9.0)).state is State.USABLE


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(0.0, 2.0)


@settings(deadline=None, max_examples=500)
@given(
    scale=st.tuples(*[st.floats(0.05, 4.0)] * 3),
    correlation=st.floats(-0.999, 0.999),
    rho=st.floats(0.0, 0.6) | numbers,
    phi=st.none() | st.floats(-3.2, 3.2) | st.just(np.pi / 2),
    centres=st.lists(st.sampled_from([STRAIGHT, TURN, CIRCLE]), max_size=3, unique=True),
    gap=st.floats(0.0, 1e4) | st.just(float("nan")),
    share=st.floats(0.8, 1.0),
    halves=st.floats(0.0, 40.0),
    off=st.floats(0.0, 6.0) | st.just(float("nan")),
    flags=st.tuples(st.booleans(), st.booleans()),
    before=st.sampled_from(list(State)),
)
def test_nothing_is_calibrated_unless_every_condition_holds(
    scale: tuple[float, float, float],
    correlation: float,
    rho: float,
    phi: float | None,
    centres: list[Piece],
    gap: float,
    share: float,
    halves: float,
    off: float,
    flags: tuple[bool, bool],
    before: State,
) -> None:
    covariance = spread(*scale)
    covariance[0, 2] = covariance[2, 0] = correlation * np.sqrt(covariance[0, 0] * covariance[2, 2])
    shown = replace(
        GOOD,
        covariance=covariance,
        rho_m=rho,
        phi_rad=phi,
        centres=tuple(centres),
        gap=gap,
        inlier_share=share,
        disagreement=halves,
        filter_off=off,
        moved="because it has moved" if flags[0] and scale[0] < 0.5 else "",
        contradicted="because of a sign" if flags[1] and scale[1] < 0.5 else "",
    )
    told = judged(shown, before)
    hold = LIMITS.hold_limits if before is State.CALIBRATED else 1.0
    for k, part in enumerate((told.phi, told.rho, told.psi)):
        assert bool(part.reason) == (part.state is not State.CALIBRATED)
        if part.state is not State.CALIBRATED:
            continue
        assert unmet(shown, LIMITS, before) == {}
        # The same by hand.
        assert not shown.moved
        assert not shown.contradicted
        assert scale[k] <= hold * (1.0 + 1e-9)
        assert max(scale) <= LIMITS.lean_limits * hold * (1.0 + 1e-9)
        assert 0.0 <= rho <= 1.0
        assert len(centres) >= 2
        assert gap > 25.0
        assert share >= 0.9
        assert halves <= 25.0
        assert off <= 4.0
        assert k == 1 or rho >= 3.0 * scale[1] * LIMIT[1]
    if told.state is State.CALIBRATED:
        assert {told.phi.state, told.rho.state, told.psi.state} == {State.CALIBRATED}
    else:
        assert told.next_manoeuvre


def test_what_was_fitted_where_nothing_is_seen_is_not_usable_however_small_its_sigmas() -> None:
    told = judged(replace(GOOD, seen=seen(Unseen.EVERYTHING)))
    assert states(told) == (State.NOT_YET,) * 3
    assert all("nothing is seen" in part.reason for part in (told.phi, told.rho, told.psi))


def test_of_a_doubted_drive_nothing_is_usable_and_the_reason_says_what_to_check() -> None:
    told = judged(replace(GOOD, doubted=True))
    assert states(told) == (State.NOT_YET,) * 3
    assert told.rho.reason.startswith("because parts of the drive contradict each other")
    assert states(judged(replace(GOOD, doubted=True, restored=True))) == (State.CALIBRATED,) * 3


def test_nobody_is_told_to_go_farther_than_room_and_cable_allow() -> None:
    narrow = Calibration(longest_straight_m=0.5, longest_turn_deg=60.0)
    both = "turn about 60 deg on the spot, then drive 0.5 m straight"
    for shown, todo in (
        (replace(GOOD, frames=0), "drive 0.5 m straight"),
        (replace(GOOD, moved="the camera moved"), both),
        (replace(GOOD, contradicted="because nothing fits"), both),
        (replace(GOOD, covariance=None), both),
        (replace(GOOD, covariance=None, centres=(STRAIGHT,)), "turn about 60 deg on the spot"),
        (replace(GOOD, covariance=None, centres=(TURN,)), "drive 0.5 m straight"),
    ):
        assert verdict(shown, narrow, State.NOT_YET).next_manoeuvre == todo
