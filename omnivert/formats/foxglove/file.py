"""A file that Foxglove opens: an MCAP of its own schemas, and a layout that shows what is in it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from foxglove import Channel, Context, channels, layouts, messages, open_mcap

from omnivert.messages import Frame, PixelFormat

Rgb = tuple[float, float, float]  # 0 .. 1
Point = tuple[float, float]  # u, v; px, from the outer corner of the first pixel, as Foxglove counts

_RAW = {PixelFormat.GREY8: ("mono8", 1), PixelFormat.BGR8: ("bgr8", 3)}


@dataclass(frozen=True, slots=True)
class Circle:
    center: Point
    radius_px: float
    colour: Rgb


@dataclass(frozen=True, slots=True)
class Stroke:
    start: Point
    end: Point
    colour: Rgb
    thickness_px: float
    label: str  # at its end


class FoxgloveFile:
    """Written message by message; as a context manager it always leaves a finished file.

    raises  OSError when the file cannot be made, or not be written any further
    """

    def __init__(self, path: Path) -> None:
        self._context = Context()
        self._sink = _Sink(path, "xb")
        self._writer = open_mcap(self._sink, context=self._context)
        self._channels: dict[str, Any] = {}

    def image(self, topic: str, frame: Frame) -> None:
        """A picture: compressed ones as they are on this topic, raw ones on TOPIC_raw."""
        stamp = _stamp(frame.stamp_ns)
        data = frame.data.tobytes()
        if frame.format in _RAW:
            encoding, planes = _RAW[frame.format]
            size = {"width": frame.width_px, "height": frame.height_px, "step": planes * frame.width_px}
            picture = messages.RawImage(timestamp=stamp, frame_id="camera_image", encoding=encoding, data=data, **size)
            self._log(f"{topic}_raw", channels.RawImageChannel, picture, frame.stamp_ns)
            return
        file = messages.CompressedImage(timestamp=stamp, frame_id="camera_image", data=data, format=str(frame.format))
        self._log(topic, channels.CompressedImageChannel, file, frame.stamp_ns)

    def annotations(self, topic: str, stamp_ns: int, circles: Sequence[Circle], strokes: Sequence[Stroke]) -> None:
        """What is drawn over the picture of this stamp."""
        stamp = _stamp(stamp_ns)
        drawn = messages.ImageAnnotations(
            timestamp=stamp,
            circles=[
                messages.CircleAnnotation(
                    timestamp=stamp,
                    position=_point(circle.center),
                    diameter=2.0 * circle.radius_px,
                    thickness=1.0,
                    outline_color=_colour(circle.colour),
                )
                for circle in circles
            ],
            points=[
                messages.PointsAnnotation(
                    timestamp=stamp,
                    type=messages.PointsAnnotationType.LineStrip,
                    points=[_point(stroke.start), _point(stroke.end)],
                    outline_color=_colour(stroke.colour),
                    thickness=stroke.thickness_px,
                )
                for stroke in strokes
            ],
            texts=[
                messages.TextAnnotation(
                    timestamp=stamp,
                    position=_point(stroke.end),
                    text=stroke.label,
                    font_size=10.0,
                    text_color=_colour(stroke.colour),
                    background_color=messages.Color(r=0.0, g=0.0, b=0.0, a=0.6),
                )
                for stroke in strokes
            ],
        )
        self._log(topic, channels.ImageAnnotationsChannel, drawn, stamp_ns)

    def scan(
        self, topic: str, stamp_ns: int, frame_id: str, angles_rad: tuple[float, float], ranges_m: list[float]
    ) -> None:
        """angles_rad  of the first and of the last ray"""
        sweep = messages.LaserScan(
            timestamp=_stamp(stamp_ns),
            frame_id=frame_id,
            start_angle=angles_rad[0],
            end_angle=angles_rad[1],
            ranges=ranges_m,
        )
        self._log(topic, channels.LaserScanChannel, sweep, stamp_ns)

    def transform(
        self, topic: str, stamp_ns: int, frames: tuple[str, str], place_m: Sequence[float], quaternion: Sequence[float]
    ) -> None:
        """Where the second frame sits in the first; x, y, z and x, y, z, w."""
        (x, y, z), (qx, qy, qz, qw) = place_m, quaternion
        link = messages.FrameTransform(
            timestamp=_stamp(stamp_ns),
            parent_frame_id=frames[0],
            child_frame_id=frames[1],
            translation=messages.Vector3(x=x, y=y, z=z),
            rotation=messages.Quaternion(x=qx, y=qy, z=qz, w=qw),
        )
        self._log(topic, channels.FrameTransformChannel, link, stamp_ns)

    def series(self, topic: str, stamp_ns: int, schema: Mapping[str, Any], values: Mapping[str, Any]) -> None:
        """Values by name, to be plotted; the schema is a JSON schema."""
        self._log(topic, partial(Channel, schema=dict(schema)), dict(values), stamp_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._sink:
            self._writer.close()
            self._hold_written()

    def _log(self, topic: str, channel: Callable[..., Any], message: Any, stamp_ns: int) -> None:
        if topic not in self._channels:
            self._channels[topic] = channel(topic, context=self._context)
        self._channels[topic].log(message, log_time=stamp_ns)
        self._hold_written()

    def _hold_written(self) -> None:
        if self._sink.error is not None:
            raise self._sink.error


class _Sink(FileIO):
    """A file that keeps its error for whoever asks: the library would print it and go on."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data)
        try:
            while left:
                left = left[super().write(left) :]
        except OSError as error:
            self.error = self.error or error
        return len(data)


