"""ROS's images and laser scans as frames and scans."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.drivers.image_file import frame_from_file, frame_from_pixels
from omnivert.errors import DataError
from omnivert.formats.rosbag.file import Received
from omnivert.messages import Frame, Scan

Pixels = NDArray[Any]

_LONGEST_RANGE_M = 1e4  # what a Scan can say
_CHANNELS = {  # encoding -> its planes and bits; what is not here is no picture of light
    **dict.fromkeys(("mono8", "8UC1"), (1, 8)),
    **dict.fromkeys(("bgr8", "rgb8", "8UC3"), (3, 8)),
    **dict.fromkeys(("bgra8", "rgba8", "8UC4"), (4, 8)),
    **dict.fromkeys(("mono16", "16UC1"), (1, 16)),
    **dict.fromkeys(("bgr16", "rgb16", "16UC3"), (3, 16)),
    **dict.fromkeys(("bgra16", "rgba16", "16UC4"), (4, 16)),
    **{f"bayer_{order}{bits}": (1, bits) for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)},
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), (2, 8)),
}
_BAYER = {  # grey, because the vision sees no colours, and three planes would only take three times the room
    "rggb": cv2.COLOR_BayerRGGB2GRAY,
    "bggr": cv2.COLOR_BayerBGGR2GRAY,
    "gbrg": cv2.COLOR_BayerGBRG2GRAY,
    "grbg": cv2.COLOR_BayerGRBG2GRAY,
}


def frame(received: Received, stamp_ns: int) -> Frame:
    """The picture of a sensor_msgs/Image or CompressedImage.

    JPEG and PNG stay the bytes that they are, everything else becomes grey or colours of 8 bits.

    raises  DataError naming the message
    """
    content = received.content
    try:
        if hasattr(content, "format"):
            return _compressed(content, stamp_ns)
        return frame_from_pixels(_pixels(content), stamp_ns)
    except (ValueError, cv2.error) as error:
        raise DataError("OV333", received.place, str(error), "omnivert explain OV333") from error


def scan(received: Received, stamp_ns: int) -> Scan:
    """The sweep of a sensor_msgs/LaserScan; what is no echo in its range is 0.

    raises  DataError naming the message
    """
    content = received.content
    angles = float(content.angle_min), float(content.angle_increment)
    if not (abs(angles[0]) <= 7.0 and abs(angles[1]) <= 1.0):
        because = f"angle_min = {angles[0]:g}, angle_increment = {angles[1]:g}: no angles in radians"
        raise DataError("OV333", received.place, because, "omnivert explain OV333")
    range_m = np.asarray(content.ranges, dtype=np.float32)
    least, most = max(float(content.range_min), 0.0), min(float(content.range_max), _LONGEST_RANGE_M)
    heard = (range_m >= least) & (range_m <= most)  # false of NaN, too
    return Scan(stamp_ns, *angles, np.where(heard, range_m, np.float32(0.0)))


def _compressed(content: Any, stamp_ns: int) -> Frame:
    said = str(content.format)
    if "compressedDepth" in said:
        raise ValueError(f"its format is {said!r}: distances, no picture")
    return frame_from_file(np.asarray(content.data, dtype=np.uint8).tobytes(), stamp_ns)


def _pixels(content: Any) -> Pixels:
    """(H, W) or (H, W, 3 | 4) as OpenCV has them: blue green red."""
    encoding = str(content.encoding)
    if encoding not in _CHANNELS:
        known = "mono, bgr, rgb, bayer and yuv422 are read"
        raise ValueError(f"its encoding is {encoding[:40]!r}; {known}")
    planes, bits = _CHANNELS[encoding]
    height, width, step = int(content.height), int(content.width), int(content.step)
    row = width * planes * bits // 8
    data = np.asarray(content.data, dtype=np.uint8)
    if not height or not width or step < row or data.size < step * (height - 1) + row:
        raise ValueError(
            f"an image of {width} x {height} in {encoding} with rows of {step} bytes does not fit its {data.size} bytes"
        )
    if data.size < step * height:  # some leave out what fills up the last row
        data = np.pad(data, (0, step * height - data.size))
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row])
    if bits == 16:
        rows = rows[:, 0::2] if content.is_bigendian else rows[:, 1::2]  # the upper one of two bytes
    pixels = rows.reshape(height, width, planes) if planes > 1 else rows
    return _as_opencv(encoding)(pixels)


def _as_opencv(encoding: str) -> Callable[[Pixels], Pixels]:
    """What turns pixels of this encoding into those that OpenCV would give."""
    match encoding.rstrip("0123456789"):
        case "rgb":
            return lambda pixels: pixels[:, :, ::-1]
        case "rgba":
            return lambda pixels: pixels[:, :, 2::-1]
        case bayer if bayer.startswith("bayer_"):
            return lambda pixels: np.asarray(cv2.cvtColor(pixels, _BAYER[bayer.removeprefix("bayer_")]))
        case "yuv" | "uyvy":  # yuv422 is uyvy: the grey value is the second byte of each pair
            return lambda pixels: pixels[:, :, 1]
        case "yuv422_yuy" | "yuyv":
            return lambda pixels: pixels[:, :, 0]
        case _:
            return lambda pixels: pixels
