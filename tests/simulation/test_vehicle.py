"""The robot in its room: wheels with the noise that was asked for, commands that grow stale, walls that stop it."""

from itertools import pairwise

import numpy as np
import pytest

from omnivert.config import Config
from omnivert.messages import Drive
from omnivert.odometry import after, arc
from omnivert.simulation.route import Route, commanded
from omnivert.simulation.steering import STALE_S, Steering
from omnivert.simulation.surfaces import Look, Panel, Round, surfaces
from omnivert.simulation.vehicle import BODY_M, SAMPLE_S, Vehicle, clearance

OPEN, _ = surfaces([], [])
NOWHERE = np.zeros((0, 2))


def vehicle(noise_k: float = 0.0, room: object = OPEN, seed: int = 1) -> Vehicle:
    return Vehicle(Config(), room, np.zeros(3), noise_k, seed)  # type: ignore[arg-type]


def test_without_noise_the_wheels_do_what_they_are_told_and_the_counts_say_so() -> None:
    route = Route.model_validate({"leg": [{"straight_m": 0.5}, {"turn_deg": -90.0}, {"arc_m": 1.0, "radius_m": 0.7}]})
    told = commanded(route, Config().robot.wheel_base_m, SAMPLE_S)
    robot = vehicle()
    for step in told:
        robot.step(step)
    turn = 1.0 / 0.7
    corner = np.array([0.5, 0.0, -np.pi / 2])
    end = after(corner, np.array([0.7 * np.sin(turn), 0.7 * (1.0 - np.cos(turn)), turn]))
    np.testing.assert_allclose(robot.pose, end, atol=1e-9)
    scale, base = Config().encoder.metres_per_tick, Config().robot.wheel_base_m
    heading = (robot.counts.right - robot.counts.left) * scale / base
    assert heading == pytest.approx(turn - np.pi / 2, abs=2.0 * scale / base)


def test_the_noise_of_each_wheel_has_variance_k_for_each_metre() -> None:
    k, runs = 2e-4, 200
    ends = []
    for seed in range(runs):
        robot = vehicle(k, seed=seed)
        for _ in range(10):
            robot.step(np.array([0.05, 0.05]))
        ends.append(robot.pose[2] * Config().robot.wheel_base_m)  # right - left, really
    assert np.mean(ends) == pytest.approx(0.0, abs=4.0 * np.sqrt(2.0 * k * 0.5 / runs))
    assert np.var(ends) == pytest.approx(2.0 * k * 0.5, rel=4.0 * np.sqrt(2.0 / runs))


def test_a_wall_stops_the_wheels_and_a_way_back_is_open() -> None:
    room, _ = surfaces([Panel((1.0, -2.0), (1.0, 2.0), 0.0, 2.0, Look(0.5))], [])
    robot = vehicle(room=room)
    for _ in range(200):
        robot.step(np.array([0.01, 0.01]))
    assert robot.blocked
    assert robot.pose[0] == pytest.approx(1.0 - BODY_M, abs=0.0101)
    counts = robot.counts
    robot.step(np.array([0.01, 0.01]))
    assert robot.counts == counts
    robot.step(np.array([-0.01, -0.01]))
    assert not robot.blocked
    assert robot.counts.left < counts.left


def test_the_clearance_is_to_what_is_nearest_on_the_floor() -> None:
    low, high = Panel((1.0, -1.0), (1.0, 1.0), 0.0, 2.0, Look(0.5)), Panel((0.3, -1.0), (0.3, 1.0), 1.0, 2.0, Look(0.5))
    room, _ = surfaces([low, high], [Round((-0.6, 0.0), 0.1, 0.0, 2.0, Look(0.5))])
    assert clearance(room, np.zeros(2)) == pytest.approx(0.5)
    assert clearance(room, np.array([0.9, 0.5])) == pytest.approx(0.1)
    assert clearance(room, np.array([1.0, 4.0])) == pytest.approx(3.0)


def test_a_command_drives_and_grows_stale() -> None:
    robot = vehicle()
    steering = Steering(robot, NOWHERE)
    steering.take(Drive(0, 0.2, 0.0), 0.0)
    times = np.arange(0.0, 3.0, SAMPLE_S)
    way = [0.0]
    for now in times:
        steering.step(float(now))
        way.append(float(robot.pose[0]))
    speed = np.diff(way) / SAMPLE_S
    assert speed.max() == pytest.approx(0.2, rel=1e-6)
    assert np.all(speed[times > STALE_S + 0.5] == 0.0)
    assert max(abs(after - before) for before, after in pairwise(speed)) < 0.011  # no wheel jumps


def test_a_turn_on_the_spot_leaves_the_robot_where_it_is() -> None:
    robot = vehicle()
    steering = Steering(robot, NOWHERE)
    for now in np.arange(0.0, 2.0, SAMPLE_S):
        steering.take(Drive(0, 0.0, 0.5), float(now))
        steering.step(float(now))
    assert np.hypot(*robot.pose[:2]) < 1e-9
    assert 0.8 < robot.pose[2] < 1.0


def test_the_first_command_ends_the_path() -> None:
    told = np.full((100, 2), 0.003)
    robot = vehicle()
    steering = Steering(robot, told)
    steering.step(0.0)
    assert steering.on_path
    assert robot.pose[0] == pytest.approx(0.003)
    steering.take(Drive(0, 0.0, 0.0), 0.0)
    for now in np.arange(0.0, 1.0, SAMPLE_S):
        steering.step(float(now))
    assert not steering.on_path
    assert robot.pose[0] == pytest.approx(0.003)
    np.testing.assert_allclose(arc(np.array([0.003]), np.array([0.003]), 0.4)[0], robot.pose)
