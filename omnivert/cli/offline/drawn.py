"""Frames with their rings and lines in them: as pictures, and as a video."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.errors import DataError, UseError
from omnivert.messages import Bearings, Frame
from omnivert.pictures.overlay import overlay
from omnivert.vision.image import grey_from_frame

Bgr = NDArray[np.uint8]

# What OpenCV's wheels can write everywhere; H.264 is not among it. VP8 plays in browsers.
CODECS = {".mp4": "mp4v", ".webm": "VP80", ".avi": "MJPG"}
_SLOWEST_HZ, _FASTEST_HZ = 0.1, 1000.0  # a slower WebM can not be read back


def drawn_frame(frame: Frame, bearings: Bearings, config: Config, index: int | None = None) -> Bgr | None:
    """(H, W, 3) the frame with what was found in it, enlarged where it is small; None when it cannot be read.

    index  of the frame, told in a band above it; None: no band
    """
    try:
        grey = grey_from_frame(frame)
    except ValueError:
        return None
    return overlay(grey, bearings, config.camera.bearing_sign, config.ring.r_min_px, index, config.ring)


def dark_frame(bearings: Bearings, config: Config, index: int) -> Bgr:
    """(H, W, 3) what stands for a frame that cannot be read: its reasons."""
    dark = np.zeros((config.camera.height_px, config.camera.width_px), dtype=np.uint8)
    return overlay(dark, bearings, config.camera.bearing_sign, config.ring.r_min_px, index)


def write_drawn(path: Path, drawn: Bgr) -> None:
    """Write it as PNG.

    raises  DataError when the file cannot be written
    """
    _, file = cv2.imencode(".png", drawn)
    try:
        path.write_bytes(file.tobytes())
    except OSError as error:
        raise DataError("OV322", f"cannot write {path}", str(error.strerror or error)) from error


def check_video(path: Path) -> None:
    """raises UseError when it is to be a video of another kind than can be written"""
    if path.suffix.lower() not in CODECS:
        help = f"--video {path.with_suffix('.mp4')}" if path.name else "--video lines.mp4"
        raise UseError("OV205", f"omnivert track: --video {path}", "a video is .mp4, .webm or .avi", help)


def frame_rate_hz(stamps_ns: Sequence[int], otherwise: float) -> float:
    """At which frames play as fast as they were taken, by their median interval; for a single one as given."""
    steps = [after - before for before, after in pairwise(stamps_ns) if after > before]
    rate = 1e9 / median(steps) if steps else otherwise
    # Four digits: MPEG-4 holds the rate as a fraction of 16-bit numbers.
    return float(f"{min(max(rate, _SLOWEST_HZ), _FASTEST_HZ):.4g}")


class Video:
    """A video file that grows by a picture at a time; its first one gives the size."""

    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path = path
        self._rate_hz = rate_hz
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._frames = 0

    def step(self, picture: Bgr) -> None:
        """Add one; of another size than the first it is fitted in, nothing cut off.

        raises  DataError when no video can be written there
        """
        if self._writer is None:
            height, width = picture.shape[:2]
            self._size = width + width % 2, height + height % 2  # codecs know even sizes only
            self._writer = self._opened()
        self._writer.write(fitted(picture, self._size))
        self._frames += 1

    def release(self) -> None:
        """Let go of the file; it can be played, however far it has come."""
        if self._writer is not None:
            with _unheard():
                self._writer.release()
            self._writer = None

    def check(self) -> None:
        """Whether the released file holds what was written: of a full disk the codec says nothing.

        raises  DataError when it does not
        """
        if not self._frames:
            return
        with _unheard():
            read = cv2.VideoCapture(str(self._path.absolute()), cv2.CAP_FFMPEG)
            held = round(read.get(cv2.CAP_PROP_FRAME_COUNT)) if read.isOpened() else 0
            if read.isOpened() and held < self._frames:  # WebM holds no count, and OpenCV's guess may be too low
                held = sum(1 for _ in iter(read.grab, False))
            read.release()
        if held < self._frames:
            because = f"only {held} of {self._frames} frames got there"
            raise DataError("OV322", f"cannot write {self._path}", because, "choose another place")

    def _opened(self) -> cv2.VideoWriter:
        codec = CODECS[self._path.suffix.lower()]
        fourcc = cv2.VideoWriter.fourcc(*codec)
        with _unheard():
            writer = cv2.VideoWriter(str(self._path.absolute()), cv2.CAP_FFMPEG, fourcc, self._rate_hz, self._size)
        if not writer.isOpened():
            because = f"OpenCV cannot write {codec} of {self._size[0]}x{self._size[1]} there"
            raise DataError("OV322", f"cannot write {self._path}", because, "choose another format: .mp4, .webm, .avi")
        return writer


def fitted(picture: Bgr, size: tuple[int, int]) -> Bgr:
    """The picture in a canvas of this width and height, made smaller if it has to be; dark beside it."""
    height, width = picture.shape[:2]
    by = min(size[0] / width, size[1] / height, 1.0)
    if by < 1.0:
        width, height = max(int(width * by), 1), max(int(height * by), 1)
        picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if (width, height) == size:
        return picture
    canvas = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    canvas[:height, :width] = picture
    return canvas


@contextmanager
def _unheard() -> Iterator[None]:
    """Without what native code says on stderr: OpenCV warns there of WebM's tags, and of all that is an error here."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
