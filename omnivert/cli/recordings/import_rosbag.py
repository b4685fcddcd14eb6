"""`omnivert import rosbag BAG -o OUT.mcap`: a bag of ROS 1 or ROS 2 becomes a recording, without ROS."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli.recordings.imported import imported
from omnivert.cli.settings import ConfigOption, JsonOption

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.formats.rosbag.drive import RosBag
    from omnivert.formats.written import Progress

_NO_RIG = (
    "a bag does not tell wheel base, wheels, ring and bearing sign, so they are those of the defaults, and a wrong one "
    "gives a wrong mount: give yours with --config robot.toml"
)

Topic = str | None


def rosbag(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="A .bag file, or a folder, .db3 or .mcap of ROS 2.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="Recording to write.")],
    config: ConfigOption = None,
    image_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="Pictures: an Image or CompressedImage.")] = None,
    ticks_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="Wheels as counts: both in one message.")] = None,
    left_topic: Annotated[
        Topic, typer.Option(metavar="TOPIC", help="Wheels as counts: the left one, such as an Int32.")
    ] = None,
    right_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="The right one.")] = None,
    joint_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="Wheels as angles: a JointState.")] = None,
    left_joint: Annotated[Topic, typer.Option(metavar="NAME", help="The left wheel in it.")] = None,
    right_joint: Annotated[Topic, typer.Option(metavar="NAME", help="The right wheel in it.")] = None,
    odom_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="Wheels worked out from an Odometry.")] = None,
    scan_topic: Annotated[Topic, typer.Option(metavar="TOPIC", help="Laser scans: a LaserScan.")] = None,
    bag_times: Annotated[
        bool, typer.Option("--bag-times", help="Stamp by the time of recording, not by the messages' own stamps.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """A bag of ROS 1 or ROS 2 -> a recording, without ROS. Nothing half-written is left.

    Topics are guessed where there is only one of a kind. No bag has wheel base, wheels and ring: give --config.
    """
    from omnivert.formats.extras import hold_installed

    hold_installed("rosbags", "ros", "reading a bag")
    from omnivert.formats.rosbag.import_ import import_rosbag
    from omnivert.formats.rosbag.topics import Named

    named = Named(
        image_topic=image_topic,
        ticks_topic=ticks_topic,
        left_topic=left_topic,
        right_topic=right_topic,
        joint_topic=joint_topic,
        left_joint=left_joint,
        right_joint=right_joint,
        odom_topic=odom_topic,
        scan_topic=scan_topic,
    )

    def read(path: Path, out: Path, base: "Config", progress: "Progress") -> "RosBag":
        return import_rosbag(path, out, base, named, bag_times, progress)

    imported(read, bag, output, config, as_json, *(() if config is not None else (_NO_RIG,)))
