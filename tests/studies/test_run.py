"""What is called a false claim, and what a study makes of its runs."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.messages import Correction, Estimate, Extrinsics, Mount, ParameterVerdict, State
from omnivert.simulation.recording import Drive, Knock, Scene, recorded
from omnivert.studies.bound import bound_of
from omnivert.studies.montecarlo import runs_of
from omnivert.studies.presets import PRESETS, Case
from omnivert.studies.run import Run, Solution, false_claims, run_of
from omnivert.studies.summary import figure, met, named, nees_band, study, summary

Array = NDArray[np.float64]
SIGMA = np.array([0.01, 0.003, 0.01])


def estimate(
    drive: Drive, state: State, error: Array | None = None, at_s: float | None = None, rho: State | None = None
) -> Estimate:
    """One of the drive's end, off by this many sigmas."""
    time = drive.time_s[-1] if at_s is None else at_s
    frame = int(np.searchsorted(drive.time_s, time + 1e-6)) - 1
    at = drive.mount_at[frame] + SIGMA * (np.zeros(3) if error is None else error)
    word = ParameterVerdict(state)
    return Estimate(
        stamp_ns=round(1e9 * float(time)),
        frame=frame,
        mount=Mount(float(at[0]), float(at[1]), float(at[2]), np.diag(SIGMA**2)),
        state=state,
        phi=word,
        rho=word if rho is None else ParameterVerdict(rho),
        psi=word,
        next_manoeuvre="",
        driven_m=1.0,
        turned_rad=1.0,
        lines_used=0,
        lines_new=0,
        lines_rejected=0,
    )


MIDDLE = (0.5, 0.25, -1.0)


def test_a_claim_is_false_where_it_is_off_by_more_than_six_of_its_sigmas() -> None:
    drive = recorded(Scene(mount=MIDDLE), Config(), 1)
    for off, false in ((np.array([5.0, -5.0, 5.0]), ()), (np.array([0.0, 6.5, 0.0]), ("rho is off",))):
        assert false_claims(drive, Config(), [estimate(drive, State.CALIBRATED, off)]) == false
        assert false_claims(drive, Config(), [estimate(drive, State.USABLE, off)]) == ()


def test_one_parameter_can_be_claimed_falsely_alone() -> None:
    drive = recorded(Scene(mount=MIDDLE), Config(), 1)
    off = np.array([20.0, -20.0, 20.0])
    told = estimate(drive, State.USABLE, off, rho=State.CALIBRATED)
    assert false_claims(drive, Config(), [told]) == ("rho is off",)


@pytest.mark.parametrize(
    "scene", [case.scene for case in PRESETS["degenerate"]], ids=lambda s: f"{s.path} {s.radius_m}"
)
def test_every_claim_on_a_drive_that_shows_no_mount_is_false_even_when_it_is_right(scene: Scene) -> None:
    drive = recorded(replace(scene, mount=MIDDLE), Config(), 1)
    assert "rho is not shown by the drive" in false_claims(drive, Config(), [estimate(drive, State.CALIBRATED)])


def test_a_claim_is_held_to_what_the_drive_had_shown_by_then() -> None:
    drive = recorded(Scene(mount=MIDDLE), Config(), 1)
    early = estimate(drive, State.CALIBRATED, at_s=float(drive.time_s[12]))
    assert false_claims(drive, Config(), [early]) != ()
    assert false_claims(drive, Config(), [estimate(drive, State.CALIBRATED)]) == ()


def test_after_a_knock_the_old_mount_is_wrong() -> None:
    knock = Knock(at_s=35.0, left_m=0.08)
    drive = recorded(Scene(mount=MIDDLE, knock=knock), Config(), 1)
    before = estimate(drive, State.CALIBRATED, at_s=float(drive.time_s[drive.time_s < 35.0][-1]))
    assert false_claims(drive, Config(), [before]) == ()
    late = replace(before, stamp_ns=round(1e9 * float(drive.time_s[-1])))
    assert any("off" in reason for reason in false_claims(drive, Config(), [late]))


