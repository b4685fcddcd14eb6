"""The light from all around a camera: a column of radii for each column of azimuth, summed up along the azimuth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.simulation.columns import THIN, Columns
from omnivert.simulation.surfaces import Surfaces
from omnivert.simulation.tiles import Tile, Tone, level_of, tone

Array = NDArray[np.float64]
Short = NDArray[np.int16]
Light = NDArray[np.float32]

FLOOR, CEILING = -1, -2  # instead of a surface
LAMP_M = (1.2, 0.16)  # along x, along y
LAMP_LIGHT = 1.6
_CARPET = int(Tile.CARPET)
_SIGHT_RAD = 0.0067  # that a pixel sees, near the horizon
_DARKER_BELOW_M = 1.0  # less light comes to the foot of a wall


class Hall(NamedTuple):
    """Floor and ceiling, and the light above."""

    ceiling_m: float
    floor: float  # brightness
    ceiling: float
    lamps_x_m: float  # distance from lamp to lamp
    lamps_y_m: float


class View(NamedTuple):
    """A camera with its mirror.

    inner_px  radius at which its first row begins
    """

    x: float  # m, in the world
    y: float
    z: float
    heading: float  # rad
    k: float  # of the mirror, px
    xi: float
    inner_px: float
    rows: int


class Panorama(NamedTuple):
    """C columns and R rows; row i is one pixel of the radius, from `inner_px` + i on.

    light    (C, R)
    summed   (C+1, R)  integral of the light over the azimuth, from -pi on
    surface  (C, R)    what is seen there
    """

    light: Light
    summed: Array
    surface: Short


@compiled
def panorama(columns: Columns, things: Surfaces, tiles: Tone, hall: Hall, view: View) -> Panorama:
    """The light that comes to a camera."""
    total = columns.held.size
    light = np.zeros((total, view.rows), dtype=np.float32)
    summed = np.zeros((total + 1, view.rows))
    surface = np.full((total, view.rows), FLOOR, dtype=np.int16)
    slope = _slopes(view)
    for c in range(total):
        width = columns.bounds[c + 1] - columns.bounds[c]
        if width > THIN:
            _paint(columns, c, things, tiles, hall, view, slope, light[c], surface[c])
        for i in range(view.rows):
            summed[c + 1, i] = summed[c, i] + width * light[c, i]
    return Panorama(light, summed, surface)


@compiled
def _slopes(view: View) -> Array:
    """(R,) tangent of the elevation that each row's middle shows"""
    slope = np.empty(view.rows)
    for i in range(view.rows):
        r = view.inner_px + i + 0.5
        slope[i] = np.tan(np.arcsin(view.xi * r / np.hypot(view.k, r)) - np.arctan2(view.k, r))
    return slope


@compiled
def _row(view: View, slope: float) -> float:
    """Where an elevation's tangent appears, in rows; far away when no mirror of this form shows it"""
    below = view.xi * np.sqrt(1.0 + slope * slope) - slope
    return view.k / below - view.inner_px if below > 1e-9 else 1e9


@compiled
def _paint(
    columns: Columns,
    c: int,
    things: Surfaces,
    tiles: Tone,
    hall: Hall,
    view: View,
    slope: Array,
    light: Light,
    surface: Short,
) -> None:
    """One column: floor and ceiling, then what stands there, the farthest first."""
    last, foot = columns.held[c] - 1, _row(view, 0.0)
    top = foot
    for layer in range(columns.held[c]):
        p, far = columns.surface[c, layer], columns.distance[c, layer]
        if things.heights[p, 0] <= 0.0 and things.heights[p, 1] >= hall.ceiling_m:  # hides all that is behind it
            last, foot, top = layer, _row(view, -view.z / far), _row(view, (hall.ceiling_m - view.z) / far)
            break
    azimuth = 0.5 * (columns.bounds[c] + columns.bounds[c + 1]) + view.heading
    _paint_level(azimuth, tiles, hall, view, slope, foot, top, light, surface)
    for layer in range(last, -1, -1):
        p, far, along = columns.surface[c, layer], columns.distance[c, layer], columns.along[c, layer]
        low = max(_row(view, (things.heights[p, 0] - view.z) / far), 0.0)
        high = min(_row(view, (things.heights[p, 1] - view.z) / far), float(view.rows))
        level, texels, contrast = level_of(far * _SIGHT_RAD), tiles[things.tile[p]], things.look[p, 1]
        bright = things.look[p, 0] * things.look[p, 2]
        if p >= things.flat:
            bright *= 0.7 + 0.3 * along  # a round thing is darker where it turns away
        for i in range(int(low), min(int(np.ceil(high)), view.rows)):
            share = min(high, i + 1.0) - max(low, float(i))
            up = view.z + far * slope[i]
            value = bright * (0.72 + 0.28 * min(max(up, 0.0) / _DARKER_BELOW_M, 1.0))
            if contrast > 0.0:
                value *= 1.0 + contrast * tone(texels, level, along, up)
            light[i] = share * value + (1.0 - share) * light[i]
            if share >= 0.5:
                surface[i] = p


@compiled
def _paint_level(
    azimuth: float,
    tiles: Tone,
    hall: Hall,
    view: View,
    slope: Array,
    foot: float,
    top: float,
    light: Light,
    surface: Short,
) -> None:
    """Floor up to the row `foot`, ceiling from the row `top` on."""
    dx, dy = np.cos(azimuth), np.sin(azimuth)
    for i in range(min(int(np.ceil(foot)), view.rows)):
        far = view.z / max(-slope[i], 1e-6)
        level = level_of(far * _SIGHT_RAD)
        light[i] = hall.floor * (1.0 + 0.06 * tone(tiles[_CARPET], level, view.x + far * dx, view.y + far * dy))
        surface[i] = FLOOR
    for i in range(max(int(top), 0), view.rows):
        far = (hall.ceiling_m - view.z) / max(slope[i], 1e-6)
        x, y = view.x + far * dx, view.y + far * dy
        lit_x = abs(x % hall.lamps_x_m - 0.5 * hall.lamps_x_m) < 0.5 * LAMP_M[0]
        lit_y = abs(y % hall.lamps_y_m - 0.5 * hall.lamps_y_m) < 0.5 * LAMP_M[1]
        light[i] = LAMP_LIGHT if lit_x and lit_y else hall.ceiling
        surface[i] = CEILING
