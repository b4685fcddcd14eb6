"""Which topics of a bag are meant: guessed where there is only one of a kind, else named by whoever imports it."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice

from omnivert.errors import DataError, UseError
from omnivert.formats.rosbag.file import Bag, Topic

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
SCANS = ("sensor_msgs/msg/LaserScan",)
ODOMETRIES = ("nav_msgs/msg/Odometry",)
JOINTS = ("sensor_msgs/msg/JointState",)
NUMBER = re.compile(r"std_msgs/msg/U?Int(8|16|32|64)")
_INTEGER = re.compile(r"u?int(8|16|32|64)")
_COUNTER = ("tick", "enc", "count", "wheel")  # what a name of a wheel's count has in it
_JOINT_OPTIONS = "--left-joint NAME --right-joint NAME"
_FIRST = 50  # messages of a topic that are asked for the names of its joints


@dataclass(frozen=True, slots=True)
class Named:
    """What was named on the command line; None: to be guessed."""

    image_topic: str | None = None
    odom_topic: str | None = None
    joint_topic: str | None = None
    left_joint: str | None = None
    right_joint: str | None = None
    ticks_topic: str | None = None
    left_topic: str | None = None
    right_topic: str | None = None
    scan_topic: str | None = None


@dataclass(frozen=True, slots=True)
class Odometry:
    """Poses or speeds of the robot."""

    topic: Topic

    @property
    def topics(self) -> tuple[Topic, ...]:
        return (self.topic,)


@dataclass(frozen=True, slots=True)
class Joints:
    """Angles of the two wheels."""

    topic: Topic
    left: str
    right: str

    @property
    def topics(self) -> tuple[Topic, ...]:
        return (self.topic,)


@dataclass(frozen=True, slots=True)
class Counts:
    """Two counts of encoders, in one message or each in a topic of its own."""

    left_topic: Topic
    left: str  # field
    right_topic: Topic
    right: str

    @property
    def topics(self) -> tuple[Topic, ...]:
        one = self.left_topic == self.right_topic
        return (self.left_topic,) if one else (self.left_topic, self.right_topic)


Wheels = Odometry | Joints | Counts


@dataclass(frozen=True, slots=True)
class Chosen:
    """
    notes  what was there as well, in words
    """

    image: Topic
    wheels: Wheels
    scan: Topic | None
    notes: tuple[str, ...]


def chosen(bag: Bag, named: Named) -> Chosen:
    """The streams of the bag that a recording is made of.

    raises  DataError when a kind is missing or there are several of it, UseError when a topic that was named is not
            there or is of another kind
    """
    notes: list[str] = []
    image = _only(bag, IMAGES, named.image_topic, "--image-topic", "image")
    wheels = _wheels(bag, named, notes)
    scans = _of(bag, SCANS)
    scan = None
    if named.scan_topic is not None or len(scans) == 1:
        scan = _only(bag, SCANS, named.scan_topic, "--scan-topic", "laser scan")
    elif scans:
        notes.append(f"no laser scans are taken, there are {_listed(scans)}; --scan-topic {scans[0].name} takes them")
    return Chosen(image, wheels, scan, tuple(notes))


def _wheels(bag: Bag, named: Named, notes: list[str]) -> Wheels:
    """What was named; else the first kind of which there is one, the rawest first."""
    told = {
        "--odom-topic": named.odom_topic,
        "--joint-topic": named.joint_topic or named.left_joint or named.right_joint,
        "--ticks-topic": named.ticks_topic,
        "--left-topic, --right-topic": named.left_topic or named.right_topic,
    }
    if len(ways := [option for option, name in told.items() if name is not None]) > 1:
        raise UseError("OV205", f"omnivert import rosbag: {' and '.join(ways)}", "the wheels come from one of them")
    if named.odom_topic is not None:
        return Odometry(_named(bag, ODOMETRIES, named.odom_topic, "--odom-topic"))
    if told["--joint-topic"] is not None:
        topic = _only(bag, JOINTS, named.joint_topic, "--joint-topic", "joint state")
        return _joints(bag, topic, named)
    if named.ticks_topic is not None:
        return _counts(_there(bag, named.ticks_topic, "--ticks-topic"))
    if named.left_topic is not None or named.right_topic is not None:
        return _two_counts(bag, named)
    found = _guesses(bag)
    if not found:
        raise _no_wheels(bag)
    if others := [text for text, _ in found[1:]] + _passed(bag, found[0][1]):
        notes.append(f"other wheels are there and not taken: {', '.join(others)}")
    return found[0][1]


def _guesses(bag: Bag) -> list[tuple[str, Wheels]]:
    """Each kind of which there is exactly one, in words and as it is."""
    found: list[tuple[str, Wheels]] = []  # rawest first
    messages = [topic for topic in _usable(bag) if not NUMBER.fullmatch(topic.type) and _field_pair(topic)]
    numbers = {topic.name: topic for topic in _usable(bag) if NUMBER.fullmatch(topic.type)}
    sides = pair(numbers, _COUNTER)
    if len(messages) == 1:
        found.append((str(messages[0]), _counts(messages[0])))
    if sides is not None:
        left, right = (numbers[name] for name in sides)
        found.append((f"{left} and {right}", Counts(left, "data", right, "data")))
    turning = [(topic, sides) for topic in _of(bag, JOINTS) if (sides := pair(_joint_names(bag, topic), ("wheel",)))]
    if len(turning) == 1:
        topic, (left_joint, right_joint) = turning[0]
        found.append((f"{topic}, --joint-topic {topic.name}", Joints(topic, left_joint, right_joint)))
    odometries = _of(bag, ODOMETRIES)
    if len(odometries) == 1:
        found.append((f"{odometries[0]}, --odom-topic {odometries[0].name}", Odometry(odometries[0])))
    return found


def _passed(bag: Bag, taken: Wheels) -> list[str]:
    """Odometries that are several, where the wheels come from something else."""
    several = _of(bag, ODOMETRIES)
    return [str(topic) for topic in several] if len(several) > 1 and not isinstance(taken, Odometry) else []


def _no_wheels(bag: Bag) -> DataError:
    """Which of the kinds there are several of, or that there is none."""
    several = _of(bag, ODOMETRIES)
    if several:
        return _several("odometry", several, f"--odom-topic {several[0].name}")
    joints = _of(bag, JOINTS)
    if joints:
        names = ", ".join(sorted({name for topic in joints for name in _joint_names(bag, topic)})) or "none"
        because = f"{_listed(joints)}: which joints are the two wheels? There are {names}"
        return DataError("OV332", f"{bag.path}: the wheels are not clear", because, _JOINT_OPTIONS)
    because = f"neither counts of both wheels, nor joint states, nor odometry; there are {_listed(bag.topics.values())}"
    help = "--ticks-topic NAME, or --left-topic NAME --right-topic NAME, where they are there by another name"
    return DataError("OV332", f"{bag.path} says nothing of its wheels", because, help)


def _joints(bag: Bag, topic: Topic, named: Named) -> Joints:
    names = _joint_names(bag, topic)
    for option, name in (("--left-joint", named.left_joint), ("--right-joint", named.right_joint)):
        if name is not None and name not in names:
            raise UseError("OV205", f"{option} {name}", f"the joints of {topic.name} are {', '.join(sorted(names))}")
    if named.left_joint is not None and named.right_joint is not None:
        return Joints(topic, named.left_joint, named.right_joint)
    guess = pair(names, ("wheel",))
    if guess is None:
        because = f"which of its joints are the wheels? There are {', '.join(sorted(names)) or 'none'}"
        raise DataError("OV332", f"{topic}: the wheels are not clear", because, _JOINT_OPTIONS)
    return Joints(topic, named.left_joint or guess[0], named.right_joint or guess[1])


def _counts(topic: Topic) -> Counts:
    sides = _field_pair(topic)
    if sides is None:
        whole = [name for name, kind in topic.fields.items() if _INTEGER.fullmatch(kind)]
        because = "a whole number for left and one for right are needed, with left and right in their names; "
        because += f"its whole numbers are {', '.join(whole) or 'none'}"
        raise DataError("OV332", f"{topic} is no pair of counts", because, "omnivert explain OV332")
    return Counts(topic, sides[0], topic, sides[1])


def _two_counts(bag: Bag, named: Named) -> Counts:
    if named.left_topic is None or named.right_topic is None:
        other = "--right-topic" if named.right_topic is None else "--left-topic"
        raise UseError("OV205", f"{other} is missing", "each wheel has a topic of its own", f"{other} NAME")
    sides = []
    for option, name in (("--left-topic", named.left_topic), ("--right-topic", named.right_topic)):
        topic = _there(bag, name, option)
        if not NUMBER.fullmatch(topic.type):
            raise UseError("OV332", f"{option} {name}", f"it is {topic.type}, no std_msgs/Int32 or the like")
        sides.append(topic)
    return Counts(sides[0], "data", sides[1], "data")


def _field_pair(topic: Topic) -> tuple[str, str] | None:
    return pair([name for name, kind in topic.fields.items() if _INTEGER.fullmatch(kind)], _COUNTER)


def _joint_names(bag: Bag, topic: Topic) -> set[str]:
    return {name for received in islice(bag.messages(topic), _FIRST) for name in received.content.name}


def pair(names: Iterable[str], telling: tuple[str, ...]) -> tuple[str, str] | None:
    """The one name that says left and the one that says right; None where there is none, or several.

    telling  where there are several, only names with one of these words in them count
    """
    every = list(names)
    said: Callable[[str], bool] = lambda name: any(word in name.lower() for word in telling)  # noqa: E731
    for some in (every, [name for name in every if said(name)]):
        left = [name for name in some if _side(name) == "left"]
        right = [name for name in some if _side(name) == "right"]
        if len(left) == len(right) == 1:
            return left[0], right[0]
    return None


def _side(name: str) -> str:
    """left, right, or neither; a single letter counts where it stands alone, as in wheel_l."""
    lower = name.lower()
    words = re.split("[^a-z]+", lower)
    left, right = "left" in lower or "l" in words, "right" in lower or "r" in words
    return "left" if left and not right else "right" if right and not left else ""


# ---------------------------------------------------------------- topics by name and by type


def _only(bag: Bag, types: tuple[str, ...], name: str | None, option: str, kind: str) -> Topic:
    if name is not None:
        return _named(bag, types, name, option)
    found = _of(bag, types)
    if not found:
        because = f"there are {_listed(bag.topics.values())}" if bag.topics else "it is empty"
        raise DataError("OV332", f"{bag.path} holds no {kind} topic", because, "omnivert explain OV332")
    if len(found) > 1:
        raise _several(kind, found, f"{option} {found[0].name}")
    return found[0]


def _several(kind: str, found: list[Topic], help: str) -> DataError:
    return DataError("OV332", f"there are {len(found)} {kind} topics", f"which one is meant: {_listed(found)}?", help)


def _named(bag: Bag, types: tuple[str, ...], name: str, option: str) -> Topic:
    topic = _there(bag, name, option)
    if topic.type not in types:
        wanted = " or ".join(kind.replace("/msg/", "/") for kind in types)
        raise UseError("OV332", f"{option} {name}", f"it is {topic.type.replace('/msg/', '/')}, not {wanted}")
    return topic


def _there(bag: Bag, name: str, option: str) -> Topic:
    topic = bag.topics.get(name) or bag.topics.get(f"/{name}")
    if topic is None:
        because = f"there is no such topic in {bag.path}; there are {_listed(bag.topics.values())}"
        raise UseError("OV332", f"{option} {name}", because)
    if not topic.known:
        because = f"the bag does not hold the definition of {topic.type}, or it cannot be read"
        raise DataError("OV332", f"{option} {name}", because, "record the bag again with ROS 2 Iron or later, as MCAP")
    if not topic.count:
        raise DataError("OV332", f"{option} {name}", "nothing was recorded on this topic", "omnivert explain OV332")
    return topic


def _usable(bag: Bag) -> list[Topic]:
    return [topic for topic in bag.topics.values() if topic.known and topic.count]


def _of(bag: Bag, types: tuple[str, ...]) -> list[Topic]:
    return [topic for topic in _usable(bag) if topic.type in types]


def _listed(topics: Iterable[Topic], most: int = 12) -> str:
    every = [str(topic) for topic in topics]
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return ", ".join(every[:most]) + more
