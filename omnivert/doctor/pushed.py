"""A person pushes the robot: straight forward, a rest, a turn to the left. So each sign is told by itself."""

from dataclasses import dataclass
from enum import StrEnum

from omnivert.config import Config
from omnivert.doctor.turning import turns_seen
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND

REST_S = 1.0  # so long stands who has finished a movement
REST_M = 0.004  # what a wheel may move meanwhile
ENOUGH_M = 0.3  # of one wheel, for the straight way
ENOUGH_RAD = 0.5  # of one wheel against the other, or together: a reversed one makes a straight way of a turn


class Stage(StrEnum):
    STRAIGHT = "straight"
    TURN = "turn"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Movement:
    """From one rest to the next.

    right_m, left_m  what each wheel tells, positive forward
    picture_rad      the turn that the picture shows, counter-clockwise where bearing_sign is right
    """

    right_m: float
    left_m: float
    picture_rad: float


@dataclass(frozen=True, slots=True)
class Pushed:
    straight: Movement
    turn: Movement | None  # None: it did not come


class Push:
    """A stepper: waits for the two movements. Smaller ones, and what follows, are passed over."""

    def __init__(self, config: Config) -> None:
        self._scale = config.encoder.metres_per_tick
        self._base = config.robot.wheel_base_m
        self._done: list[tuple[Ticks, Ticks]] = []  # where each movement began and ended
        self._rest: Ticks | None = None  # where it stood last
        self._still: Ticks | None = None  # since when it has not moved
        self._bearings: list[Bearings] = []

    @property
    def stage(self) -> Stage:
        return (Stage.STRAIGHT, Stage.TURN, Stage.DONE)[len(self._done)]

    @property
    def pushed(self) -> Pushed | None:
        """What has come so far; None before the straight way."""
        if not self._done:
            return None
        turns = turns_seen(sorted(self._bearings, key=lambda frame: frame.stamp_ns))  # they come later than the counts
        straight, *turn = (
            Movement(*self._ways(since, until), turns.between(1e-9 * since.stamp_ns, 1e-9 * until.stamp_ns))
            for since, until in self._done
        )
        return Pushed(straight, turn[0] if turn else None)

    def step(self, message: Ticks | Bearings) -> None:
        if isinstance(message, Bearings):
            self._bearings.append(message)
        elif self.stage is not Stage.DONE:
            self._move(message)

    def _move(self, ticks: Ticks) -> None:
        if self._rest is None or self._still is None:
            self._rest = self._still = ticks
            return
        if max(map(abs, self._ways(self._still, ticks))) > REST_M:
            self._still = ticks
            return
        if ticks.stamp_ns - self._still.stamp_ns < REST_S * SECOND:
            return
        right, left = self._ways(self._rest, ticks)
        if self._is_enough(right, left):
            self._done.append((self._rest, ticks))
            self._rest = ticks
        elif max(abs(right), abs(left)) <= REST_M:
            self._rest = ticks

    def _ways(self, since: Ticks, until: Ticks) -> tuple[float, float]:
        """Right and left; m."""
        return (until.right - since.right) * self._scale, (until.left - since.left) * self._scale

    def _is_enough(self, right: float, left: float) -> bool:
        if self.stage is Stage.STRAIGHT:
            return max(abs(right), abs(left)) >= ENOUGH_M
        return max(abs(right - left), abs(right + left)) / self._base >= ENOUGH_RAD
