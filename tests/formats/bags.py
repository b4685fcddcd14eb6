"""Bags as ROS would have recorded them, written by the library's own writers."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count
from math import tau
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from omnivert.config import Config, with_rig
from omnivert.messages import Frame, Message, PixelFormat, Scan, Ticks

FORMS = ("ros1", "sqlite3", "mcap")
ORIGIN_NS = 1_700_000_000 * 10**9  # a clock that counts from 1970
TICKS_MSG = "std_msgs/Header header\nint64 left_ticks\nint64 right_ticks\nuint8 status"
SUFFIX = {"ros1": ".bag", "sqlite3": "", "mcap": ""}


@dataclass
class BagMaker:
    """Writes a bag message by message.

    form  ros1, sqlite3 or mcap
    """

    path: Path
    form: str
    custom: dict[str, str] = field(default_factory=lambda: {"robot_msgs/msg/WheelTicks": TICKS_MSG})

    def __post_init__(self) -> None:
        ros1 = self.form == "ros1"
        plugin = StoragePlugin.SQLITE3 if self.form == "sqlite3" else StoragePlugin.MCAP
        self.store: Typestore = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
        for name, text in self.custom.items():
            self.store.register(get_types_from_msg(text, name))
        self._writer: Any = Writer1(self.path) if ros1 else Writer2(self.path, version=9, storage_plugin=plugin)
        self._connections: dict[str, Any] = {}
        self._sequence = count()

    def __enter__(self) -> "BagMaker":
        self._writer.open()
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.close()

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind.replace("/", "/msg/")](**fields)

    def header(self, stamp_ns: int, frame: str = "base_link") -> Any:
        stamp = self.make("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        more = {"seq": next(self._sequence)} if self.form == "ros1" else {}
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame, **more)

    def write(self, topic: str, bag_ns: int, kind: str, **fields: Any) -> None:
        self.write_bytes(topic, bag_ns, kind, self.serialized(kind, **fields))

    def serialized(self, kind: str, **fields: Any) -> bytes:
        serialize = self.store.serialize_ros1 if self.form == "ros1" else self.store.serialize_cdr
        return bytes(serialize(self.make(kind, **fields), kind.replace("/", "/msg/")))

    def write_bytes(self, topic: str, bag_ns: int, kind: str, data: bytes) -> None:
        self.connect(topic, kind)
        self._writer.write(self._connections[topic], bag_ns, data)

    def connect(self, topic: str, kind: str) -> None:
        if topic not in self._connections:
            name = kind.replace("/", "/msg/")
            self._connections[topic] = self._writer.add_connection(topic, name, typestore=self.store)

    # ------------------------------------------------------------ what sensors say

    def image(self, topic: str, frame: Frame, bag_ns: int | None = None, stamp_ns: int | None = None) -> None:
        """A raw frame as Image, a file as CompressedImage."""
        stamp = frame.stamp_ns if stamp_ns is None else stamp_ns
        bag = stamp if bag_ns is None else bag_ns
        if frame.format in (PixelFormat.JPEG, PixelFormat.PNG):
            said = {"format": str(frame.format), "data": frame.data}
            self.write(topic, bag, "sensor_msgs/CompressedImage", header=self.header(stamp), **said)
            return
        encoding, planes = ("mono8", 1) if frame.format is PixelFormat.GREY8 else ("bgr8", 3)
        self.pixels(topic, bag, stamp, frame.width_px, frame.height_px, encoding, frame.width_px * planes, frame.data)

    def pixels(
        self,
        topic: str,
        bag: int,
        stamp: int,
        width: int,
        height: int,
        encoding: str,
        step: int,
        data: Any,
        **more: int,
    ) -> None:
        size = {"width": width, "height": height, "step": step}
        said = {"encoding": encoding, "is_bigendian": 0, "data": data, **size, **more}
        self.write(topic, bag, "sensor_msgs/Image", header=self.header(stamp), **said)

    def scan(self, topic: str, scan: Scan, stamp_ns: int | None = None) -> None:
        stamp = scan.stamp_ns if stamp_ns is None else stamp_ns
        angles = {"angle_min": scan.angle_min_rad, "angle_max": 0.0, "angle_increment": scan.angle_increment_rad}
        rest = {"time_increment": 0.0, "scan_time": 0.0, "range_min": 0.05, "range_max": 30.0}
        ranges = np.where(scan.range_m == 0.0, np.float32(np.inf), scan.range_m)
        said = {**angles, **rest, "ranges": ranges, "intensities": np.zeros(0, np.float32)}
        self.write(topic, stamp, "sensor_msgs/LaserScan", header=self.header(stamp), **said)

    def counts(self, topic: str, ticks: Ticks, stamp_ns: int, bag_ns: int | None = None) -> None:
        said = {"left_ticks": ticks.left, "right_ticks": ticks.right, "status": 0}
        self.write(
            topic, stamp_ns if bag_ns is None else bag_ns, "robot_msgs/WheelTicks", header=self.header(stamp_ns), **said
        )

    def number(self, topic: str, bag_ns: int, value: int, kind: str = "Int32") -> None:
        self.write(topic, bag_ns, f"std_msgs/{kind}", data=value)

    def joints(self, topic: str, stamp_ns: int, **angles: float) -> None:
        position, nothing = np.array(list(angles.values())), np.zeros(0)
        said = {"name": list(angles), "position": position, "velocity": nothing, "effort": nothing}
        self.write(topic, stamp_ns, "sensor_msgs/JointState", header=self.header(stamp_ns), **said)

    def odometry(
        self,
        topic: str,
        stamp_ns: int,
        pose: tuple[float, float, float],
        twist: tuple[float, float] = (0.0, 0.0),
        length: float = 1.0,  # of the quaternion
    ) -> None:
        x, y, yaw = pose
        vector: Callable[..., Any] = lambda *xyz: self.make(  # noqa: E731
            "geometry_msgs/Vector3", x=xyz[0], y=xyz[1], z=xyz[2]
        )
        q = self.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=length * np.sin(yaw / 2), w=length * np.cos(yaw / 2))
        point = self.make("geometry_msgs/Point", x=x, y=y, z=0.0)
        covariance = np.zeros(36)
        there = self.make("geometry_msgs/Pose", position=point, orientation=q)
        speed = self.make("geometry_msgs/Twist", linear=vector(twist[0], 0.0, 0.0), angular=vector(0.0, 0.0, twist[1]))
        said = {
            "child_frame_id": "base_link",
            "pose": self.make("geometry_msgs/PoseWithCovariance", pose=there, covariance=covariance),
            "twist": self.make("geometry_msgs/TwistWithCovariance", twist=speed, covariance=covariance),
        }
        self.write(topic, stamp_ns, "nav_msgs/Odometry", header=self.header(stamp_ns, "odom"), **said)

    def drive(self, messages: Iterable[Message], late_ns: int = 0) -> None:
        """Pictures, counts in a message of the robot's own, and scans; pictures are recorded that much late."""
        for message in messages:
            at = message.stamp_ns + ORIGIN_NS
            match message:
                case Frame():
                    self.image("/camera/image_raw", message, at + late_ns, at)
                case Ticks():
                    self.counts("/wheels", message, at)
                case Scan():
                    self.scan("/scan", message, at)


