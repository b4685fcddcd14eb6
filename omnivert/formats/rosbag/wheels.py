"""What a bag says of the wheels -> cumulative counts of both, stamped.

Counts are taken as they are, angles and ways are counted finely enough that rounding is nothing.
"""

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import atan2, isfinite, pi, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.meta import METRE_WHEEL
from omnivert.formats.rosbag.file import Bag, Received, Topic
from omnivert.formats.rosbag.stamps import InOrder
from omnivert.formats.rosbag.topics import Counts, Joints, Odometry, Wheels
from omnivert.messages import Ticks

Stamps = NDArray[np.int64]
Values = NDArray[np.float64]
Row = tuple[float, ...]
Column = Callable[[Received], Row | None]  # what a message says; None: nothing
_FINE = 10_000_000  # ticks of a turn that an angle is counted in; 2 pi / 1e7 rad is 0.05 um of way at 0.15 m
_MOST = 2**53  # a count that Ticks can hold
_SIDEWAYS = 0.05  # share of the way that an odometry may go sideways before it is told
_WRAP_SLACK = 0.01  # rad beyond a whole turn at which an angle is still taken to be one that is wrapped


@dataclass(frozen=True, slots=True)
class Turned:
    """
    first, last  places of the first and the last message
    encoder      what of the rig is not as configured
    notes        what was made of the messages, in words
    """

    stamp_ns: Stamps  # (N,) rising, each once
    left: NDArray[np.int64]  # (N,)
    right: NDArray[np.int64]
    first: str
    last: str
    encoder: dict[str, Any]
    notes: tuple[str, ...]

    def ticks(self, shift_ns: int = 0) -> Iterator[Ticks]:
        for stamp, left, right in zip(self.stamp_ns.tolist(), self.left.tolist(), self.right.tolist(), strict=True):
            yield Ticks(stamp + shift_ns, left, right)


class _Series:
    """Numbers of a topic with their stamps; of several at one time the last one counts.

    place  of the newest message
    """

    def __init__(self) -> None:
        self.first = self.place = ""
        self._stamps, self._values, self._wide = array("q"), array("d"), 1

    def append(self, stamp_ns: int, row: Row, place: str) -> None:
        if self._stamps and self._stamps[-1] == stamp_ns:
            self._values[-self._wide :] = array("d", row)
        else:
            self._stamps.append(stamp_ns)
            self._values.extend(row)
        self._wide, self.first, self.place = len(row), self.first or place, place

    @property
    def stamp_ns(self) -> Stamps:
        """(N,)"""
        return np.frombuffer(self._stamps, dtype=np.int64)

    @property
    def columns(self) -> Values:
        """(K, N)"""
        return np.frombuffer(self._values).reshape(-1, self._wide).T


def turned(bag: Bag, wheels: Wheels, config: Config, bag_times: bool, step: Callable[[], None]) -> Turned:
    """The counts of both wheels.

    config     wheel base, wheel diameter and ticks of a turn, signs and width of the counters
    bag_times  stamp by the time of recording also what carries a stamp
    step       told each message
    raises     DataError naming topic and message
    """
    match wheels:
        case Odometry(topic):
            (robot,) = _series(bag, topic, [_motion], bag_times, step)
            return _of_odometry(robot, topic, config.robot.wheel_base_m)
        case Joints(topic, left, right):
            return _of_joints(_series(bag, topic, [_position(left), _position(right)], bag_times, step), wheels, config)
        case Counts(left_topic, left, right_topic, right) if left_topic == right_topic:
            series = _series(bag, left_topic, [_count(left), _count(right)], bag_times, step)
        case Counts(left_topic, left, right_topic, right):
            series = _series(bag, left_topic, [_count(left)], bag_times, step)
            series += _series(bag, right_topic, [_count(right)], bag_times, step)
    return _of_counts(series, wheels, config, bag_times)


def _series(
    bag: Bag, topic: Topic, columns: Sequence[Column], bag_times: bool, step: Callable[[], None]
) -> list[_Series]:
    """What each of the columns reads from the messages of a topic, which are read once."""
    order = InOrder(bag_times or not topic.stamped)
    series = [_Series() for _ in columns]
    for received in bag.messages(topic):
        step()
        for column, side in zip(columns, series, strict=True):
            if (row := column(received)) is not None:
                side.append(order.stamp_ns(received), row, received.place)
    if not all(side.place for side in series):
        raise DataError("OV333", f"{topic} has nothing of the wheels in it", "", "omnivert explain OV333")
    return series


