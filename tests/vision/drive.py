"""The packaged corridor as frames with their truth, and how well the front end does on such a drive."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.bench.score.circle import nearest
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.score import Score, score
from omnivert.bench.score.truth import FrameTruth, Sighting, truth_of
from omnivert.bench.vision import raw
from omnivert.cli.settings import recording_path
from omnivert.config import Config
from omnivert.messages import Bearings, Frame
from omnivert.vision.frontend import FrontEnd
from omnivert.vision.image import grey_from_frame
from omnivert.wire.recording import Recording

Grey = NDArray[np.uint8]
Float = NDArray[np.float64]
Point = tuple[float, float]

PERIOD_NS = 333_333_000


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Frames in order and what is true of them."""

    frames: tuple[Frame, ...]
    truth: tuple[FrameTruth, ...]
    config: Config
    heading_rad: Float  # (F,) of the camera against the first frame; far lines turn by its negative
    meeting_px: tuple[Point | None, ...] = ()  # where the vertical lines meet; empty: at the ring's centre
    moving_rad: tuple[Float, ...] = ()  # edges of moving things; empty: not looked at

    def pictures(self) -> list[Grey]:
        return [grey_from_frame(frame) for frame in self.frames]

    def of(self, pictures: Sequence[Grey], truth: Sequence[FrameTruth] | None = None) -> "Drive":
        """The same drive with other pictures, raw, and perhaps another truth."""
        frames = tuple(raw(p, frame.stamp_ns) for p, frame in zip(pictures, self.frames, strict=True))
        return replace(self, frames=frames, truth=self.truth if truth is None else tuple(truth))

    def picked(self, frames: slice) -> "Drive":
        """Some of the frames, or all in another order, stamped anew."""
        chosen = [replace(frame, stamp_ns=k * PERIOD_NS) for k, frame in enumerate(self.frames[frames])]
        return replace(
            self,
            frames=tuple(chosen),
            truth=self.truth[frames],
            heading_rad=self.heading_rad[frames],
            meeting_px=self.meeting_px[frames],
            moving_rad=self.moving_rad[frames],
        )


@lru_cache(maxsize=1)
def as_recorded() -> Drive:
    """All frames of the corridor, JPEG."""
    recording = Recording(recording_path("corridor"))
    frames = [m for _, m in recording.messages(types=(Frame,)) if isinstance(m, Frame)]
    truth = [t for t in truth_of(recording) or [] if t is not None]
    assert len(truth) == len(frames)
    header, *rows = recording.attachment("truth/poses.csv").decode().split()
    heading = np.array([float(row.split(",")[header.split(",").index("theta_rad")]) for row in rows])
    return Drive(tuple(frames), tuple(truth), recording.config(Config()), heading - heading[0])


@lru_cache(maxsize=4)
def corridor(first: int = 0, last: int = 110, step: int = 1) -> Drive:
    """A part of it, raw. Up to 50 the robot drives straight, up to 105 it turns on the spot."""
    part = as_recorded().picked(slice(first, last, step))
    return part.of(part.pictures())


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What the front end made of a drive."""

    drive: Drive
    seen: tuple[Bearings, ...]
    score: Score
    step_ms: float  # median
    meeting_rms_px: float | None  # None: none was told, or none is known to be true
    moving_told: tuple[float, float] | None  # share flagged of the lines on moving things, and of the other true ones


def run(drive: Drive, front_end: Callable[[Config], FrontEnd] = FrontEnd) -> Run:
    front, seen, took = front_end(drive.config), [], []
    for frame in drive.frames:
        began = time.perf_counter()
        seen.append(front.step(frame))
        took.append(time.perf_counter() - began)
    judged = score([Sighting.of(s) for s in seen], drive.truth)
    assert judged is not None
    return Run(
        drive, tuple(seen), judged, 1e3 * float(np.median(took)), _meeting_rms(drive, seen), _moving(drive, seen)
    )


def _meeting_rms(drive: Drive, seen: Sequence[Bearings]) -> float | None:
    off = [
        np.hypot(s.meeting.u_px - true[0], s.meeting.v_px - true[1])
        for s, true in zip(seen, drive.meeting_px, strict=False)
        if s.meeting is not None and true is not None
    ]
    return float(np.sqrt(np.mean(np.square(off)))) if off else None


def _moving(drive: Drive, seen: Sequence[Bearings], grown: int = 6) -> tuple[float, float] | None:
    """Lines of tracks that are at least `grown` frames old: before, nobody can know."""
    told: dict[bool, list[bool]] = {True: [], False: []}
    rules = Rules()
    for s, truth, moving in zip(seen, drive.truth, drive.moving_rad, strict=False):
        if s.looks is None:
            return None
        on_moving = nearest(s.bearing_rad, moving) <= rules.tolerance_rad
        on_static = nearest(s.bearing_rad, truth.bearing_rad[rules.visible(truth)]) <= rules.tolerance_rad
        flagged, old = s.looks.moving > 0, s.age_frames >= grown
        told[True].extend(flagged[on_moving & ~on_static & old].tolist())
        told[False].extend(flagged[on_static & ~on_moving & old].tolist())
    return (float(np.mean(told[True])), float(np.mean(told[False]))) if told[True] and told[False] else None


def image_angle(bearing_rad: Float, config: Config) -> Float:
    """The image angle of bearings, and the other way round: the sign is its own inverse."""
    return np.asarray(wrap(config.camera.bearing_sign * bearing_rad))