RIG = with_rig(
    Config(),
    {
        "robot": {"id": "r7", "wheel_base_m": 0.5},
        "encoder": {"wheel_diameter_m": 0.2, "ticks_per_rev": 4096},
        "camera": {"width_px": 64, "height_px": 48, "frame_rate_hz": 10.0},
        "ring": {"center_px": [31.0, 24.0], "r_min_px": 6.0, "r_max_px": 23.0},
    },
    "test",
)


SWEEP = -1.5, 0.03125  # numbers that ROS's 32 bits hold exactly
ANGLE_OF_A_TICK = tau / RIG.encoder.ticks_per_rev


def small_drive() -> list[Message]:
    """Two seconds: 20 pictures (png), counts at 50 Hz on an arc, a scan each quarter of a second."""
    return sorted(_small_drive(), key=lambda message: message.stamp_ns)


def _small_drive() -> Iterator[Message]:
    random = np.random.default_rng(5)
    for k in range(20):
        grey = random.integers(0, 256, (48, 64), dtype=np.uint8)
        data = cv2.imencode(".png", grey)[1].reshape(-1)
        yield Frame(31_234_567 + k * 100_000_000, PixelFormat.PNG, 64, 48, data)
    for k in range(101):
        yield Ticks(7 + k * 20_000_000, 60 * k, 75 * k)
    for k in range(8):
        range_m = random.uniform(0.1, 20.0, 90).astype(np.float32)
        range_m[k] = 0.0
        yield Scan(100_000_001 + k * 250_000_000, *SWEEP, range_m)
