"""Frame -> grey picture."""

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Frame, PixelFormat

Grey = NDArray[np.uint8]

WORK_RADIUS_PX = 288.0
"""Radius of a larger rim's picture when it is worked on; at 256 px the two sides of thin bars run together, at 320 blur
costs lines."""

# The way the camera was held says nothing about the sensor that the ring was measured on, so EXIF turns nothing here.
_READ = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_JPEG_END = b"\xff\xd9"
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers of the part that tells the size
_JPEG_PADDING = 1024  # bytes that some cameras append after the end marker, at most


def grey_from_frame(frame: Frame) -> Grey:
    """The frame's picture in grey, (height, width) uint8.

    raises  ValueError in words fit for `reasons`, when the bytes are no such picture
    """
    height, width = frame.height_px, frame.width_px
    match frame.format:
        case PixelFormat.GREY8:
            return _raw(frame, 1).reshape(height, width)
        case PixelFormat.BGR8:
            grey = cv2.cvtColor(_raw(frame, 3).reshape(height, width, 3), cv2.COLOR_BGR2GRAY)
        case PixelFormat.JPEG | PixelFormat.PNG:
            grey = _decoded(frame)
    return np.asarray(grey, dtype=np.uint8)


def shrunk(grey: Grey, scale: float) -> Grey:
    """The picture at this share of its size; at 1 and above as it is."""
    if scale >= 1.0:
        return grey
    size = max(round(grey.shape[1] * scale), 1), max(round(grey.shape[0] * scale), 1)
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _raw(frame: Frame, channels: int) -> NDArray[np.uint8]:
    expected = frame.height_px * frame.width_px * channels
    if frame.data.size != expected:
        raise ValueError(
            f"{frame.format} frame {frame.width_px}x{frame.height_px} holds {frame.data.size} bytes, not {expected}"
        )
    return np.ascontiguousarray(frame.data)


def _decoded(frame: Frame) -> NDArray[np.uint8]:
    # A JPEG that was cut off still decodes, to a picture whose rest is flat grey with a hard false edge.
    if frame.format is PixelFormat.JPEG and _JPEG_END not in frame.data[-_JPEG_PADDING:].tobytes():
        raise ValueError("jpeg frame is cut off")
    told = _told_size(frame.data.data, frame.format)
    if told is not None:  # a decoder would first make room for whatever it says
        _hold_to_size(frame, *told)
    try:
        grey = cv2.imdecode(frame.data, _READ) if frame.data.size else None
    except cv2.error as error:
        raise ValueError(f"{frame.format} frame cannot be decoded") from error
    if grey is None:
        raise ValueError(f"{frame.format} frame cannot be decoded")
    _hold_to_size(frame, grey.shape[1], grey.shape[0])
    return np.asarray(grey, dtype=np.uint8)


def _hold_to_size(frame: Frame, width: int, height: int) -> None:
    if (width, height) != (frame.width_px, frame.height_px):
        raise ValueError(f"{frame.format} frame says {frame.width_px}x{frame.height_px}, holds {width}x{height}")


def _told_size(data: memoryview, form: PixelFormat) -> tuple[int, int] | None:
    """Width and height as the file's header tells them; None when there is none to be read.

    raises  ValueError when a part of a PNG says that it is longer than the file
    """
    if form is PixelFormat.PNG:
        at = 8
        while at + 8 <= len(data):
            length = int.from_bytes(data[at : at + 4])
            if at + 12 + length > len(data):
                raise ValueError("png frame cannot be decoded")
            at += 12 + length
        return (int.from_bytes(data[16:20]), int.from_bytes(data[20:24])) if len(data) >= 24 else None
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _JPEG_SIZES:
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return None
