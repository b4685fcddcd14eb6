"""Ring and tracked lines drawn into the frame that they were found in."""

import colorsys

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Bearings

Bgr = NDArray[np.uint8]

_GOLDEN_TURN = 0.618034  # of the colour circle: consecutive numbers get colours far apart
_RING = (255, 255, 0)
_SHIFT = 4  # OpenCV takes coordinates in sixteenths of a pixel


def overlay(picture: NDArray[np.uint8], bearings: Bearings, bearing_sign: int, r_min_px: float) -> Bgr:
    """A copy of the picture in colour, with the ring and each line in its track's colour, its number at the rim.

    picture       (H, W) or (H, W, 3) uint8
    bearing_sign  +1 or -1, as in the configuration
    r_min_px      where the lines begin
    A line of many frames is drawn thick, a new one thin; numbers stand where there is room, reasons in the corner.
    """
    grey = picture.ndim == 2
    drawn = np.ascontiguousarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if grey else picture.copy(), dtype=np.uint8)
    size = max(drawn.shape[0] / 480.0, 0.5)
    for row, reason in enumerate(bearings.reasons):
        _text(drawn, reason, (6.0, 16.0 * size * (row + 1)), (80, 160, 255), 0.45 * size)
    ring = bearings.ring
    if ring is None:
        return drawn
    center = np.array([ring.center_u_px, ring.center_v_px])
    for radius in (r_min_px, ring.radius_px):
        cv2.circle(drawn, _point(center), round(radius * 2**_SHIFT), _RING, 1, cv2.LINE_AA, _SHIFT)
    cv2.drawMarker(drawn, (round(center[0]), round(center[1])), _RING, cv2.MARKER_CROSS, 9, 1)
    taken: list[NDArray[np.float64]] = []
    for i in np.argsort(-bearings.age_frames, kind="stable"):  # where numbers would lie on each other, the oldest stays
        angle, track = bearing_sign * float(bearings.bearing_rad[i]), int(bearings.track_id[i])
        ray = np.array([np.cos(angle), -np.sin(angle)])
        thickness = max(round((2 if bearings.age_frames[i] >= 5 else 1) * size), 1)
        ends = _point(center + ray * r_min_px), _point(center + ray * ring.radius_px)
        cv2.line(drawn, *ends, track_color(track), thickness, cv2.LINE_AA, _SHIFT)
        place = center + ray * (ring.radius_px + 9.0 * size)
        if all(np.hypot(*((place - other) / (18.0, 9.0))) >= size for other in taken):
            taken.append(place)
            _text(drawn, str(track), place, track_color(track), 0.34 * size, middle=True)
    return drawn


def track_color(track_id: int) -> tuple[int, int, int]:
    """The track's colour in every picture, BGR."""
    red, green, blue = colorsys.hsv_to_rgb(track_id * _GOLDEN_TURN % 1.0, 0.85, 1.0)
    return round(255 * blue), round(255 * green), round(255 * red)


def _point(place: NDArray[np.float64]) -> tuple[int, int]:
    return round(float(place[0]) * 2**_SHIFT), round(float(place[1]) * 2**_SHIFT)


def _text(
    drawn: Bgr,
    text: str,
    place: NDArray[np.float64] | tuple[float, float],
    color: tuple[int, int, int],
    scale: float,
    *,
    middle: bool = False,
) -> None:
    font = cv2.FONT_HERSHEY_SIMPLEX
    (width, height), _ = cv2.getTextSize(text, font, scale, 1)
    at = (round(place[0] - width / 2), round(place[1] + height / 2)) if middle else (round(place[0]), round(place[1]))
    cv2.putText(drawn, text, at, font, scale, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(drawn, text, at, font, scale, color, 1, cv2.LINE_AA)
