"""The one step message -> estimate, over whole synthetic drives and over bad input."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.judging.observability import Piece
from omnivert.calibration.judging.verdict import Shown, verdict
from omnivert.config import Calibration, Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Mount, State, Ticks
from omnivert.simulation.recording import Drive, Scene, recorded

Array = NDArray[np.float64]
SECOND = 1_000_000_000


def told(
    messages: tuple[Ticks | Bearings, ...], config: Config | None = None, stored: Extrinsics | None = None
) -> tuple[list[Estimate], list[Extrinsics], Calibrator]:
    calibrator = Calibrator(config or Config(), stored)
    out: list[Estimate | Extrinsics] = []
    for message in messages:
        out += calibrator.step(message)
    out += calibrator.close()
    estimates = [o for o in out if isinstance(o, Estimate)]
    if len(estimates) > 1 and calibrator.close() == () and estimates[-1].stamp_ns == estimates[-2].stamp_ns:
        del estimates[-2]  # the last frame is told once more, with everything solved
    return estimates, [o for o in out if isinstance(o, Extrinsics)], calibrator


def error(mount: Mount, drive: Drive) -> Array:
    off = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]) - drive.mount
    off[[0, 2]] = wrap(off[[0, 2]])
    return off


def frame(time_s: float, track: list[int], bearing: list[float]) -> Bearings:
    n = len(track)
    return Bearings(
        round(time_s * SECOND),
        np.array(track, dtype=np.int64),
        np.array(bearing, dtype=np.float64),
        np.full(n, 0.003),
        np.zeros(n, dtype=np.int32),
        np.ones(n, dtype=np.float32),
    )


@pytest.fixture(scope="module")
def paper_drive() -> Drive:
    return recorded(Scene(path="paper", mount=(-0.34, 0.23, 0.33)), Config(), 11)


@pytest.fixture(scope="module")
def paper_told(paper_drive: Drive) -> tuple[list[Estimate], list[Extrinsics], Calibrator]:
    return told(paper_drive.messages)


@pytest.mark.parametrize(("path", "seed"), [("paper", 21), ("alternate", 22)])
def test_any_mount_is_found_from_no_guess_and_the_claim_is_true(path: str, seed: int) -> None:
    drive = recorded(Scene(path=path), Config(), seed)  # type: ignore[arg-type]
    estimates, claims, calibrator = told(drive.messages)
    assert estimates[-1].state is State.CALIBRATED
    assert claims
    for claim in claims:
        off = error(claim.mount, drive)
        assert off @ np.linalg.solve(claim.mount.covariance, off) < 21.1  # chi-square of 3, 1 in 10 000
        assert np.rad2deg(np.abs(off[[0, 2]])).max() < 6.0
        assert abs(off[1]) < 0.03
    assert calibrator.refused == {}


def test_there_is_one_estimate_for_every_frame(
    paper_drive: Drive, paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]
) -> None:
    frames = [m.stamp_ns for m in paper_drive.messages if isinstance(m, Bearings)]
    assert [e.stamp_ns for e in paper_told[0]] == frames
    assert [e.frame for e in paper_told[0]] == list(range(1, len(frames) + 1))


def test_nothing_is_claimed_before_the_turn(paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]) -> None:
    estimates, claims, _ = paper_told
    straight = [e for e in estimates if e.turned_rad < np.deg2rad(10.0)]
    assert len(straight) > 50
    assert all(e.state in (State.WAITING, State.NOT_YET) for e in straight)
    assert straight[-1].phi.reason.startswith("because you drove straight for 3.")
    assert "only as a sum" in straight[-1].phi.reason
    assert straight[-1].next_manoeuvre == "turn about 90 deg on the spot"
    assert claims[0].frames > len(straight)


@pytest.mark.parametrize(
    ("piece", "said"),
    [
        (Piece(9, 0.6, 0.6, 0.6, 0.01), "straight for 0.7 m"),
        (Piece(9, 0.2, -0.2, 0.01, 1.0), "on the spot, by 69 deg"),
    ],
)
def test_a_reason_speaks_of_the_whole_drive_as_the_estimate_does(piece: Piece, said: str) -> None:
    shown = Shown(9, 20, True, 0.7, 1.2, (piece,), None, 0.0, 0.0, None, "", False)
    assert said in verdict(shown, Calibration(), State.NOT_YET).phi.reason


def test_the_claim_names_what_it_holds_for(paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]) -> None:
    _, claims, _ = paper_told
    assert claims[0].robot == "demo"
    assert claims[0].camera == "front"
    assert claims[0].rig_digest == Config().rig_digest()
    assert claims[0].software.startswith("omnivert ")
    assert all(b.frames - a.frames >= 15 for a, b in pairwise(claims[:-1]))


def test_at_the_end_the_final_state_is_claimed_once(
    paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator],
) -> None:
    estimates, claims, calibrator = paper_told
    last = estimates[-1]
    assert last.mount is not None
    assert last.state is State.CALIBRATED
    assert (claims[-1].stamp_ns, claims[-1].frames, claims[-1].mount) == (last.stamp_ns, last.frame, last.mount)
    assert sum(claim.stamp_ns == last.stamp_ns for claim in claims) == 1
    assert calibrator.close() == ()


@pytest.mark.parametrize(("path", "radius"), [("turn", 0.5), ("arc", 0.3), ("arc", 1.9), ("still", 0.5)])
def test_one_kind_of_motion_never_calibrates(path: str, radius: float) -> None:
    drive = recorded(Scene(path=path, radius_m=radius), Config(), 31)  # type: ignore[arg-type]
    estimates, claims, _ = told(drive.messages)
    assert not claims
    assert {e.state for e in estimates} <= {State.WAITING, State.NOT_YET}
    assert estimates[-1].next_manoeuvre
    assert estimates[-1].phi.reason.startswith("because ")


def test_far_lines_alone_never_calibrate() -> None:
    drive = recorded(Scene(path="alternate", distance_scale=100.0), Config(), 2004)
    estimates, claims, _ = told(drive.messages)
    assert not claims
    assert {e.state for e in estimates} <= {State.WAITING, State.NOT_YET}


def test_the_result_depends_on_the_messages_alone(
    paper_drive: Drive, paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]
) -> None:
    turned = tuple(  # the lines of a frame have no order
        replace(m, track_id=m.track_id[::-1], bearing_rad=m.bearing_rad[::-1], std_rad=m.std_rad[::-1])
        if isinstance(m, Bearings)
        else m
        for m in paper_drive.messages
    )
    again, _, _ = told(turned)
    for first, second in zip(paper_told[0], again, strict=True):
        assert (first.state, first.reasons) == (second.state, second.reasons)
        assert (first.phi.state, first.phi.reason) == (second.phi.state, second.phi.reason)
        if first.mount is not None:
            assert second.mount is not None
            assert (first.mount.phi_rad, first.mount.rho_m) == (second.mount.phi_rad, second.mount.rho_m)
            assert first.mount.covariance.tobytes() == second.mount.covariance.tobytes()


def test_a_stored_mount_is_back_at_once_and_the_drive_goes_on(
    paper_drive: Drive, paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]
) -> None:
    stored = paper_told[1][-1]
    estimates, _, _ = told(paper_drive.messages, stored=stored)
    assert estimates[0].mount is not None
    assert estimates[0].mount.phi_rad == pytest.approx(stored.mount.phi_rad)
    assert estimates[0].state is State.CALIBRATED
    assert "taken up from the store" in estimates[0].reasons
    assert estimates[-1].mount is not None
    off = error(estimates[-1].mount, paper_drive)
    assert np.rad2deg(np.abs(off[[0, 2]])).max() < 4.0


def test_a_stored_mount_that_no_longer_holds_is_taken_back_and_the_new_one_is_found(
    paper_drive: Drive, paper_told: tuple[list[Estimate], list[Extrinsics], Calibrator]
) -> None:
    stored = paper_told[1][-1]
    knocked = replace(stored, mount=replace(stored.mount, phi_rad=stored.mount.phi_rad + 0.5))
    estimates, claims, _ = told(paper_drive.messages, stored=knocked)
    moved = [e for e in estimates if e.state is State.MOVED]
    assert moved
    assert "moved" in moved[0].phi.reason
    assert [c.state for c in claims][:2] == [State.MOVED, State.CALIBRATED]
    assert claims[0].mount == knocked.mount
    assert estimates[-1].mount is not None
    off = error(estimates[-1].mount, paper_drive)
    assert np.rad2deg(np.abs(off[[0, 2]])).max() < 4.0


def test_the_filter_as_printed_stays_available(paper_drive: Drive) -> None:
    config = Config(calibration=Calibration(mode="paper"))
    estimates, claims, _ = told(paper_drive.messages, config)
    assert not claims
    assert "as printed" in estimates[-1].phi.reason
    assert all(e.mount is not None for e in estimates)
    first = estimates[0].mount
    assert first is not None
    assert (first.phi_rad, first.rho_m, first.psi_rad) == pytest.approx((0.0, 0.2, 0.0), abs=0.05)
    assert len(estimates) == sum(isinstance(m, Bearings) for m in paper_drive.messages)


def wired(drive: Drive, wrong: str) -> tuple[Ticks | Bearings, ...]:
    """The messages of a robot that is put together wrongly."""

    def told_wrongly(m: Ticks | Bearings) -> Ticks | Bearings:
        if isinstance(m, Bearings):
            return replace(m, bearing_rad=wrap(-m.bearing_rad)) if wrong == "mirrored" else m
        left = -m.left if wrong in ("left", "both") else m.left
        right = -m.right if wrong in ("right", "both") else m.right
        return replace(m, left=right, right=left) if wrong == "swapped" else replace(m, left=left, right=right)

    return tuple(told_wrongly(m) for m in drive.messages)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ("mirrored", "bearing_sign is wrong, or the wheels' sides are swapped"),
        ("swapped", "bearing_sign is wrong, or the wheels' sides are swapped"),
        ("right", "encoder.right_sign is wrong"),
        ("left", "encoder.left_sign is wrong"),
    ],
)
def test_a_wrong_wiring_is_named_not_fitted(wrong: str, named: str) -> None:
    drive = recorded(Scene(path="paper", visible=6.0, frame_s=0.5), Config(), 17)
    estimates, claims, _ = told(wired(drive, wrong))
    assert not claims
    assert estimates[-1].state is State.INVALID
    assert named in estimates[-1].phi.reason


def test_both_signs_reversed_is_a_robot_that_calls_its_back_its_front() -> None:
    drive = recorded(Scene(path="alternate"), Config(), 17)
    messages = tuple(replace(m, left=-m.right, right=-m.left) if isinstance(m, Ticks) else m for m in drive.messages)
    estimates, _, _ = told(messages)
    mount = estimates[-1].mount
    assert mount is not None
    assert abs(wrap(mount.phi_rad - drive.mount[0] - np.pi)) < 0.1


def test_frames_before_the_first_count_and_after_the_last_are_told_without_it() -> None:
    messages = (
        frame(0.0, [1], [0.1]),
        frame(0.3, [1], [0.1]),
        Ticks(SECOND, 0, 0),
        Ticks(2 * SECOND, 0, 0),
        frame(1.5, [1], [0.1]),
        frame(4.0, [1], [0.1]),
    )
    estimates, claims, _ = told(messages)
    assert len(estimates) == 4
    assert not claims
    assert [bool(e.reasons) for e in estimates] == [True, True, False, True]
    assert estimates[0].state is State.WAITING


def test_counts_that_stop_do_not_hold_frames_forever() -> None:
    calibrator = Calibrator(Config())
    calibrator.step(Ticks(0, 0, 0))
    out = [calibrator.step(frame(0.1 * k, [1], [0.1])) for k in range(1, 30)]
    assert sum(len(o) for o in out) >= 15
    assert all("no wheel counts at this frame" in e.reasons for o in out for e in o)


def test_repeated_and_reversed_frames_are_refused() -> None:
    messages = (
        Ticks(0, 0, 0),
        frame(0.1, [1], [0.1]),
        frame(0.1, [1], [0.2]),
        frame(0.05, [1], [0.2]),
        Ticks(SECOND, 0, 0),
    )
    estimates, _, calibrator = told(messages)
    assert len(estimates) == 1
    assert calibrator.refused == {"bearings: stamp not after the one before": 2}


def test_repeated_tracks_and_values_that_are_no_numbers_are_refused() -> None:
    messages = (Ticks(0, 0, 0), frame(0.1, [1, 1, 2, 3], [0.1, 0.2, float("nan"), 0.3]), Ticks(SECOND, 0, 0))
    estimates, _, calibrator = told(messages)
    assert estimates[0].lines_new == 1
    assert sum(calibrator.refused.values()) == 3


def test_empty_frames_and_a_drive_of_one_frame_wait() -> None:
    for messages in (
        (Ticks(0, 0, 0), frame(0.0, [], [])),
        (Ticks(0, 0, 0), frame(0.0, [1], [0.5]), Ticks(SECOND, 0, 0)),
    ):
        estimates, claims, _ = told(messages)
        assert len(estimates) == 1
        assert estimates[0].state in (State.WAITING, State.NOT_YET)
        assert estimates[0].mount is None
        assert not claims


def test_a_jump_of_the_counts_in_mid_drive_is_said_and_survived(paper_drive: Drive) -> None:
    jump = 25 * SECOND  # still on the straight
    messages = tuple(
        replace(m, left=m.left + 500_000, right=m.right - 70_000) if isinstance(m, Ticks) and m.stamp_ns > jump else m
        for m in paper_drive.messages
    )
    estimates, claims, calibrator = told(messages)
    assert any("broke off" in r for e in estimates for r in e.reasons)
    assert sum(calibrator.refused.values()) == 1
    for claim in claims:
        off = error(claim.mount, paper_drive)
        assert off @ np.linalg.solve(claim.mount.covariance, off) < 21.1


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_break_in_the_counts_makes_no_claim_untrue(paper_drive: Drive, share: float) -> None:
    """The parts of a drive before and after a break share their mount alone, and what one part leaves open stays so."""
    stamps = [m.stamp_ns for m in paper_drive.messages]
    broken_ns = stamps[0] + round(share * (stamps[-1] - stamps[0]))
    messages = tuple(
        replace(m, left=m.left + 2**40, right=m.right + 2**40) if isinstance(m, Ticks) and m.stamp_ns > broken_ns else m
        for m in paper_drive.messages
    )
    estimates, claims, _ = told(messages)
    assert any(e.stamp_ns > broken_ns and "broke off" in " ".join(e.reasons) for e in estimates)
    last = estimates[-1].mount
    assert last is not None
    for mount in [*(claim.mount for claim in claims), last]:
        off = error(mount, paper_drive)
        assert off @ np.linalg.solve(mount.covariance, off) < 21.1  # chi-square of 3, 1 in 10 000


def test_wild_counts_now_and_then_are_refused_and_cost_nothing(paper_drive: Drive) -> None:
    messages = tuple(
        replace(m, left=m.left + 400_000) if isinstance(m, Ticks) and k % 300 == 150 else m
        for k, m in enumerate(paper_drive.messages)
    )
    estimates, _, calibrator = told(messages)
    assert estimates[-1].state is State.CALIBRATED
    assert calibrator.refused["ticks: a jump that no wheel can make"] > 3
    assert not any("broke off" in r for e in estimates for r in e.reasons)


def test_a_long_drive_is_solved_stretch_by_stretch() -> None:
    config = Config(calibration=Calibration(window_keyframes=60))
    drive = recorded(Scene(path="alternate"), config, 41)
    estimates, claims, _ = told(drive.messages, config)
    assert estimates[-1].state is State.CALIBRATED
    off = error(claims[-1].mount, drive)
    assert off @ np.linalg.solve(claims[-1].mount.covariance, off) < 21.1