def _finite(received: Received, name: str, *values: float) -> None:
    for value in values:
        if not isfinite(value):
            raise DataError("OV333", received.place, f"{name} = {value} is no finite number", "omnivert explain OV333")


# ---------------------------------------------------------------- poses and speeds


def _motion(received: Received) -> Row:
    """x, y, heading, speed forward, speed of turning, whether a heading is told; m, m, rad, m/s, rad/s."""
    pose, twist = received.content.pose.pose, received.content.twist.twist
    q, place = pose.orientation, pose.position
    yaw = atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)  # of any length
    _finite(received, "the pose", place.x, place.y, yaw)
    _finite(received, "the twist", twist.linear.x, twist.angular.z)
    told = float(any((q.w, q.x, q.y, q.z)))
    return float(place.x), float(place.y), yaw, float(twist.linear.x), float(twist.angular.z), told


def _of_odometry(series: _Series, topic: Topic, base: float) -> Turned:
    """Paper: wheels that are counted (eqs. 14, 15). Here, where only the pose is told: the wheels that go that way."""
    x, y, yaw, speed, turning, headed = series.columns
    notes = []
    moved, rated = bool(np.ptp(x) or np.ptp(y) or np.ptp(yaw)), bool(speed.any() or turning.any())
    posed = moved and bool(headed.all())
    if moved and not posed and not rated:
        because = "its orientation is zero: whoever sent it tells neither heading nor speed"
        raise DataError("OV333", f"{series.first} to {series.place}", because, "omnivert explain OV333")
    if posed or not rated:
        turn = np.remainder(np.diff(yaw) + pi, tau) - pi
        middle = yaw[:-1] + 0.5 * turn
        ahead = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)
        aside = np.diff(y) * np.cos(middle) - np.diff(x) * np.sin(middle)
        way = ahead / np.sinc(turn / tau)  # the arc over the chord
        total, off = float(np.abs(ahead).sum()), float(np.abs(aside).sum())
        if off > _SIDEWAYS * total and off > 0.1:
            notes.append(
                f"{topic.name} goes sideways by {off:.2g} m on {total:.3g} m of way, which two wheels cannot: its "
                "frame does not sit midway between the wheels, or it is no odometry of wheels"
            )
    else:
        since = np.diff(series.stamp_ns) / 1e9
        way, turn = (0.5 * (rate[1:] + rate[:-1]) * since for rate in (speed, turning))
    notes.insert(
        0,
        f"the ways of the wheels are worked out from the {'poses' if posed else 'speeds'} of {topic.name}, with "
        f"robot.wheel_base_m = {base:g}: as good as that odometry; ratio and base of the wheels stay as it has them",
    )
    ticks = METRE_WHEEL["ticks_per_rev"]
    with np.errstate(over="ignore"):  # such a count is refused below
        left, right = (
            np.rint(ticks * np.concatenate([[0.0], np.cumsum(way + side * 0.5 * base * turn)])) for side in (-1.0, 1.0)
        )
    encoder = {**METRE_WHEEL, "swap_sides": False, "left_sign": 1, "right_sign": 1}
    return _held(series.stamp_ns, left, right, series, encoder, notes)


# ---------------------------------------------------------------- angles


def _position(joint: str) -> Column:
    def position(received: Received) -> Row | None:
        names = received.content.name
        if joint not in names:
            return None  # of another part of the robot
        at = names.index(joint)
        if at >= len(received.content.position):
            because = f"joint {joint} has no position, only its speed at most"
            raise DataError("OV333", received.place, because, "--odom-topic NAME takes the wheels from an odometry")
        value = float(received.content.position[at])
        _finite(received, joint, value)
        return (value,)

    return position


