"""An image as a frame: JPEG and PNG files pass through as their bytes, everything else as grey or colour pixels."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Frame, PixelFormat

JPEG_START, JPEG_SCAN, JPEG_END = b"\xff\xd8", 0xDA, b"\xff\xd9"
PNG_START, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
MAX_SIDE_PX = 16384
MAX_BYTES = 256 * 2**20  # of a file; larger ones are no pictures of a camera
JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers of the part that tells the size


def frame_from_path(path: Path, stamp_ns: int) -> Frame:
    """The frame in an image file.

    raises  OSError when it cannot be read, ValueError saying what is wrong with it
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ValueError(f"the file of {size / 2**20:.0f} MiB is beyond the limit of {MAX_BYTES / 2**20:.0f} MiB")
    return frame_from_file(path.read_bytes(), stamp_ns)


def frame_from_file(data: bytes, stamp_ns: int) -> Frame:
    """The frame in an image file's bytes.

    raises  ValueError saying what is wrong with them
    """
    if data.startswith(JPEG_START) and not _jpeg_is_whole(data):
        raise ValueError("the JPEG ends before its picture does")
    if data.startswith(PNG_START) and PNG_END not in data:
        raise ValueError("the PNG ends before its picture does")
    frame = pixels_from_file(data, stamp_ns)
    if data.startswith(JPEG_START):
        return _compressed(frame, PixelFormat.JPEG, data)
    if data.startswith(PNG_START):
        return _compressed(frame, PixelFormat.PNG, data)
    return frame


def pixels_from_file(data: bytes, stamp_ns: int) -> Frame:
    """The pixels of an image file, whatever its format, as a raw frame.

    raises  ValueError saying what is wrong with it
    """
    if not data:
        raise ValueError("the file is empty")
    told = _told_size(data)
    if told is not None:  # a decoder would first make room for whatever it says
        _hold_to_limit(*told)
    try:
        # Stored pixels, not turned by EXIF: the mirror's place in the sensor is what counts.
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(f"OpenCV refuses it: {error.err}") from error
    if pixels is None:
        raise ValueError("OpenCV cannot read it as an image")
    return frame_from_pixels(np.asarray(pixels), stamp_ns)


def frame_from_pixels(pixels: NDArray[Any], stamp_ns: int, *, colour: bool = True) -> Frame:
    """Pixels as OpenCV gives them, as a frame.

    pixels  (H, W) or (H, W, 1 | 3 | 4), 8 or 16 bits; colours blue green red, a fourth plane is left out
    colour  keep it; else grey, as vision would make it
    raises  ValueError on any other form
    """
    if pixels.dtype == np.uint16:
        pixels = (pixels // 256).astype(np.uint8)
    if pixels.dtype != np.uint8:
        raise ValueError(f"pixels of type {pixels.dtype} instead of 8 or 16 bits")
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = pixels[:, :, :3]
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3):
        raise ValueError(f"an image of shape {pixels.shape} is neither grey nor colour")
    height, width = pixels.shape[:2]
    _hold_to_limit(width, height)
    if pixels.ndim == 3 and not colour:
        pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    form = PixelFormat.GREY8 if pixels.ndim == 2 else PixelFormat.BGR8
    return Frame(stamp_ns, form, width, height, np.ascontiguousarray(pixels, np.uint8).reshape(-1))


def _compressed(frame: Frame, form: PixelFormat, data: bytes) -> Frame:
    return Frame(frame.stamp_ns, form, frame.width_px, frame.height_px, np.frombuffer(data, np.uint8))


def _hold_to_limit(width: int, height: int) -> None:
    if not (1 <= height <= MAX_SIDE_PX and 1 <= width <= MAX_SIDE_PX):
        raise ValueError(f"an image of {width} x {height} pixels is beyond the limit of {MAX_SIDE_PX}")


def _told_size(data: bytes) -> tuple[int, int] | None:
    """Width and height as the header of a JPEG or PNG tells them; None when it does not."""
    if data.startswith(PNG_START) and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    if data.startswith(JPEG_START):
        for marker, at in _jpeg_parts(data):
            if marker in JPEG_SIZES and at + 9 <= len(data):
                height, width = struct.unpack_from(">HH", data, at + 5)
                return int(width), int(height)
    return None


def _jpeg_is_whole(data: bytes) -> bool:
    """Whether the end marker follows the picture. Decoders fill what is missing with grey and only warn.

    The search starts behind the headers, because a thumbnail in there has an end marker of its own.
    """
    return any(marker == JPEG_SCAN and data.find(JPEG_END, at) >= 0 for marker, at in _jpeg_parts(data))


def _jpeg_parts(data: bytes) -> Iterator[tuple[int, int]]:
    """Marker and place of each header, the last one the first scan's."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        yield marker, at
        if marker == JPEG_SCAN:
            return
        # Some markers have no length.
        at += 2 if marker == 0x01 or 0xD0 <= marker <= 0xD7 else 2 + int(struct.unpack_from(">H", data, at + 2)[0])
