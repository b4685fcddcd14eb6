"""What a recording holds, stream by stream, how far was driven in it, and whether its file is sound."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import degrees
from typing import TYPE_CHECKING, Any

from omnivert.cli.given import Given, missing
from omnivert.cli.offline.results import aligned
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, Health, Ticks
from omnivert.odometry import Odometer
from omnivert.pictures.words import printable
from omnivert.wire.channels import TICKS
from omnivert.wire.codec import WireError, decode

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording

_REGULAR = (Frame.__name__, Ticks.__name__, "Scan", Bearings.__name__)  # streams that have a rhythm


@dataclass(frozen=True, slots=True)
class Stream:
    """Messages of one key.

    begins_s, ends_s  first and last, since the recording's start
    rate_hz           0 for a single message
    missing           how many lack between the others, by their rhythm; None: it has none
    """

    key: str
    name: str
    count: int
    bytes: int
    begins_s: float
    ends_s: float
    rate_hz: float
    longest_gap_s: float
    missing: int | None

    @classmethod
    def of(cls, key: str, name: str, stamps_ns: Sequence[int], size: int, start_ns: int) -> "Stream":
        lasted_s = 1e-9 * (stamps_ns[-1] - stamps_ns[0])
        return cls(
            key=key,
            name=name,
            count=len(stamps_ns),
            bytes=size,
            begins_s=1e-9 * (stamps_ns[0] - start_ns),
            ends_s=1e-9 * (stamps_ns[-1] - start_ns),
            rate_hz=(len(stamps_ns) - 1) / lasted_s if lasted_s > 0 else 0.0,
            longest_gap_s=max((1e-9 * (after - before) for before, after in pairwise(stamps_ns)), default=0.0),
            missing=missing(stamps_ns) if name in _REGULAR else None,
        )

    def json(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class Inventory:
    """
    driven_m, turned_rad  as the wheels tell, in either direction; None without wheel counts
    recorder_lost         what its recorder had lost when it last said so; None when no recorder speaks in it
    damaged               chunks that cannot be read
    """

    given: Given
    streams: tuple[Stream, ...]
    start_ns: int
    end_ns: int
    bytes: int
    driven_m: float | None
    turned_rad: float | None
    recorder_lost: int | None
    chunks: int
    damaged: int
    refused: dict[str, int]
    attachments: tuple[str, ...]
    config: Config

    def json(self) -> dict[str, Any]:
        robot = self.config.robot
        return {
            **self.given.json(),
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "bytes": self.bytes,
            "streams": [stream.json() for stream in self.streams],
            "driven_m": self.driven_m,
            "turned_rad": self.turned_rad,
            "recorder_lost": self.recorder_lost,
            "chunks": self.chunks,
            "chunks_damaged": self.damaged,
            "refused": self.refused,
            "attachments": list(self.attachments),
            "robot": robot.id,
            "camera": self.config.camera.id,
            "rig": self.config.rig(),
            "rig_digest": self.config.rig_digest(),
        }

    def lines(self) -> list[str]:
        """The same for a person."""
        out = [f"robot    {self.config.robot.id}, camera {self.config.camera.id}, rig {self.config.rig_digest()}"]
        out.append(f"stamps   {self.start_ns / 1e9:.3f} to {self.end_ns / 1e9:.3f} s")
        if self.driven_m is not None and self.turned_rad is not None:
            out.append(f"driven   {self.driven_m:.1f} m, {degrees(self.turned_rad):.0f} deg turned, as the wheels tell")
        out.append(f"file     {self.bytes / 1e6:.1f} MB, {self.chunks} chunks{self._health()}")
        if self.attachments:
            out.append(f"carries  {', '.join(self.attachments)}")
        table = [("stream", "count", "Hz", "longest gap", "missing", "from s", "to s", "MB", "")]
        for stream in self.streams:
            lacking = "-" if stream.missing is None else f"{stream.missing}"
            span = f"{stream.begins_s:.2f}", f"{stream.ends_s:.2f}", f"{stream.bytes / 1e6:.2f}"
            gap = f"{1e3 * stream.longest_gap_s:.0f} ms"
            table.append((stream.key, f"{stream.count}", f"{stream.rate_hz:.2f}", gap, lacking, *span, ""))
        return [printable(line) for line in (*out, "", *aligned(table))]  # names in it may be anybody's

    def _health(self) -> str:
        faults = [f"{self.damaged} damaged"] if self.damaged else []
        faults += [self.given.fault] if self.given.cut else []
        faults += [f"{times} {reason}" for reason, times in self.refused.items()]
        faults += [f"its recorder lost {self.recorder_lost} messages"] if self.recorder_lost else []
        return f": {'; '.join(faults)}" if faults else ", all sound"


def inventory(recording: "Recording", moved: Callable[[], None] = lambda: None) -> Inventory:
    """Reads the whole recording.

    moved  called after each message
    """
    config = recording.config(Config())
    stamps: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    sizes: defaultdict[tuple[str, str], int] = defaultdict(int)
    way = _Way(config)
    lost: int | None = None
    refused: defaultdict[str, int] = defaultdict(int)
    for entry in recording.entries():
        stamps[entry.key, entry.name].append(entry.at_ns)
        sizes[entry.key, entry.name] += len(entry.data)
        try:
            if entry.name in (Ticks.__name__, Health.__name__):
                match decode(entry.data):
                    case Ticks() as ticks if entry.key == TICKS.key(config):
                        way.take(ticks)
                    case Health(service="recorder") as health:
                        lost = sum((*health.dropped.values(), *health.gaps.values()))
        except WireError as error:
            refused[error.reason] += 1
        moved()
    names = {name for _, name in stamps}
    images = Frame.__name__ in names or Bearings.__name__ not in names
    seen = _stamps(stamps, Frame.__name__ if images else Bearings.__name__)
    return Inventory(
        given=Given.of_stamps(recording, images, seen, _stamps(stamps, Ticks.__name__)),
        streams=tuple(
            Stream.of(key, name, stamps[key, name], sizes[key, name], recording.start_ns)
            for key, name in sorted(stamps)
        ),
        start_ns=recording.start_ns,
        end_ns=recording.end_ns,
        bytes=recording.path.stat().st_size,
        driven_m=way.driven_m if way.counts else None,
        turned_rad=way.turned_rad if way.counts else None,
        recorder_lost=lost,
        chunks=recording.chunks,
        damaged=recording.refused["damaged chunk"],
        refused=dict(refused),
        attachments=recording.attachments,
        config=config,
    )


def _stamps(stamps: dict[tuple[str, str], list[int]], name: str) -> list[int]:
    return sorted(stamp for (_, kind), of_key in stamps.items() if kind == name for stamp in of_key)


class _Way:
    """How far the wheels say that the robot went and turned; over a break of the counts nothing is known."""

    def __init__(self, config: Config) -> None:
        self.counts = 0
        self.driven_m = 0.0
        self.turned_rad = 0.0
        self._base_m = config.robot.wheel_base_m
        self._odometer = Odometer(config.encoder, self._base_m)

    def take(self, ticks: Ticks) -> None:
        self.counts += 1
        before_ns = self._odometer.newest_ns
        self._odometer.push(ticks)
        newest_ns = self._odometer.newest_ns
        if before_ns is None or newest_ns is None or newest_ns == before_ns:
            return
        samples = self._odometer.samples(before_ns, newest_ns)
        self._odometer.forget_before(newest_ns)
        if samples is not None:
            right, left = samples.moved_m
            self.driven_m += abs(right + left) / 2.0
            self.turned_rad += abs(right - left) / self._base_m
