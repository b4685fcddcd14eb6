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
from omnivert.drivers.image_file import MAX_SIDE_PX, frame_from_file, pixels_from_file
from omnivert.formats.drive_folder import ClosedFolder, hold_in_order, hold_together
from omnivert.formats.meta import Laser, Meta
from omnivert.formats.table import Row, refusal, rows, wide_rows
from omnivert.messages import Frame, Message, PixelFormat, Scan, Ticks

KEPT = ("format", "width_px", "height_px")  # optional columns, which an export writes


@dataclass(frozen=True, slots=True)
class _Image:
    stamp_ns: int
    place: str
    path: Path
    kept: PixelFormat | None  # as what an export had it; None: anybody's file
    width_px: int = 0
    height_px: int = 0


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
        self._images = [self._image(row) for row in rows(folder / "frames.csv", ("index", "t_s", "file"), KEPT)]
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
        path = self._folder.inside(self._folder.path / row.text("file"), row.place)
        if not row.fields.keys() >= set(KEPT):
            return _Image(row.stamp_ns("t_s"), row.place, path, None)
        form = row.text("format")
        if form not in tuple(PixelFormat):
            raise refusal(row.place, f"format = {form[:40]!r} is none of {', '.join(PixelFormat)}")
        size = row.integer("width_px"), row.integer("height_px")
        if not all(1 <= side <= MAX_SIDE_PX for side in size):
            raise refusal(row.place, f"a frame of {size[0]} x {size[1]} pixels is beyond the limit of {MAX_SIDE_PX}")
        return _Image(row.stamp_ns("t_s"), row.place, path, PixelFormat(form), *size)

    def _frame(self, image: _Image) -> Frame:
        place = f"{image.place}, {image.path.relative_to(self._folder.path)}"
        data, stamp_ns = self._folder.bytes_of(image.path, place), image.stamp_ns + self.shift_ns
        if image.kept in (PixelFormat.JPEG, PixelFormat.PNG):
            # As it was recorded, be it torn or of another size: of the recording, too, the vision says so.
            return Frame(stamp_ns, image.kept, image.width_px, image.height_px, np.frombuffer(data, np.uint8))
        try:
            frame = pixels_from_file(data, stamp_ns) if image.kept else frame_from_file(data, stamp_ns)
        except ValueError as error:
            raise refusal(place, str(error)) from error
        self._hold_to_size(frame, image, place)
        if image.kept not in (None, frame.format):
            raise refusal(place, f"the image is {frame.format}, frames.csv says {image.kept}")
        return frame

    def _hold_to_size(self, frame: Frame, image: _Image, place: str) -> None:
        camera = self.config.camera
        said, who = (camera.width_px, camera.height_px), "meta.json"
        if image.kept is not None:
            said, who = (image.width_px, image.height_px), "frames.csv"
        if (frame.width_px, frame.height_px) != said:
            size = f"{frame.width_px} x {frame.height_px}"
            raise refusal(place, f"the image has {size} pixels, {who} says {said[0]} x {said[1]}")


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
