"""The folder of images, encoder counts and scans that any logger can write -> messages in order of stamp.

meta.json, frames.csv, encoders.csv; scans.csv and truth/ where there are some
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.drivers.image_file import frame_from_file
from omnivert.formats.drive_folder import ClosedFolder, hold_in_order, hold_together
from omnivert.formats.meta import Laser, Meta
from omnivert.formats.table import Row, refusal, rows, wide_rows
from omnivert.messages import Frame, Message, Scan, Ticks


@dataclass(frozen=True, slots=True)
class _Image:
    stamp_ns: int
    place: str
    path: Path


class FramesFolder:
    """A folder whose tables have been read and held to their form; each image is read when its turn comes.

    config    `base` with the folder's rig in it
    counts    messages by type
    shift_ns  what is added to every time, so that none is negative
    notes     none: what is wrong with the images, the calibration says
    raises    DataError naming file and row
    """

    def __init__(self, folder: Path, base: Config) -> None:
        self._folder = ClosedFolder(folder)
        meta = Meta(folder / "meta.json")
        self.config = meta.config(base)
        self._ticks = [
            (row.place, Ticks(row.stamp_ns("t_s"), row.integer("left_ticks"), row.integer("right_ticks")))
            for row in rows(folder / "encoders.csv", ("t_s", "left_ticks", "right_ticks"))
        ]
        self._images = [self._image(row) for row in rows(folder / "frames.csv", ("index", "t_s", "file"))]
        self._scans: list[tuple[str, Scan]] = []
        if (folder / "scans.csv").exists():
            laser = meta.laser()
            self._scans = [(row.place, _scan(row, laser)) for row in wide_rows(folder / "scans.csv", "t_s")]
        frames = [(image.place, image.stamp_ns) for image in self._images]
        ticks = [(place, message.stamp_ns) for place, message in self._ticks]
        scans = [(place, message.stamp_ns) for place, message in self._scans]
        for stamps in (ticks, scans, frames):
            hold_in_order(stamps)
        for stamps in (ticks, scans):
            hold_together(stamps, frames)
        firsts = [self._ticks[0][1].stamp_ns, self._images[0].stamp_ns, *(scan.stamp_ns for _, scan in self._scans[:1])]
        self.shift_ns = max(0, -min(firsts))
        counts = {"Frame": len(self._images), "Ticks": len(self._ticks), "Scan": len(self._scans)}
        self.counts = {name: count for name, count in counts.items() if count}
        self.notes: tuple[str, ...] = ()

    def messages(self) -> Iterator[Message]:
        """Everything in order of stamp; at equal stamps ticks, then scans, then frames."""
        ticks = (Ticks(t.stamp_ns + self.shift_ns, t.left, t.right) for _, t in self._ticks)
        scans = (
            Scan(s.stamp_ns + self.shift_ns, s.angle_min_rad, s.angle_increment_rad, s.range_m) for _, s in self._scans
        )
        frames = (self._frame(image) for image in self._images)
        streams: list[Iterator[Message]] = [ticks, scans, frames]
        return heapq.merge(*streams, key=lambda message: message.stamp_ns)

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """meta.json, for what the rig does not hold, and everything under truth/, in order of name."""
        return self._folder.attachments()

    def _image(self, row: Row) -> _Image:
        row.integer("index")
        return _Image(
            row.stamp_ns("t_s"), row.place, self._folder.inside(self._folder.path / row.text("file"), row.place)
        )

    def _frame(self, image: _Image) -> Frame:
        place = f"{image.place}, {image.path.relative_to(self._folder.path)}"
        try:
            frame = frame_from_file(self._folder.bytes_of(image.path, place), image.stamp_ns + self.shift_ns)
        except ValueError as error:
            raise refusal(place, str(error)) from error
        camera = self.config.camera
        if (frame.width_px, frame.height_px) != (camera.width_px, camera.height_px):
            size, said = f"{frame.width_px} x {frame.height_px}", f"{camera.width_px} x {camera.height_px}"
            raise refusal(place, f"the image has {size} pixels, meta.json says {said}")
        return frame


def _scan(row: Row, laser: Laser) -> Scan:
    try:
        range_m: NDArray[np.float64] = np.array([float(field) for field in row.further])
    except ValueError as error:
        raise refusal(row.place, str(error)) from error
    if len(range_m) != laser.n:
        raise refusal(row.place, f"{len(range_m)} ranges, meta.json says {laser.n}")
    silent = (range_m == laser.invalid) | (range_m > laser.range_max_m)
    if np.isnan(range_m).any() or (range_m[~silent] < 0.0).any():
        raise refusal(row.place, "a range is NaN or negative")
    heard = np.where(silent, 0.0, range_m).astype(np.float32)
    return Scan(row.stamp_ns("t_s"), laser.angle_min_rad, laser.angle_increment_rad, heard)
