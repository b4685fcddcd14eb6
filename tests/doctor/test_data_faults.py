"""A fault in what the sensors tell: the doctor names that one first, with a fix. A healthy drive has none."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.cli.app import app
from omnivert.doctor.finding import Finding, Status
from omnivert.doctor.recorded import told
from omnivert.doctor.report import Report
from omnivert.doctor.stream import Stream
from omnivert.doctor.table import checked
from omnivert.messages import Bearings, Looks, MeetingPoint, PixelFormat, Ring, State, Ticks
from omnivert.vision.frontend import FrontEnd
from tests.doctor.conftest import Told

S = 10**9
COMMANDS = {c.name for c in app.registered_commands} | {group.name for group in app.registered_groups}


def report(told: Told) -> Report:
    evidence = told.evidence
    return Report.of(evidence, checked(evidence))


def finding(told: Told, name: str) -> Finding:
    return next(check.finding for check in report(told).checks if check.name == name)


def wheels(told: Told, change: Callable[[Ticks], Ticks]) -> Told:
    return replace(told, ticks=tuple(map(change, told.ticks)))


def lines(told: Told, keep: Callable[[NDArray[np.float64]], NDArray[np.bool_]]) -> Told:
    """Only the lines whose bearings are kept."""

    def part(frame: Bearings) -> Bearings:
        kept = keep(frame.bearing_rad)
        names = ("track_id", "bearing_rad", "std_rad", "age_frames", "strength")
        looks = frame.looks
        assert looks is not None
        own = {field: getattr(looks, field)[kept] for field in Looks.__dataclass_fields__}
        return replace(frame, **{n: getattr(frame, n)[kept] for n in names}, looks=replace(looks, **own))

    return replace(told, bearings=tuple(map(part, told.bearings)))


def later(told: Told, seconds: float) -> Told:
    """The camera's stamps, and with them those of its lines."""
    moved = [replace(frame, stamp_ns=frame.stamp_ns + round(seconds * S)) for frame in told.frames]
    seen = [replace(frame, stamp_ns=frame.stamp_ns + round(seconds * S)) for frame in told.bearings]
    return replace(told, frames=tuple(moved), bearings=tuple(seen))


def clock_set(told: Told) -> Told:
    """After 20 s all clocks are set on by 1000 s."""

    def after(message: Any) -> Any:
        return replace(message, stamp_ns=message.stamp_ns + (1000 * S if message.stamp_ns > 20 * S else 0))

    return replace(
        told,
        frames=tuple(map(after, told.frames)),
        ticks=tuple(map(after, told.ticks)),
        bearings=tuple(map(after, told.bearings)),
    )


def frozen(told: Told) -> Told:
    """The driver gives the first stamp again and again; the vision refuses such frames."""
    frames = tuple(replace(frame, stamp_ns=told.frames[0].stamp_ns) for frame in told.frames)
    return replace(told, frames=frames, bearings=told.bearings[:1])


def rings(told: Told, change: Callable[[Ring], Ring], off_px: float = 0.0) -> Told:
    """Another rim, and lines that meet so far off its centre."""

    def other(frame: Bearings) -> Bearings:
        assert frame.ring is not None
        ring = change(frame.ring)
        return replace(frame, ring=ring, meeting=MeetingPoint(ring.center_u_px + off_px, ring.center_v_px, 0.3, True))

    return replace(told, bearings=tuple(map(other, told.bearings)))


def seen_with(told: Told, seconds: float = 5.0, **ring: object) -> Told:
    """The first frames once more through the vision, with another [ring]."""
    part = told.set("ring", **ring)
    frames = tuple(frame for frame in part.frames if frame.stamp_ns < seconds * S)
    front_end = FrontEnd(part.config)
    return replace(part, frames=frames, bearings=tuple(map(front_end.step, frames)))


def dark(told: Told) -> Told:
    """The cover is on."""
    frames = tuple(
        replace(f, format=PixelFormat.GREY8, data=np.zeros(f.width_px * f.height_px, np.uint8))
        for f in told.frames[:30]
    )
    front_end = FrontEnd(told.config)
    return replace(told, frames=frames, bearings=tuple(map(front_end.step, frames)))


def pausing(told: Told) -> Told:
    """The encoder's wire has a loose contact: now and then it is silent for 0.7 s."""
    return replace(told, ticks=tuple(t for t in told.ticks if t.stamp_ns % (4 * S) > 0.7 * S))


