"""A recording with its results for other people's programs: a file for Foxglove, a bag of ROS."""

import heapq
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from omnivert.cli import say
from omnivert.cli.given import count
from omnivert.cli.settings import opened, rig_of, settings
from omnivert.errors import DataError
from omnivert.formats import origin
from omnivert.messages import Bearings, Estimate, Frame, Message, Scan, Ticks
from omnivert.pictures.words import amounts
from omnivert.wire.channels import BEARINGS, ESTIMATE, FRAME

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.wire.recording import Recording


def foxglove(recording: str, out: Path, config: Path | None = None, as_json: bool = False) -> None:
    """Sensors, lines and estimates as an MCAP file for Foxglove, and a layout beside it."""
    from omnivert.formats.extras import hold_installed

    hold_installed("foxglove", "foxglove", "a file for Foxglove")
    from omnivert.formats.foxglove.export import export_foxglove, layout_path

    source = opened(recording)
    rig = rig_of(source, settings(config))
    sensors = (message for _, message in source.messages(types=(Frame, Ticks, Scan)))
    merged = heapq.merge(sensors, _results(source, rig), key=lambda message: message.stamp_ns)
    written = export_foxglove(merged, rig, out, _laser(source))
    plan = layout_path(out)
    if as_json:
        say.json_result({"file": str(out), "layout": str(plan), "messages": dict(written)})
        return
    text = amounts(written)
    say.result(f"{out}  {out.stat().st_size / 1e6:.1f} MB · {text}")
    say.following(f"open {out} in Foxglove, and import {plan} as a layout there")


def rosbag(recording: str, out: Path, config: Path | None = None, as_json: bool = False) -> None:
    """Estimates as a bag: of ROS 1 where its name ends in .bag, else of ROS 2, a folder."""
    from omnivert.formats.extras import hold_installed

    hold_installed("rosbags", "ros", "writing a bag")
    from omnivert.formats.rosbag.export import export_rosbag

    source = opened(recording)
    rig = rig_of(source, settings(config))
    written = export_rosbag(_results(source, rig), rig.camera.id, out, _origin_ns(source))
    if as_json:
        say.json_result({"bag": str(out), "messages": dict(written)})
        return
    text = " · ".join(f"{number} on {topic}" for topic, number in written.items())
    say.result(f"{out}  {text or 'no messages: there is no estimate of the mount in this drive'}")
    if "/tf" not in written:
        say.note("nothing is on /tf: no estimate was usable or calibrated")


def _results(source: "Recording", config: "Config") -> Iterator[Message]:
    """Lines and estimates: those that were recorded; where there are none, those that the drive gives now."""
    from omnivert.offline import calibrated

    if count(source, ESTIMATE):
        yield from (message for _, message in source.messages(types=(Bearings, Estimate)))
        return
    frames = count(source, FRAME) or count(source, BEARINGS)
    with say.progress("calibrating", frames) as bar:
        for message in calibrated(source, config):
            if isinstance(message, Bearings):
                bar.step()
            yield message


def _origin_ns(source: "Recording") -> int:
    """The time of the bag that the recording came from at the recording's zero; else 0."""
    return origin.origin_ns(_attached(source, origin.ATTACHMENT))


def _laser(source: "Recording") -> tuple[float, float, float] | None:
    """x, y, heading of the laser in the robot's frame, where the folder that the recording came from told them."""
    try:
        told = json.loads(_attached(source, "meta.json"))["laser"]
        return float(told["x"]), float(told["y"]), float(told["yaw"])
    except (ValueError, KeyError, TypeError):
        return None


def _attached(source: "Recording", name: str) -> bytes:
    """An attachment; empty where there is none, or it is damaged."""
    try:
        return source.attachment(name) if name in source.attachments else b""
    except DataError:
        return b""
