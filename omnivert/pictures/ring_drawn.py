"""A measured ring drawn into a picture, for a person to approve."""

import cv2
import numpy as np

from omnivert.config import MirrorRing
from omnivert.pictures.labels import Bgr, Labels
from omnivert.pictures.overlay import magnification
from omnivert.pictures.palette import Colour
from omnivert.vision.image import Grey

_DARK, _RIM, _INNER, _FAINT = (24, 20, 18), (120, 220, 255), (120, 255, 160), (150, 150, 150)
_LETTERS, _BAND, _DESIGNED_FOR_PX = 15.0, 30.0, 960.0
_SHIFT = 4  # OpenCV takes coordinates in sixteenths of a pixel
_LABEL_AT_DEG = (45.0, 135.0, -45.0, -135.0, 90.0, -90.0, 0.0, 180.0)  # of a circle, where its label may stand


def ring_picture(grey: Grey, ring: MirrorRing, title: str, rmin_is_guessed: bool = False) -> Bgr:
    """(H, W, 3) the picture, enlarged when it is small, with the rim, the inner end and the centre, each labelled.

    title            stands in a band above it
    rmin_is_guessed  Rmin is drawn dashed: nothing in the pictures tells it
    """
    k = magnification(*grey.shape)
    unit = max(k * min(grey.shape) / _DESIGNED_FOR_PX, 0.75)
    band = round(_BAND * unit)
    height, width = grey.shape
    drawn = np.zeros((band + k * height, k * width, 3), dtype=np.uint8)
    large = cv2.resize(grey, (k * width, k * height), interpolation=cv2.INTER_LINEAR)
    drawn[band:] = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    u, v = (k * (place + 0.5) - 0.5 for place in ring.center_px)
    center = u, v + band
    labels = Labels(drawn, _LETTERS * unit, band)
    labels.band(title, "", (240, 240, 240), _FAINT)
    _draw_circle(drawn, center, k * ring.r_max_px, _RIM, unit, dashed=False)
    _draw_circle(drawn, center, k * ring.r_min_px, _INNER, unit, dashed=rmin_is_guessed)
    _draw_cross(drawn, center, unit)
    at_center = f"centre ({ring.center_px[0]:.1f}, {ring.center_px[1]:.1f})"
    labels.place(at_center, (240, 240, 240), [(center[0], center[1] + side * 26.0 * unit) for side in (1.0, -1.0)])
    guessed = ", a guess" if rmin_is_guessed else ""
    for text, radius, color in (
        (f"Rmin {ring.r_min_px:.1f}{guessed}", ring.r_min_px, _INNER),
        (f"Rmax {ring.r_max_px:.1f}", ring.r_max_px, _RIM),
    ):
        reach = k * radius + 0.6 * labels.extent(text)[0]
        turns = np.deg2rad(_LABEL_AT_DEG)
        places = [
            (center[0] + far * np.cos(a), center[1] - far * np.sin(a)) for far in (reach, 0.8 * reach) for a in turns
        ]
        labels.place(text, color, places)
    labels.write()
    return drawn


def _draw_circle(
    drawn: Bgr, center: tuple[float, float], radius: float, color: Colour, unit: float, dashed: bool
) -> None:
    at = round(center[0] * 2**_SHIFT), round(center[1] * 2**_SHIFT)
    axes = (round(radius * 2**_SHIFT),) * 2
    step, length = (10, 5) if dashed else (360, 360)
    for stroke, thickness in ((_DARK, 3.0), (color, 1.0)):
        for start in range(0, 360, step):
            wide = max(round(thickness * unit), 1)
            cv2.ellipse(drawn, at, axes, 0.0, start, start + length, stroke, wide, cv2.LINE_AA, _SHIFT)


def _draw_cross(drawn: Bgr, center: tuple[float, float], unit: float) -> None:
    arm = 10.0 * unit
    for stroke, thickness in ((_DARK, 3.0), ((240, 240, 240), 1.0)):
        for along, down in ((arm, 0.0), (0.0, arm)):
            start, end = (
                (round((center[0] + side * along) * 2**_SHIFT), round((center[1] + side * down) * 2**_SHIFT))
                for side in (-1, 1)
            )
            cv2.line(drawn, start, end, stroke, max(round(thickness * unit), 1), cv2.LINE_AA, _SHIFT)
