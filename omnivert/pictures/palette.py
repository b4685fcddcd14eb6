"""Colours of tracks: as many as there are tracks, all equally bright, so that none is hard to read."""

import colorsys

import numpy as np

Colour = tuple[int, int, int]  # blue, green, red

LUMINANCE = 0.42  # relative, of WCAG 2: 9 : 1 against black, and 6 : 1 on its backing over white
_GOLDEN_TURN = 0.618034  # of the colour circle: consecutive numbers get colours far apart
# Hues in degrees, evenly spaced as the eye has it (equal steps in Oklab at this luminance): the circle of HSV gives a
# third of itself to greens that look the same.
_EVEN_HUES = (0.0, 33.0, 46.0, 70.0, 105.0, 156.0, 177.0, 194.0, 209.0, 278.0, 298.0, 317.0, 360.0)


def track_color(track_id: int) -> Colour:
    """The track's colour in every picture."""
    turn = track_id * _GOLDEN_TURN % 1.0
    hue = np.interp(turn * (len(_EVEN_HUES) - 1), np.arange(len(_EVEN_HUES)), _EVEN_HUES) / 360.0
    light = np.power(colorsys.hsv_to_rgb(float(hue), 1.0, 1.0), 2.2)
    given = luminance(light)
    # Too dark: mixed with white; too bright: less of it. Either way the luminance is met and the hue is kept.
    mixed = (
        light * (LUMINANCE / given) if given > LUMINANCE else light + (1 - light) * (LUMINANCE - given) / (1 - given)
    )
    red, green, blue = (round(255 * float(part)) for part in np.power(mixed, 1 / 2.2))
    return blue, green, red


def luminance(rgb_linear: np.ndarray) -> float:
    """Relative luminance of linear red, green, blue in 0 .. 1."""
    return float(np.dot((0.2126, 0.7152, 0.0722), rgb_linear))
