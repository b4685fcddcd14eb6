"""Knocks through the whole calibration, and drives from room to room: what the two studies make of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from omnivert.config import Config
from omnivert.simulation.recording import Knock, Scene, recorded
from omnivert.studies import knocks
from omnivert.studies.endurance import Room, endurance_figures, endurance_study, memory_mb, rooms_of
from omnivert.studies.knocks import Knocked, knock_figures, knock_study, knocked_of
from omnivert.studies.presets import KNOCKS, LONG, Case
from omnivert.studies.watched_charts import write_knocks, write_rooms

NOTICED = Knocked("1 mrad", 3, "yaw", 30.0, True, 0, 0.9, 1.0, 9.0, 0.3, True, 25.0, True)


def test_a_knock_is_driven_through_noticed_taken_back_and_calibrated_anew() -> None:
    run = knocked_of(KNOCKS[0], Config(), 3)
    assert (run.is_hit, run.false_alarms, run.kind) == (True, 0, "yaw")
    assert run.watched_s >= knocks.SETTLED_S
    assert run.noticed_s is not None
    assert 0.0 <= run.noticed_s <= 3.0
    assert run.told_off_s is not None
    assert abs(run.told_off_s) < 1.0
    assert run.best_chance is not None
    assert run.best_chance > 0.9
    assert run.superseded
    assert run.recalibrated_s is not None
    assert run.recalibrated_s > run.noticed_s
    assert run.honest


def test_a_knock_changes_nothing_that_came_before_it() -> None:
    """So the study may hit the camera after it has seen when it was first claimed."""
    scene = Scene(path="alternate")
    calm, hit = (recorded(replace(scene, knock=knock), Config(), 5) for knock in (None, Knock(20.0, yaw_rad=0.1)))
    for one, other in zip(calm.messages, hit.messages, strict=True):
        same = {name: getattr(one, name) for name in one.__slots__}
        if one.stamp_ns < 20e9:
            np.testing.assert_equal({name: getattr(other, name) for name in other.__slots__}, same)


def test_what_was_never_noticed_counts_as_late_and_what_never_could_be_does_not_count() -> None:
    missed = replace(NOTICED, noticed_s=None, told_off_s=None, superseded=False, recalibrated_s=None, honest=None)
    early = replace(missed, is_hit=False, false_alarms=1, best_chance=None)
    never = replace(missed, is_hit=False, best_chance=None)
    slow = replace(NOTICED, noticed_s=8.0, best_chance=0.3)
    figures = knock_figures([NOTICED, missed, slow, early, never])
    assert figures["knocks"] == 3
    assert figures["never_watched"] == figures["false_alarms"] == 1
    assert figures["noticed_within_3_s_share"] == pytest.approx(1 / 3)
    assert figures["best_within_3_s_share"] == pytest.approx((0.9 + 0.9 + 0.3) / 3)
    assert figures["noticed_by_next_turn_share"] == figures["noticed_by_turn_or_60_s_share"] == pytest.approx(2 / 3)
    assert figures["superseded_share"] == pytest.approx(2 / 3)
    assert figures["noticed_s"]["max"] == 8.0
    assert knock_figures([])["noticed_share"] is None


def test_the_next_turn_is_that_of_the_wheels() -> None:
    drive = recorded(Scene(path="alternate"), Config(), 1)
    right, left = np.diff(drive.sample_wheels_m, axis=0).T
    for since in (1.0, 7.0):  # on the first straight, and in the first turn
        ends = knocks._next_turn(drive, since)
        assert ends is not None
        straight = (right * left > 0.0) & (drive.sample_time_s[1:] > 10.0)
        assert since + ends == pytest.approx(drive.sample_time_s[1:][straight][0], abs=0.1)
    assert knocks._next_turn(drive, float(drive.sample_time_s[-1])) is None


def room(hours: float, memory: float, alarms: tuple[str, ...] = ()) -> Room:
    return Room("1 mrad", 1, hours, 100, alarms, 90, memory, 20.0, 9, 100.0 + memory, 300.0, 400)


def test_growth_is_told_of_what_comes_after_the_start_and_alarms_by_the_hour() -> None:
    hours = np.arange(1, 21) / 10.0
    grown = endurance_figures([room(h, 50.0 + (200.0 * h if h < 0.5 else 100.0 + 7.0 * h)) for h in hours.tolist()])
    assert grown["memory_growth_mb_per_h"] == pytest.approx(7.0)
    assert grown["solve_growth_ms_per_h"] == pytest.approx(7.0)
    assert grown["hours"] == 2.0
    flat = endurance_figures([room(h, 50.0, ("moved",) if h == 2.0 else ()) for h in hours.tolist()])
    assert flat["memory_growth_mb_per_h"] == 0.0
    assert flat["false_alarms_per_h"] == 0.5
    assert flat["calibrated_share"] == pytest.approx(0.9)
    assert endurance_figures([room(0.1, 1.0)])["memory_growth_mb_per_h"] is None


def test_a_robot_goes_from_room_to_room_and_stays_calibrated() -> None:
    case = Case("short", Scene(path="alternate", bearing_std_rad=0.001), 2e-4)
    rooms = list(rooms_of(case, Config(), 4, 0.02))
    assert len(rooms) == 2
    assert rooms[1].hours == pytest.approx(2.0 * rooms[0].hours, rel=0.01)
    assert rooms[1].calibrated_frames == rooms[1].frames > 100  # a new room takes nothing back
    assert not rooms[0].alarms + rooms[1].alarms
    assert 10.0 < rooms[1].memory_mb <= 1.5 * memory_mb()
    assert rooms[0].solves > 5


def test_every_target_is_a_figure_and_the_pictures_are_drawn(tmp_path: Path) -> None:
    runs = [replace(NOTICED, case=case.name, seed=k, kind=knocks.KINDS[k]) for case in KNOCKS for k in range(3)]
    study = knock_study(KNOCKS, runs)
    for case in KNOCKS:
        assert set(study["paths"][case.name]["targets_met"].values()) == {True}
    rooms = [replace(room(0.2 * k, 50.0), case=case.name) for case in LONG for k in range(1, 8)]
    for case in LONG:
        assert set(endurance_study(LONG, rooms)["paths"][case.name]["targets_met"].values()) == {True}
    write_knocks(tmp_path / "knocks.png", KNOCKS, runs)
    write_rooms(tmp_path / "rooms.png", LONG, rooms)
    assert all((tmp_path / name).read_bytes()[:4] == b"\x89PNG" for name in ("knocks.png", "rooms.png"))