def with_reasons(told: Told, reason: str) -> Told:
    return replace(told, bearings=tuple(replace(frame, reasons=(reason,)) for frame in told.bearings))


FAULTS: dict[str, tuple[str, Callable[[Told], Told], str]] = {  # what -> first check, how, what its help holds
    "camera far too slow": ("frames", lambda d: d.set("camera", frame_rate_hz=15.0), "more light"),
    "frozen stamps": ("frames", frozen, "plug the camera in again"),
    "a fifth of the frames missing": (
        "frames",
        lambda d: replace(d, frames=tuple(f for k, f in enumerate(d.frames) if k % 5)),
        "cable",
    ),
    "camera silent": ("frames", lambda d: replace(d, frames=(), bearings=()), "with the camera running"),
    "encoder silent": ("ticks", lambda d: replace(d, ticks=()), "with the encoder running"),
    "encoder with gaps": ("ticks", pausing, "every 20 ms"),
    "two clocks": ("clock", lambda d: later(d, 1e6), "one monotonic clock"),
    "clock set meanwhile": ("clock", clock_set, "one monotonic clock"),
    "ring not in the picture": ("ring", lambda d: seen_with(d, r_max_px=120.0, r_min_px=40.0), "omnivert setup ring"),
    "ring elsewhere": ("ring", lambda d: seen_with(d, center_px=[381.0, 239.0]), "center_px = [32"),
    "camera covered": ("ring", dark, "uncover"),
    "rim not round": ("mirror", lambda d: rings(d, lambda r: replace(r, quality=0.45)), "wipe the mirror"),
    "mirror leans": ("mirror", lambda d: rings(d, lambda r: r, off_px=11.0), "level"),
    "overexposed": ("picture", lambda d: with_reasons(d, "30 % of the ring is white"), "shorter exposure"),
    "too few lines": ("lines", lambda d: lines(d, lambda b: np.arange(b.size) < 2), "doors"),
    "not many lines": ("lines", lambda d: lines(d, lambda b: np.arange(b.size) % 16 == 0), "doors"),
    "lines on one side": ("spread", lambda d: lines(d, lambda b: np.abs(b - 1.0) < 1.2), "between walls"),
    "left wheel backwards": ("wheels", lambda d: wheels(d, lambda t: replace(t, left=-t.left)), "left_sign = -1"),
    "right wheel backwards": ("wheels", lambda d: wheels(d, lambda t: replace(t, right=-t.right)), "right_sign = -1"),
    "right wheel dead": ("wheels", lambda d: wheels(d, lambda t: replace(t, right=0)), "right encoder's plug"),
    "sides swapped": ("sense", lambda d: wheels(d, lambda t: replace(t, left=t.right, right=t.left)), "bearing_sign"),
    "bearing_sign wrong": (
        "sense",
        lambda d: replace(d, bearings=tuple(replace(b, bearing_rad=-b.bearing_rad) for b in d.bearings)),
        "camera.bearing_sign = -1",
    ),
    "wheel base wrong": ("turns", lambda d: d.set("robot", wheel_base_m=0.5), "wheel_base_m"),
    "counts of a quarter turn": ("turns", lambda d: d.set("encoder", ticks_per_rev=500), "ticks_per_rev"),
    "camera late": ("offset", lambda d: later(d, 0.3), "camera.stamp_delay_s = 0."),
    "encoder late": ("offset", lambda d: later(d, -0.3), "clock"),
}


def test_a_healthy_drive_has_no_fault(corridor: Told) -> None:
    found = report(corridor)
    assert found.first is None, found.first
    assert found.named(Status.UNCHECKED) == ["calibration"]  # which these tests do not ask


@pytest.mark.parametrize("what", FAULTS)
def test_a_fault_is_named_first_with_a_fix(corridor: Told, what: str) -> None:
    name, broken, help = FAULTS[what]
    found = report(broken(corridor))
    assert found.first is not None
    assert (found.first.name, help in found.first.finding.help) == (name, True), found.first
    assert found.first.finding.reason
    for command in re.findall(r"omnivert ([a-z]+)", found.first.finding.help):
        assert command in COMMANDS


def test_what_depends_on_a_fault_is_not_checked_and_says_so(corridor: Told) -> None:
    found = report(replace(corridor, ticks=()))
    assert found.named(Status.STOPS) == ["ticks"]
    facts = {check.name: check.finding.fact for check in found.checks if check.finding.status is Status.UNCHECKED}
    assert facts == dict.fromkeys(("clock", "wheels", "sense", "turns", "offset", "calibration"), "see ticks")