def run(case: str, error: Array, bound: Array, state: State = State.CALIBRATED, **other: object) -> Run:
    part = Solution(error, np.diag(SIGMA**2))
    found = Run(
        case=case, seed=0, mount=np.array(MIDDLE), filter=part, smoother=part, oracle=part, bound=bound,
        bound_held=bound, state=state, parameters=(state,) * 3, reasons=("", "", ""), next_manoeuvre="",
        first_claim_s=20.0, claims=1, false_claims=(), alarm_s=(), corrections=(), seconds=0.1,
    )  # fmt: skip
    return replace(found, **other)  # type: ignore[arg-type]


def drawn(count: int, times: float = 1.0) -> list[Run]:
    rng = np.random.default_rng(0)
    return [run("x", times * SIGMA * rng.standard_normal(3), np.diag(SIGMA**2)) for _ in range(count)]


def test_an_estimator_at_the_bound_has_ratios_of_one_and_a_nees_inside_its_band() -> None:
    figures = summary(drawn(400), 0)
    for name in ("filter", "smoother"):
        np.testing.assert_allclose(figures["efficiency"][name], 1.0, atol=0.12)
        for value, (low, high) in zip(figures["efficiency"][name], figures["efficiency_95"][name], strict=True):
            assert low < value < high
            assert high - low < 0.25
    assert figures["nees_in_band"] == 1
    assert figures["wrong_runs"] == figures["beyond_6_sigma"] == 0
    assert figures["ratio_to_oracle_median"] == pytest.approx(1.0)
    assert figures["paired_filter_over_smoother"] == pytest.approx([1.0] * 3)


def test_sigmas_that_are_too_small_fall_out_of_the_band() -> None:
    figures = summary(drawn(400, 1.3), 0)
    assert figures["nees_in_band"] == 0
    assert min(figures["efficiency"]["filter"]) > 1.15
    wrong = summary([run("x", np.array([0.3, 0.0, 0.0]), np.eye(3)), *drawn(3)], 0)
    assert wrong["wrong_runs"] == wrong["beyond_6_sigma"] == 1


def test_the_band_narrows_with_the_runs_and_holds_one() -> None:
    wide, narrow = nees_band(10), nees_band(200)
    assert wide is not None
    assert narrow is not None
    assert narrow == pytest.approx([0.89, 1.12], abs=0.01)  # as measured before
    assert wide[0] < narrow[0] < 1.0 < narrow[1] < wide[1]


def test_what_no_run_has_is_null_and_json_takes_all() -> None:
    figures = summary([run("x", SIGMA, np.eye(3), State.NOT_YET, filter=None, smoother=None, oracle=None)], 0)
    assert figures["efficiency"] == {"filter": None, "smoother": None}
    assert figures["nees_over_3_mean"] is None
    assert figures["ratio_to_oracle_median"] is None
    assert figures["states"] == {"not_yet": [1, 1, 1]}
    json.dumps(figures)


def test_several_paths_stand_below_the_pooled_figures_with_their_targets() -> None:
    cases = [Case("x", Scene(), targets={"efficiency_filter": (0.0, 1.15)}), Case("y", Scene())]
    figures = study(cases, [*drawn(50), run("y", 9.0 * SIGMA, np.diag(SIGMA**2))], 0)
    assert figures["runs"] == 51
    assert figures["beyond_6_sigma"] == 1
    assert figures["paths"]["x"]["beyond_6_sigma"] == 0
    assert figures["paths"]["x"]["targets_met"] == {"efficiency_filter": True}
    assert met(figures["paths"]["y"], "efficiency_filter", 0.0, 1.15) is False
    assert met(figures, "ratio_to_oracle_median", 2.0, 3.0) is False


def test_every_target_of_the_presets_is_a_figure() -> None:
    for cases in PRESETS.values():
        assert len({case.name for case in cases}) == len(cases)
        for case in cases:
            single = study([case], [run(case.name, SIGMA, np.eye(3))], 0)
            for name in case.targets:
                figure(single, name)
                assert name.startswith("efficiency_") or name in single