def layout(image: str, annotations: str, estimate: str) -> str:
    """A layout as JSON: the picture with its lines, one plot for each parameter, the states, and what to drive next.

    image, annotations, estimate  topics
    """

    def plot(name: str, unit: str) -> layouts.PlotPanel:
        names = [f"{name}{part}_{unit}" for part in ("", "_low", "_high")]
        paths = [layouts.PlotSeries(value=f"{estimate}.{field}", label=field) for field in names]
        return layouts.PlotPanel(title=f"{name}, {unit}", config=layouts.PlotConfig(paths=paths, show_legend=True))

    picture = layouts.ImagePanel(
        title="lines",
        config=layouts.ImageConfig(
            image_mode=layouts.ImageModeConfig(
                image_topic=image, annotations={annotations: layouts.ImageAnnotationSettings(visible=True)}
            )
        ),
    )
    states = layouts.StateTransitionsPanel(
        title="states",
        config=layouts.StateTransitionsConfig(
            paths=[
                layouts.StateTransitionsSeries(value=f"{estimate}.{name}", label=name)
                for name in ("state", "phi_state", "rho_state", "psi_state")
            ]
        ),
    )
    raw = layouts.RawMessagesPanel(title="estimate", config=layouts.RawMessagesConfig(topic_path=estimate))
    left = _split("column", (picture, 3.0), (states, 1.0))
    plots = [(plot(name, unit), 1.0) for name, unit in (("phi", "deg"), ("rho", "m"), ("psi", "deg"))]
    right = _split("column", *plots, (raw, 1.0))
    return layouts.Layout(content=_split("row", (left, 1.0), (right, 1.0))).to_json()


def _split(direction: Any, *parts: tuple[Any, float]) -> layouts.SplitContainer:
    items = [layouts.SplitItem(content=content, proportion=share) for content, share in parts]
    return layouts.SplitContainer(direction=direction, items=items)


def _stamp(stamp_ns: int) -> messages.Timestamp:
    return messages.Timestamp(sec=stamp_ns // 10**9, nsec=stamp_ns % 10**9)


def _point(place: Point) -> messages.Point2:
    return messages.Point2(x=place[0], y=place[1])


def _colour(colour: Rgb) -> messages.Color:
    return messages.Color(r=colour[0], g=colour[1], b=colour[2], a=1.0)
