"""Wheels in a bag: counts, angles, poses and speeds all give the way that the wheels have gone."""

from collections.abc import Callable
from itertools import pairwise
from math import cos, pi, sin, tau
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.config import Config, with_rig
from omnivert.errors import DataError
from omnivert.formats.rosbag.drive import RosBag
from omnivert.formats.rosbag.topics import Named, pair
from omnivert.formats.rosbag.wheels import _unrolled
from omnivert.messages import Frame, Ticks
from tests.formats.bags import ANGLE_OF_A_TICK, ORIGIN_NS, RIG, BagMaker, small_drive

DRIVE = small_drive()
TICKS = [message for message in DRIVE if isinstance(message, Ticks)]
Ways = NDArray[np.float64]


def begun(folder: Path, form: str = "mcap") -> BagMaker:
    return BagMaker(folder / "drive", form)


def with_pictures(maker: BagMaker) -> None:
    for message in DRIVE:
        if isinstance(message, Frame):
            maker.image("/image", message, stamp_ns=message.stamp_ns + ORIGIN_NS)


def read(path: Path, config: Config = RIG, named: Named | None = None) -> tuple[RosBag, list[Ticks]]:
    bag = RosBag(path, config, named or Named(), False, None)
    return bag, [message for message in bag.messages() if isinstance(message, Ticks)]


def ways(bag: RosBag, ticks: list[Ticks]) -> Ways:
    """(N, 2) of the left and the right wheel since the first message, m."""
    counted = np.array([[t.left, t.right] for t in ticks], dtype=np.float64)
    moved: Ways = (counted - counted[0]) * bag.config.encoder.metres_per_tick
    return moved


COUNTED = np.array([[t.left, t.right] for t in TICKS], dtype=np.float64)
TRUE_WAYS: Ways = (COUNTED - COUNTED[0]) * RIG.encoder.metres_per_tick


def poses(base: float, wheel_ways: Ways) -> list[tuple[float, float, float]]:
    """Where the robot gets, by ten thousand short straight steps between two messages' ways."""
    x = y = yaw = 0.0
    found = [(x, y, yaw)]
    for left, right in np.diff(wheel_ways, axis=0):
        turn, ahead, n = (right - left) / base, 0.5 * (left + right), 400
        at = yaw + turn * (np.arange(n) + 0.5) / n
        x, y, yaw = x + ahead * np.cos(at).mean(), y + ahead * np.sin(at).mean(), yaw + turn
        found.append((float(x), float(y), float(yaw)))
    return found


# ---------------------------------------------------------------- counts


