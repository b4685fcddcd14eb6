"""What a recording holds, judged before anything is computed from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING, Any

from omnivert.messages import Bearings, Frame, Ticks
from omnivert.wire.channels import BEARINGS, FRAME, Channel, channel_from_key

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording


def count(recording: "Recording", channel: Channel) -> int:
    """Messages of one channel, whatever the ids in their keys."""
    return sum(number for key, number in recording.counts.items() if channel_from_key(key) is channel)


def missing(stamps_ns: Sequence[int]) -> int:
    """How many messages lack between others of a stream, by the step that is usual in it."""
    steps = [after - before for before, after in pairwise(stamps_ns)]
    usual = median(steps) if steps else 0
    return sum(round(step / usual) - 1 for step in steps if step > 1.5 * usual) if usual > 0 else 0


def fault(of: "Recording | Given") -> str:
    """What is wrong with a recording, and what that costs; empty when it is whole."""
    return f"{of.cut}, {of.lost} messages are lost" if of.lost else of.cut


@dataclass(frozen=True, slots=True)
class Given:
    """The streams of a recording that the calibration lives on."""

    seconds: float
    images: bool  # else the frames are bearings, of a sensor that is no camera
    frames: int
    rate_hz: float
    longest_gap_s: float  # between frames
    ticks: int
    missing: int | None  # frames and ticks that the rhythm of the others lacks; None: other people's logs have none
    cut: str  # what is wrong with the recording; empty when it is whole
    lost: int  # messages that can not be read any more, as far as it is known

    @classmethod
    def of(cls, recording: "Recording") -> "Given":
        images = count(recording, FRAME) > 0 or not count(recording, BEARINGS)
        sensor = Frame if images else Bearings
        stamps: list[int] = []
        ticks: list[int] = []
        for _, message in recording.messages(types=(sensor, Ticks)):
            (ticks if isinstance(message, Ticks) else stamps).append(message.stamp_ns)
        return cls.of_stamps(recording, images, stamps, ticks)

    @classmethod
    def of_stamps(cls, recording: "Recording", images: bool, stamps: Sequence[int], ticks: Sequence[int]) -> "Given":
        """The same where the stamps of the frames and of the ticks are known."""
        gaps = [1e-9 * (after - before) for before, after in pairwise(stamps)]
        lasted = 1e-9 * (stamps[-1] - stamps[0]) if len(stamps) > 1 else 0.0
        return cls(
            seconds=1e-9 * (recording.end_ns - recording.start_ns),
            images=images,
            frames=len(stamps),
            rate_hz=(len(stamps) - 1) / lasted if lasted > 0 else 0.0,
            longest_gap_s=max(gaps, default=0.0),
            ticks=len(ticks),
            missing=missing(stamps) + missing(ticks) if images else None,
            cut=recording.cut,
            lost=recording.lost,
        )

    @property
    def fault(self) -> str:
        """What is wrong with the recording, and what that costs; empty when it is whole."""
        return fault(self)

    def __str__(self) -> str:
        frames = "frames" if self.images else "bearings frames"
        parts = [
            f"{self.seconds:.1f} s",
            f"{self.frames} {frames} ({self.rate_hz:.1f} Hz, longest gap {1e3 * self.longest_gap_s:.0f} ms)",
            f"{self.ticks} ticks",
        ]
        if self.missing is not None:
            parts.append(f"{self.missing} missing")
        if self.cut:
            parts.append(f"not whole: {self.fault}")
        return " · ".join(parts)

    def json(self) -> dict[str, Any]:
        return {
            "seconds": self.seconds,
            "images": self.images,
            "frames": self.frames,
            "rate_hz": self.rate_hz,
            "longest_gap_s": self.longest_gap_s,
            "ticks": self.ticks,
            "missing": self.missing,
            "cut": self.cut,
            "lost": self.lost,
        }