def test_the_time_offset_is_measured(corridor: Told) -> None:
    turning = later(corridor, 0.3).evidence.seen.turning
    assert turning is not None
    assert turning.late_s is not None
    late, sigma = turning.late_s
    assert sigma < 0.05
    assert abs(late - 0.3) < 3.0 * sigma


def test_the_turn_of_a_wrong_base_is_measured(corridor: Told) -> None:
    turning = corridor.set("robot", wheel_base_m=0.5).evidence.seen.turning
    assert turning is not None
    assert turning.scale is not None
    scale, sigma = turning.scale
    assert abs(scale - 0.5 / 0.4) < 3.0 * sigma + 0.01


def test_a_straight_way_alone_leaves_the_sense_open(corridor: Told) -> None:
    straight = replace(
        corridor,
        frames=tuple(f for f in corridor.frames if f.stamp_ns < 20 * S),
        bearings=tuple(b for b in corridor.bearings if b.stamp_ns < 20 * S),
    )
    assert finding(straight, "wheels").status is Status.FINE
    assert finding(straight, "sense").status is Status.UNCHECKED
    assert "turn of 30 deg" in finding(straight, "sense").fact
    backwards = wheels(straight, lambda t: replace(t, left=-t.left))
    assert finding(backwards, "wheels").fact == "one wheel counts backwards"
    assert "--push" in finding(backwards, "wheels").help


def test_a_robot_at_rest_leaves_all_signs_open(corridor: Told) -> None:
    first = corridor.ticks[0]
    still = wheels(corridor, lambda t: replace(t, left=first.left, right=first.right))
    one = replace(still, bearings=tuple(replace(corridor.bearings[0], stamp_ns=b.stamp_ns) for b in still.bearings))
    names = ("wheels", "sense", "turns", "offset")
    assert {finding(one, name).status for name in names} == {Status.UNCHECKED}


def test_a_sensor_of_bearings_that_sees_now_and_then_is_not_blamed_for_it(corridor: Told) -> None:
    """It tells one or two lines when it sees them, and nothing for seconds."""
    few = lines(corridor, lambda b: np.arange(b.size) < 2)
    now_and_then = replace(few, bearings=tuple(b for b in few.bearings if b.stamp_ns % (20 * S) < 10 * S))
    told = now_and_then.evidence
    stamps = Stream.recorded([b.stamp_ns for b in now_and_then.bearings])
    evidence = replace(told, seen=replace(told.seen, images=False, frames=stamps))
    found = Report.of(evidence, checked(evidence))
    assert found.first is None, found.first
    assert {"ring", "mirror", "picture", "spread", "wheels"} <= set(found.named(Status.UNCHECKED))


def test_a_camera_that_was_away_for_a_while_makes_it_worse(corridor: Told) -> None:
    away = replace(corridor, frames=tuple(f for f in corridor.frames if not 10 * S < f.stamp_ns < 20 * S))
    clock = finding(away, "clock")
    assert (clock.status, clock.help) == (Status.WORSE, "look at its cable")


def test_a_camera_whose_clock_alone_is_set_stops(corridor: Told) -> None:
    def after(message: Any) -> Any:
        return replace(message, stamp_ns=message.stamp_ns + (15 * S if message.stamp_ns > 30 * S else 0))

    alone = replace(corridor, frames=tuple(map(after, corridor.frames)), bearings=tuple(map(after, corridor.bearings)))
    clock = finding(alone, "clock")
    assert clock.status is Status.STOPS
    assert clock.fact.startswith("the camera's stamps jump by 15 s")


def test_wheel_counts_of_another_time_than_every_frame_leave_the_calibration_nothing(corridor: Told) -> None:
    late = [replace(t, stamp_ns=t.stamp_ns + 1000 * S) for t in corridor.ticks]
    looked = told(corridor.config, corridor.evidence.seen, late)
    assert looked is not None
    assert looked.state is State.NOT_YET


def test_a_silence_of_the_wheel_counts_at_rest_is_no_fault(corridor: Told) -> None:
    """Some boards send only when something has changed."""
    last: list[Ticks] = []
    for t in corridor.ticks:
        if not last or (t.left, t.right) != (last[-1].left, last[-1].right):
            last.append(t)
    still = replace(corridor.ticks[-1], stamp_ns=corridor.ticks[-1].stamp_ns + 3 * S)
    assert finding(replace(corridor, ticks=(*last, still)), "ticks").status is Status.FINE
