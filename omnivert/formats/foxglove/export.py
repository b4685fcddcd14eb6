"""Sensors and results -> an MCAP file for Foxglove, with a layout beside it."""

from collections import Counter
from collections.abc import Iterable
from math import cos, inf, sin
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.exported_file import appearing
from omnivert.formats.extrinsics_export import robot_from_camera
from omnivert.formats.foxglove import series as series
from omnivert.formats.foxglove.file import FoxgloveFile, layout
from omnivert.formats.foxglove.lines import drawn
from omnivert.messages import Bearings, Estimate, Frame, Message, PixelFormat, Scan, State, Ticks

_TRUSTED = (State.USABLE, State.CALIBRATED)
_ROBOT, _LASER = "base_link", "laser"


def layout_path(out: Path) -> Path:
    """Where the layout of an exported file goes."""
    return out.with_name(f"{out.stem}.layout.json")


def export_foxglove(
    messages: Iterable[Message], config: Config, out: Path, laser: tuple[float, float, float] | None = None
) -> Counter[str]:
    """Writes `out`, and a layout beside it that can be imported in Foxglove.

    messages  by stamp, as well as may be
    config    with the rig of the recording in it
    laser     x, y (m) and heading (rad) of the laser in the robot's frame, where they are known
    returns   messages written, by type
    raises    UseError when one of the files is there already, DataError when they cannot be written
    """
    written: Counter[str] = Counter()
    topics = _Topics(config)
    with appearing(layout_path(out)) as plan, appearing(out) as place, FoxgloveFile(place) as file:
        for message in messages:
            match message:
                case Frame():
                    topics.raw |= message.format in (PixelFormat.GREY8, PixelFormat.BGR8)
                    file.image(topics.image, message)
                case Bearings():
                    circles, strokes = drawn(message, config.camera.bearing_sign, config.ring.r_min_px)
                    file.annotations(topics.lines, message.stamp_ns, circles, strokes)
                    file.series(topics.bearings, message.stamp_ns, series.BEARINGS, series.of_bearings(message))
                case Estimate():
                    file.series(topics.estimate, message.stamp_ns, series.ESTIMATE, series.of_estimate(message))
                    _place_camera(file, message, config.camera.id)
                case Scan():
                    _sweep(file, topics.scan, message)
                case Ticks():
                    values = series.of_ticks(message, config.encoder)
                    file.series(topics.ticks, message.stamp_ns, series.TICKS, values)
                case _:
                    continue
            if laser is not None and not written:
                x, y, yaw = laser
                _link(file, message.stamp_ns, _LASER, (x, y, yaw))
            written[type(message).__name__] += 1
        if not written:
            what, because = f"there is nothing to put into {out}", "the recording holds no sensor and no result"
            raise DataError("OV303", what, because, "omnivert explain OV303")
        plan.write_text(layout(topics.shown, topics.lines, topics.estimate), encoding="utf-8")
    return written


class _Topics:
    """The names in the file; those of a recording, as near as may be.

    raw  whether pictures are raw, which have a topic of their own
    """

    def __init__(self, config: Config) -> None:
        camera = config.camera.id
        self.image = f"/camera/{camera}/image"
        self.lines = f"/vision/{camera}/lines"
        self.bearings = f"/vision/{camera}/bearings"
        self.estimate = f"/calibration/{camera}/estimate"
        self.scan = f"/laser/{camera}/scan"
        self.ticks = f"/encoder/{config.encoder.id}/ticks"
        self.raw = False

    @property
    def shown(self) -> str:
        """The topic of the pictures."""
        return f"{self.image}_raw" if self.raw else self.image


def _place_camera(file: FoxgloveFile, estimate: Estimate, camera: str) -> None:
    """Only what is trusted: a transform cannot say how good it is."""
    if estimate.mount is not None and estimate.state in _TRUSTED:
        _link(file, estimate.stamp_ns, camera, robot_from_camera(estimate.mount))


def _link(file: FoxgloveFile, stamp_ns: int, child: str, pose: tuple[float, float, float]) -> None:
    x, y, yaw = pose
    file.transform("/tf", stamp_ns, (_ROBOT, child), (x, y, 0.0), (0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw)))


def _sweep(file: FoxgloveFile, topic: str, scan: Scan) -> None:
    """No echo is infinitely far, as in ROS."""
    ranges = [value or inf for value in scan.range_m.tolist()]
    first = scan.angle_min_rad
    file.scan(topic, scan.stamp_ns, _LASER, (first, first + scan.angle_increment_rad * (len(ranges) - 1)), ranges)