def _of_joints(series: list[_Series], joints: Joints, config: Config) -> Turned:
    notes = [
        f"the ways of the wheels are the angles of {joints.left} and {joints.right} in {joints.topic.name} times half "
        f"of encoder.wheel_diameter_m = {config.encoder.wheel_diameter_m:g}"
    ]
    angles = []
    for side, name in zip(series, (joints.left, joints.right), strict=True):
        angle = side.columns[0]
        if _is_wrapped(angle):
            notes.append(f"{name} begins anew after a turn, and is counted on")
            angle = np.unwrap(angle)
        angles.append(angle * _FINE / tau)
    stamp_ns, left, right = _together(series, angles)
    signs = config.encoder.left_sign, config.encoder.right_sign
    encoder = {"ticks_per_rev": _FINE}
    return _held(stamp_ns, signs[0] * left, signs[1] * right, series[0], encoder, notes)


def _is_wrapped(angle: Values) -> bool:
    """Whether it jumps, and never leaves one turn."""
    low, high = float(angle.min()), float(angle.max())
    one_turn = any(low >= start - _WRAP_SLACK and high <= start + tau + _WRAP_SLACK for start in (-pi, 0.0))
    return one_turn and bool((np.abs(np.diff(angle)) > pi).any())


# ---------------------------------------------------------------- counts


def _count(name: str) -> Column:
    return lambda received: (float(getattr(received.content, name)),)


def _of_counts(series: list[_Series], counts: Counts, config: Config, bag_times: bool) -> Turned:
    encoder = config.encoder
    notes = []
    topics = (counts.left_topic, counts.right_topic)
    sides = []
    for side, topic, field in zip(series, topics, (counts.left, counts.right), strict=True):
        bits = min(int("".join(filter(str.isdigit, topic.fields[field]))), encoder.counter_bits)
        sides.append(_unrolled(side.columns[0], bits))
    if not bag_times and not all(topic.stamped for topic in topics):
        names = " and ".join(dict.fromkeys(topic.name for topic in topics if not topic.stamped))
        notes.append(f"{names}: messages of this type carry no stamp, so they are stamped by the time of recording")
    stamp_ns, left, right = _together(series, sides)
    left, right = encoder.left_sign * left, encoder.right_sign * right
    return _held(stamp_ns, left, right, series[0], {}, notes)


def _unrolled(raw: Values, bits: int) -> Values:
    """Counts that go on where a counter of so many bits began anew."""
    if bits > 53 or np.abs(raw).max() > _MOST:  # the width of what a float holds; such counters never begin anew
        return raw
    counted, half = raw.astype(np.int64), 1 << (bits - 1)
    steps = (np.diff(counted) + half) % (2 * half) - half
    return np.concatenate([counted[:1], counted[0] + np.cumsum(steps)]).astype(np.float64)


# ---------------------------------------------------------------- both wheels


def _together(series: list[_Series], values: list[Values]) -> tuple[Stamps, Values, Values]:
    """Both at the stamps of the left one: the right one is taken between its neighbours where it has others.

    raises  DataError when they have no time in common
    """
    left, right = series
    if np.array_equal(left.stamp_ns, right.stamp_ns):
        return left.stamp_ns, values[0], values[1]
    both = (left.stamp_ns >= right.stamp_ns[0]) & (left.stamp_ns <= right.stamp_ns[-1])
    if not both.any():
        because = f"it has no time in common with that of the other wheel ({right.first} to {right.place})"
        raise DataError("OV333", f"{left.first} to {left.place}", because, "omnivert explain OV333")
    stamps = left.stamp_ns[both]
    origin = right.stamp_ns[0]
    return stamps, values[0][both], np.interp(stamps - origin, right.stamp_ns - origin, values[1])


def _held(
    stamp_ns: Stamps,
    left: Values,
    right: Values,
    source: _Series,
    encoder: dict[str, Any],
    notes: list[str],
) -> Turned:
    """raises DataError when a count is too large to be one"""
    most = max(np.abs(left).max(), np.abs(right).max())
    if most > _MOST:
        because = f"the wheels count to {most:.3g}, which no wheel does"
        raise DataError("OV333", source.place, because, "omnivert explain OV333")
    whole = [np.rint(side).astype(np.int64) for side in (left, right)]
    return Turned(stamp_ns, whole[0], whole[1], source.first, source.place, encoder, tuple(notes))
