"""A frame with its ring and lines in it."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Bearings, Frame
from omnivert.pictures.overlay import overlay
from omnivert.vision.image import grey_from_frame


def drawn_frame(frame: Frame, bearings: Bearings, config: Config) -> NDArray[np.uint8] | None:
    """(H, W, 3) the frame with what was found in it; None when the frame cannot be read."""
    try:
        grey = grey_from_frame(frame)
    except ValueError:
        return None
    return overlay(grey, bearings, config.camera.bearing_sign, config.ring.r_min_px)


def write_drawn(path: Path, frame: Frame, bearings: Bearings, config: Config) -> None:
    """Write it as PNG; a frame that cannot be read leaves none.

    raises  DataError when the file cannot be written
    """
    drawn = drawn_frame(frame, bearings, config)
    if drawn is None:
        return
    _, file = cv2.imencode(".png", drawn)
    try:
        path.write_bytes(file.tobytes())
    except OSError as error:
        raise DataError("OV322", f"cannot write {path}", str(error.strerror or error)) from error