def test_what_is_unseen_is_named_by_its_own_words() -> None:
    straight = PRESETS["degenerate"][0]
    said = "because you drove straight for 6.0 m, phi and psi are seen only as a sum"
    assert named(straight, run("straight", SIGMA, np.eye(3), reasons=(said, said, said)))
    assert not named(straight, run("straight", SIGMA, np.eye(3), reasons=("sigma is above the limit", "", "")))


def truth_itself(drive: Drive, config: Config) -> tuple[Array, Array]:
    return drive.mount, bound_of(drive, config).mount


def test_a_seed_gives_the_same_run_in_any_process() -> None:
    case = Case("straight", Scene(path="straight", visible=4.0))
    here = list(runs_of([case], Config(), 2, seed=5, oracle=truth_itself))
    there = sorted(runs_of([case], Config(), 2, seed=5, jobs=2), key=lambda one: one.seed)
    assert [one.seed for one in here] == [one.seed for one in there] == [5, 6]
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one.bound, other.bound)
        assert one.reasons == other.reasons
        assert one.oracle is not None
        assert np.abs(one.oracle.error).max() == 0.0
        assert other.oracle is None


def test_a_drive_that_shows_all_ends_near_its_bound_and_claims_nothing_false() -> None:
    """At a small size; the command repeats it at any."""
    runs = list(runs_of([Case("alternate", Scene())], Config(), 3, seed=1))
    figures = summary(runs, 0)
    assert figures["without_filter"] == figures["without_smoother"] == 0
    assert figures["wrong_runs"] == figures["beyond_6_sigma"] == 0
    assert max(figures["efficiency"]["smoother"]) < 2.2  # rms of three: chance alone allows it once in a thousand
    low, high = figures["claimed_over_bound"][0], figures["claimed_over_bound"][1]
    assert 0.8 < low < 1.3
    assert 0.8 < high < 1.3


def test_one_single_line_shows_the_mount_to_the_sigmas_that_are_told() -> None:
    """The paper's theorem, within what the wheels' noise allows: told from early on, though long not claimed."""
    figures = summary(list(runs_of([PRESETS["one-line"][0]], Config(), 4, seed=5001)), 0)
    assert figures["without_filter"] == figures["without_smoother"] == 0
    assert figures["inside_3_sigma_share"] == 1.0
    assert figures["false_calibrated"] == 0
    assert max(figures["claimed_over_bound"]) < 1.3


@pytest.mark.parametrize("case", PRESETS["degenerate"], ids=lambda case: case.name)
def test_a_drive_that_does_not_show_the_mount_is_not_claimed_and_says_what_is_missing(case: Case) -> None:
    for one in runs_of([case], Config(), 1, seed=77):
        assert one.false_claims == ()
        assert one.claims == 0
        assert one.state in (State.WAITING, State.NOT_YET, State.USABLE)
        assert named(case, one), one.reasons


def test_corrections_are_compared_with_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    told = (
        Correction("time_offset", 0.080, 0.008, True),
        Correction("wheel_base", 0.40 * 1.06, 0.004, True),
        Correction("wheel_ratio", 1.0, 0.0, False, "held"),
    )

    class Calibrated:
        def __init__(self, config: Config) -> None: ...

        def step(self, message: object) -> tuple[Estimate | Extrinsics, ...]:
            return ()

        def close(self) -> tuple[Estimate | Extrinsics, ...]:
            return (replace(estimate(recorded(scene, Config(), 1), State.USABLE), corrections=told),)

    scene = Scene(mount=MIDDLE, time_offset_s=0.083, wheel_ratio=1.02, base_factor=1.05)
    monkeypatch.setattr(sys.modules[run_of.__module__], "Calibrator", Calibrated)
    offset, base = run_of(Case("x", scene), Config(), 1).corrections
    assert (offset.name, base.name) == ("time_offset", "wheel_base")
    assert offset.error == pytest.approx(-0.003)
    assert base.error == pytest.approx(0.01)
    assert base.std == pytest.approx(0.01)
    assert base.bound == pytest.approx(0.0109, rel=0.1)