def test_two_topics_of_counts_give_both_at_the_times_of_the_left_one(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            at = ticks.stamp_ns + ORIGIN_NS
            maker.number("/left_wheel/ticks", at, ticks.left)
            maker.number("/right_wheel/ticks", at + 5_000_000, ticks.right)  # a quarter of an interval later
            maker.number("/battery", at, 12, kind="Int16")
    bag, found = read(maker.path)
    assert [t.stamp_ns for t in found] == [t.stamp_ns for t in TICKS[1:]]  # at the first the right one is not known
    assert [t.left for t in found] == [t.left for t in TICKS[1:]]
    expected = [before.right + round(0.75 * (now.right - before.right)) for before, now in pairwise(TICKS)]
    assert [t.right for t in found] == expected
    assert any("/left_wheel/ticks and /right_wheel/ticks: messages of this type carry no stamp" in n for n in bag.notes)


def test_signs_of_the_wheels_are_those_of_the_configuration(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            maker.counts("/wheels", Ticks(0, -ticks.left, ticks.right), ticks.stamp_ns + ORIGIN_NS)
    _, found = read(maker.path, with_rig(RIG, {"encoder": {"left_sign": -1}}, "test"))
    assert [(t.left, t.right) for t in found] == [(t.left, t.right) for t in TICKS]


@pytest.mark.parametrize(("kind", "bits", "configured"), [("Int16", 16, 32), ("UInt8", 8, 32), ("Int32", 12, 12)])
def test_counters_that_begin_anew_go_on(tmp_path: Path, kind: str, bits: int, configured: int) -> None:
    low = 0 if kind.startswith("U") else -(1 << (bits - 1))
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            for side, value in (("left", ticks.left), ("right", -ticks.right)):
                maker.number(f"/{side}_ticks", ticks.stamp_ns + ORIGIN_NS, (value - low) % (1 << bits) + low, kind)
    bag, found = read(maker.path, with_rig(RIG, {"encoder": {"counter_bits": configured}}, "test"))
    assert ways(bag, found) == pytest.approx(TRUE_WAYS * [1.0, -1.0], abs=1e-12)


@given(
    steps=st.lists(st.integers(-(2**15) + 1, 2**15 - 1), min_size=1, max_size=50),
    start=st.integers(-(2**15), 2**15 - 1),
)
def test_a_counter_of_16_bits_is_undone_exactly(steps: list[int], start: int) -> None:
    true = start + np.concatenate([[0], np.cumsum(steps)])
    rolled = (true + 2**15) % 2**16 - 2**15
    assert _unrolled(rolled.astype(np.float64), 16).tolist() == true.tolist()


# ---------------------------------------------------------------- angles


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("apart", [False, True])
def test_angles_of_joints_give_the_way_of_the_wheels(tmp_path: Path, wrapped: bool, apart: bool) -> None:
    """Among other joints, in one message or each in its own, with angles that go on or begin anew."""
    shown: Callable[[float], float] = (lambda angle: (angle + pi) % tau - pi) if wrapped else (lambda angle: angle)
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            at = ticks.stamp_ns + ORIGIN_NS
            left, right = (shown(float(count * ANGLE_OF_A_TICK)) for count in (3 * ticks.left, 3 * ticks.right))
            if apart:
                maker.joints("/joint_states", at, left_wheel_joint=left)
                maker.joints("/joint_states", at, right_wheel_joint=right, neck=0.1)
            else:
                maker.joints("/joint_states", at, left_elbow=1.0, right_wheel_joint=right, left_wheel_joint=left)
                maker.joints("/joint_states", at, gripper=0.5)
    bag, found = read(maker.path)
    assert ways(bag, found) == pytest.approx(3 * TRUE_WAYS, abs=1e-7)
    assert bag.config.encoder.wheel_diameter_m == RIG.encoder.wheel_diameter_m
    assert any("encoder.wheel_diameter_m = 0.2" in note for note in bag.notes)
    assert any("begins anew after a turn" in note for note in bag.notes) == wrapped


def test_joints_of_any_name_can_be_named(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for t in TICKS:
            maker.joints("/joints", t.stamp_ns + ORIGIN_NS, m0=t.left * ANGLE_OF_A_TICK, m1=t.right * ANGLE_OF_A_TICK)
    with pytest.raises(DataError, match="There are m0, m1") as refusal:
        read(maker.path)
    assert (refusal.value.code, refusal.value.help) == ("OV332", "--left-joint NAME --right-joint NAME")
    bag, found = read(maker.path, named=Named(left_joint="m0", right_joint="m1"))
    assert ways(bag, found) == pytest.approx(TRUE_WAYS, abs=1e-7)


# ---------------------------------------------------------------- odometry


@pytest.mark.parametrize("length", [1.0, 0.5, 2.0])
def test_poses_are_turned_into_the_ways_of_the_wheels(tmp_path: Path, length: float) -> None:
    drive = 200.0 * TRUE_WAYS  # several turns, so that the heading begins anew
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks, pose in zip(TICKS, poses(RIG.robot.wheel_base_m, drive), strict=True):
            maker.odometry("/odom", ticks.stamp_ns + ORIGIN_NS, pose, (9.0, 9.0), length)
    bag, found = read(maker.path)
    assert ways(bag, found) == pytest.approx(drive, abs=2e-4)  # of 120 m: the short steps are chords, too
    (note,) = [note for note in bag.notes if "worked out from the poses of /odom" in note]
    assert "robot.wheel_base_m = 0.5" in note
    assert (bag.config.encoder.left_sign, bag.config.encoder.right_sign) == (1, 1)


@pytest.mark.parametrize(("step", "length"), [(0.0, 1.0), (0.0, 0.0), (0.1, 0.0)], ids=["still", "none", "no heading"])
def test_speeds_are_taken_where_the_pose_stands_still_or_has_no_heading(
    tmp_path: Path, step: float, length: float
) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            seconds = ticks.stamp_ns / 1e9
            pose, twist = (step * seconds, 0.0, 0.0), (0.3 + 0.1 * seconds, 0.8)
            maker.odometry("/odom", ticks.stamp_ns + ORIGIN_NS, pose, twist, length)
    bag, found = read(maker.path)
    since = np.array([t.stamp_ns / 1e9 for t in found]) - found[0].stamp_ns / 1e9
    way = 0.3 * since + 0.05 * since**2
    turned = 0.8 * since * 0.5 * RIG.robot.wheel_base_m
    assert ways(bag, found) == pytest.approx(np.stack([way - turned, way + turned], axis=1), abs=1e-6)
    assert any("worked out from the speeds of /odom" in note for note in bag.notes)


def test_an_odometry_that_goes_sideways_is_told(tmp_path: Path) -> None:
    """Of a frame half a metre before the axle: each turn carries it sideways."""
    told = []
    for name, ahead in (("axle", 0.0), ("nose", 0.5)):
        with BagMaker(tmp_path / name, "mcap") as maker:
            with_pictures(maker)
            for ticks in TICKS:
                yaw = 0.8 * ticks.stamp_ns / 1e9
                place = 0.3 * sin(yaw) + ahead * cos(yaw), -0.3 * cos(yaw) + ahead * sin(yaw)
                maker.odometry("/odom", ticks.stamp_ns + ORIGIN_NS, (*place, yaw))
        told.append(any("goes sideways" in note for note in read(maker.path)[0].notes))
    assert told == [False, True]


def test_a_standing_robot_has_wheels_that_stand(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS:
            maker.odometry("/odom", ticks.stamp_ns + ORIGIN_NS, (1.0, 2.0, 3.0))
    bag, found = read(maker.path)
    assert not ways(bag, found).any()


# ---------------------------------------------------------------- which of them


def test_the_rawest_wheels_are_taken_and_the_others_said(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for t in TICKS:
            at = t.stamp_ns + ORIGIN_NS
            maker.odometry("/odom", at, (0.0, 0.0, 0.0))
            maker.joints("/joint_states", at, wheel_l=t.left * ANGLE_OF_A_TICK, wheel_r=t.right * ANGLE_OF_A_TICK)
    bag, _ = read(maker.path)
    notes = " ".join(bag.notes)
    assert "the wheels are taken from /joint_states" in notes
    assert "other wheels are there and not taken: /odom (nav_msgs/Odometry, 101 messages), --odom-topic /odom" in notes
    assert any("worked out from" in note for note in read(maker.path, named=Named(odom_topic="/odom"))[0].notes)


def test_wheels_that_a_calibration_will_not_believe_are_told(tmp_path: Path) -> None:
    with begun(tmp_path) as maker:
        with_pictures(maker)
        for ticks in TICKS[::50]:
            maker.counts("/wheels", ticks, ticks.stamp_ns + ORIGIN_NS)
    (note,) = [note for note in read(maker.path)[0].notes if "silent while the wheels turned" in note]
    assert note.startswith("the wheels: ")
    assert "up to 1 s apart" in note


@pytest.mark.parametrize(
    ("names", "sides"),
    [
        (("left_wheel_joint", "right_wheel_joint"), ("left_wheel_joint", "right_wheel_joint")),
        (("wheel_right", "wheel_left", "head"), ("wheel_left", "wheel_right")),
        (("WheelL", "WheelR"), None),
        (("wheel_l", "wheel_r"), ("wheel_l", "wheel_r")),
        (("left_arm", "right_arm", "wheel_left", "wheel_right"), ("wheel_left", "wheel_right")),
        (("front_left_wheel", "rear_left_wheel", "front_right_wheel", "rear_right_wheel"), None),
        (("left_encoder", "right_encoder", "left_pwm", "right_pwm"), ("left_encoder", "right_encoder")),
        (("left",), None),
        (("left_or_right",), None),
        ((), None),
    ],
)
def test_left_and_right_are_read_from_names(names: tuple[str, ...], sides: tuple[str, str] | None) -> None:
    assert pair(names, ("wheel", "enc")) == sides
