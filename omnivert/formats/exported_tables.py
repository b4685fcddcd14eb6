"""The tables of an exported folder: each takes messages of one type, and every number comes back as it was."""

import json
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

import cv2
import numpy as np

from omnivert.errors import DataError
from omnivert.formats.folder import KEPT
from omnivert.formats.table import NS_PER_S
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Message, PixelFormat, Scan, Ticks

M = TypeVar("M", bound=Message)
_SUFFIX = {PixelFormat.JPEG: ".jpg", PixelFormat.PNG: ".png"}  # of raw frames PNG, too: it loses nothing
_QUICK = [cv2.IMWRITE_PNG_COMPRESSION, 1]


def seconds(stamp_ns: int) -> str:
    """To the last nanosecond."""
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d}"


class Table(Generic[M]):
    """A CSV file.

    left_out  messages that have no place in it
    """

    def __init__(self, path: Path, *columns: str) -> None:
        path.parent.mkdir(exist_ok=True)
        self.left_out = 0
        self._file = path.open("w", encoding="utf-8", newline="\n")
        self._row(*columns)

    def take(self, message: M) -> None:
        """Writes the message's rows."""
        raise NotImplementedError

    def _row(self, *fields: object) -> None:
        self._file.write(",".join(map(str, fields)) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


class FramesTable(Table[Frame]):
    """frames.csv, and the images beside it: files as they are, raw pixels as PNG."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / "frames.csv", "index", "t_s", "file", *KEPT)
        self._folder = folder
        self._index = 0
        (folder / "frames").mkdir()

    def take(self, message: Frame) -> None:
        name = f"frames/{self._index:06d}{_SUFFIX.get(message.format, '.png')}"
        (self._folder / name).write_bytes(_image(message))
        size = message.width_px, message.height_px
        self._row(self._index, seconds(message.stamp_ns), name, message.format.value, *size)
        self._index += 1


class TicksTable(Table[Ticks]):
    """encoders.csv"""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / "encoders.csv", "t_s", "left_ticks", "right_ticks")

    def take(self, message: Ticks) -> None:
        self._row(seconds(message.stamp_ns), message.left, message.right)


class WaysTable(Table[Ticks]):
    """wheels.csv, in metres of a wheel that meta.json tells: so they become the same counts again."""

    def __init__(self, folder: Path, metres_per_tick: float) -> None:
        super().__init__(folder / "wheels.csv", "t_s", "left_m", "right_m")
        self._tick_m = metres_per_tick

    def take(self, message: Ticks) -> None:
        self._row(seconds(message.stamp_ns), repr(message.left * self._tick_m), repr(message.right * self._tick_m))


class ScansTable(Table[Scan]):
    """scans.csv; sweeps of another form than the first one have no place beside it.

    widest_m  the largest range
    """

    def __init__(self, folder: Path, first: Scan) -> None:
        self.form = first
        self.widest_m = 0.0
        super().__init__(folder / "scans.csv", "t_s", *(f"r{k}" for k in range(first.range_m.size)))

    def take(self, message: Scan) -> None:
        form = self.form
        alike = message.range_m.size == form.range_m.size and message.angle_min_rad == form.angle_min_rad
        if not alike or message.angle_increment_rad != form.angle_increment_rad or not message.range_m.size:
            self.left_out += 1
            return
        self.widest_m = max(self.widest_m, float(message.range_m.max()))
        self._row(seconds(message.stamp_ns), *(f"{value:.9g}" for value in message.range_m.tolist()))

    def laser(self) -> dict[str, float]:
        """What meta.json tells of it; no range that was recorded lies beyond its end."""
        form, limit = self.form, min(self.widest_m * (1.0 + 1e-6) + 1e-6, 1e4)
        angles = {"angle_min": form.angle_min_rad, "angle_increment": form.angle_increment_rad}
        return {**angles, "n": form.range_m.size, "range_max": limit, "invalid": 0.0}


class BearingsTable(Table[Bearings]):
    """bearings.csv; a look that saw nothing is a row with its time alone.

    bare  messages that said more than bearings: ring, reasons, looks
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "t_s", "track_id", "bearing_rad", "std_rad", "age_frames", "strength")
        self.bare = 0

    def take(self, message: Bearings) -> None:
        self.bare += any((message.ring, message.reasons, message.meeting, message.looks))
        at = seconds(message.stamp_ns)
        columns = message.track_id, message.bearing_rad, message.std_rad, message.age_frames, message.strength
        for track, bearing, std, age, strength in zip(*(column.tolist() for column in columns), strict=True):
            self._row(at, track, repr(bearing), repr(std), age, f"{strength:.9g}")
        if not message.track_id.size:
            self._row(at, *[""] * 5)


class EstimatesTable(Table[Estimate]):
    """What was calibrated while it was recorded, frame by frame."""

    def __init__(self, folder: Path) -> None:
        mount = ("phi_rad", "rho_m", "psi_rad", "phi_std_rad", "rho_std_m", "psi_std_rad")
        super().__init__(folder / "results" / "estimates.csv", "t_s", "state", *mount, "driven_m", "turned_rad")

    def take(self, message: Estimate) -> None:
        mount = message.mount
        known: tuple[object, ...] = ("",) * 6
        if mount is not None:
            known = (mount.phi_rad, mount.rho_m, mount.psi_rad, *np.sqrt(np.diag(mount.covariance)).tolist())
        self._row(seconds(message.stamp_ns), message.state.value, *known, message.driven_m, message.turned_rad)


def extrinsics_json(claims: list[Extrinsics]) -> bytes:
    """Every claim once, however often it was repeated until it was acknowledged."""
    told: dict[tuple[int, str], dict[str, Any]] = {}
    for claim in claims:
        told[claim.stamp_ns, claim.state.value] = {
            "t_s": claim.stamp_ns / NS_PER_S,
            "state": claim.state.value,
            "phi_rad": claim.mount.phi_rad,
            "rho_m": claim.mount.rho_m,
            "psi_rad": claim.mount.psi_rad,
            "covariance": claim.mount.covariance.tolist(),
            "frames": claim.frames,
            "reasons": list(claim.reasons),
            "robot": claim.robot,
            "camera": claim.camera,
            "software": claim.software,
            "rig_digest": claim.rig_digest,
        }
    return json.dumps(list(told.values()), indent=1).encode()


def _image(frame: Frame) -> bytes:
    if frame.format in _SUFFIX:
        return frame.data.tobytes()
    planes = () if frame.format is PixelFormat.GREY8 else (3,)
    done, data = cv2.imencode(".png", frame.data.reshape(frame.height_px, frame.width_px, *planes), _QUICK)
    if not done:
        what = f"a frame of {frame.width_px} x {frame.height_px} pixels does not become a PNG"
        raise DataError("OV313", what, "", "omnivert explain OV313")
    return data.tobytes()
