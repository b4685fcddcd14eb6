"""A robot is pushed straight and turned left; each wrong sign is told by itself."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from omnivert.angles import wrap
from omnivert.config import Config, parsed
from omnivert.doctor.about_signs import sense, wheels
from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, Status
from omnivert.doctor.host import this_host
from omnivert.doctor.pushed import Push, Pushed, Stage
from omnivert.messages import Bearings, Ticks

S = 10**9
CONFIG = Config()
STEP_S = 0.05


def motion(turn_rad: float = 1.5) -> list[tuple[float, float]]:
    """(speed m/s, turn rad/s) every 50 ms: rest, a metre ahead, rest, a turn, rest."""
    part = round(2.0 / STEP_S)
    rest = [(0.0, 0.0)] * part
    return [*rest, *([(0.5, 0.0)] * part), *rest, *([(0.0, 0.5 * turn_rad)] * part), *rest]


def messages(
    right: float = 1.0, left: float = 1.0, swapped: bool = False, bearing: float = 1.0, turn_rad: float = 1.5
) -> Iterator[Bearings | Ticks]:
    """What wheels (factors on their counts) and picture (sense of its bearings) tell of a push."""
    way = heading = 0.0
    at = np.linspace(-3.0, 3.0, 9)
    for k, (speed, rate) in enumerate(motion(turn_rad)):
        way, heading = way + STEP_S * speed, heading + STEP_S * rate
        half = 0.5 * CONFIG.robot.wheel_base_m * heading
        told = ((way - half), (way + half)) if swapped else ((way + half), (way - half))
        counts = [round(m * f / CONFIG.encoder.metres_per_tick) for m, f in zip(told, (right, left), strict=True)]
        stamp = round(k * STEP_S * S)
        seen = np.asarray(wrap(bearing * (at - heading)))
        rest = np.full(9, 1e-3), np.full(9, 3, np.int32), np.full(9, 0.5, np.float32)
        yield Bearings(stamp, np.arange(9), seen, *rest)
        yield Ticks(stamp, left=counts[1], right=counts[0])


def pushed(
    right: float = 1.0, left: float = 1.0, swapped: bool = False, bearing: float = 1.0, turn_rad: float = 1.5
) -> Push:
    """The stepper that has taken them all."""
    push = Push(CONFIG)
    for message in messages(right, left, swapped, bearing, turn_rad):
        push.step(message)
    return push


def judged(told: Pushed | None, config: Config = CONFIG) -> tuple[Finding, Finding]:
    evidence = Evidence(config, "robot.toml", True, False, this_host(), pushed=told)
    return wheels(evidence), sense(evidence)


def test_a_robot_that_is_wired_right_is_found_right() -> None:
    push = pushed()
    assert push.stage is Stage.DONE
    told = push.pushed
    assert told is not None
    assert told.turn is not None
    assert told.straight.right_m == pytest.approx(1.0, abs=0.01)
    assert told.straight.picture_rad == pytest.approx(0.0, abs=0.01)
    assert told.turn.picture_rad == pytest.approx(1.5, abs=0.01)
    assert [finding.status for finding in judged(told)] == [Status.FINE, Status.FINE]


@pytest.mark.parametrize(
    ("right", "left", "help"),
    [
        (-1.0, 1.0, "encoder.right_sign = -1"),
        (1.0, -1.0, "encoder.left_sign = -1"),
        (-1.0, -1.0, "encoder.right_sign = -1 and encoder.left_sign = -1"),
        (0.0, 1.0, "look at the right encoder's plug"),
    ],
)
def test_a_wheel_that_does_not_count_forward_is_named(right: float, left: float, help: str) -> None:
    found, _ = judged(pushed(right, left).pushed)
    assert (found.status, found.help) == (Status.STOPS, help)


def test_a_sign_that_is_minus_already_is_turned_back() -> None:
    config = parsed({"encoder": {"left_sign": -1}}, "the test")
    assert judged(pushed(left=-1.0).pushed, config)[0].help == "encoder.left_sign = 1"


def test_swapped_sides_and_a_wrong_sense_are_told_apart() -> None:
    sides, mirrored = judged(pushed(swapped=True).pushed)[1], judged(pushed(bearing=-1.0).pushed)[1]
    assert (sides.status, sides.reason) == (Status.STOPS, "the wheels' sides are swapped")
    assert (mirrored.status, mirrored.help) == (Status.STOPS, "camera.bearing_sign = -1")


def test_a_turn_to_the_right_is_right_when_both_say_so() -> None:
    found = judged(pushed(turn_rad=-1.5).pushed)[1]
    assert found.status is Status.FINE
    assert "turned right" in found.fact


def test_nothing_is_said_before_the_push_and_of_a_turn_that_did_not_come() -> None:
    assert Push(CONFIG).pushed is None
    whole = pushed().pushed
    assert whole is not None
    straight, turn = judged(replace(whole, turn=None))
    assert (straight.status, turn.status) == (Status.FINE, Status.UNCHECKED)


def test_small_movements_are_passed_over() -> None:
    push = Push(CONFIG)
    for k in range(400):
        counts = 200 * (k // 100)  # a few centimetres, then rest, again and again
        push.step(Ticks(round(k * STEP_S * S), left=counts, right=counts))
    assert push.stage is Stage.STRAIGHT
