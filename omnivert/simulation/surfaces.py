"""Everything upright in a room, as arrays for the kernels: flat panels and round columns, with their vertical edges."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.simulation.tiles import Tile

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME_M = 1e-3  # ends of panels nearer to each other than this are one edge
SILHOUETTES, MOVING = 900_000, 950_000  # ids from here on: edges of round things, and of things that move


@dataclass(frozen=True, slots=True)
class Look:
    """How a surface looks."""

    brightness: float  # light that it gives back, 0 to 1
    tile: Tile = Tile.PLASTER
    contrast: float = 0.03  # sigma of the texture, relative to the brightness


@dataclass(frozen=True, slots=True)
class Panel:
    """A flat, upright rectangle, seen from both sides."""

    start: tuple[float, float]  # m
    end: tuple[float, float]
    low_m: float
    high_m: float
    look: Look
    kind: str = "wall"


@dataclass(frozen=True, slots=True)
class Round:
    """An upright column."""

    at: tuple[float, float]  # m
    radius_m: float
    low_m: float
    high_m: float
    look: Look
    kind: str = "pillar"


@dataclass(frozen=True, slots=True)
class Edge:
    """A vertical edge that stays where it is."""

    line_id: int
    x_m: float
    y_m: float
    low_m: float
    high_m: float
    kind: str


class Surfaces(NamedTuple):
    """P surfaces, the flat ones first.

    place    (P, 4)  m  both ends of a panel; centre and radius (twice) of a column
    heights  (P, 2)  m  low, high
    look     (P, 3)     brightness, contrast, how the light falls on it
    tile     (P,)
    line     (P, 2)     id of the line at each end; of a column's right and left silhouette
    flat             how many of them are panels
    """

    place: Array
    heights: Array
    look: Array
    tile: Ints
    line: Ints
    flat: int

    def beside(self, rounds: list[Round], first_id: int) -> "Surfaces":
        """With more columns, whose silhouettes are counted from `first_id`."""
        if not rounds:
            return self
        more, _ = surfaces([], rounds, first_id)
        place, heights, look, tile, line = (np.concatenate(pair) for pair in zip(self[:5], more[:5], strict=True))
        return Surfaces(place, heights, look, tile, line, self.flat)


def surfaces(
    panels: list[Panel], rounds: list[Round], first_id: int = SILHOUETTES
) -> tuple[Surfaces, tuple[Edge, ...]]:
    """The arrays of these things, and the lines of the panels. Ends that meet are one line, as high as all together."""
    edges: dict[tuple[int, int], Edge] = {}
    line = np.zeros((len(panels) + len(rounds), 2), dtype=np.int64)
    for index, panel in enumerate(panels):
        for side, (x, y) in enumerate((panel.start, panel.end)):
            at = (round(x / SAME_M), round(y / SAME_M))
            known = edges.get(at) or Edge(len(edges) + 1, x, y, panel.low_m, panel.high_m, panel.kind)
            low, high = min(known.low_m, panel.low_m), max(known.high_m, panel.high_m)
            edges[at] = replace(known, low_m=low, high_m=high)
            line[index, side] = known.line_id
    for index in range(len(rounds)):
        line[len(panels) + index] = first_id + 2 * index, first_id + 2 * index + 1
    everything: list[Panel | Round] = [*panels, *rounds]
    arrays = Surfaces(
        place=np.array([_place(thing) for thing in everything], dtype=np.float64).reshape(-1, 4),
        heights=np.array([(thing.low_m, thing.high_m) for thing in everything], dtype=np.float64).reshape(-1, 2),
        look=np.array([(t.look.brightness, t.look.contrast, _lit(t)) for t in everything]).reshape(-1, 3),
        tile=np.array([int(thing.look.tile) for thing in everything], dtype=np.int64),
        line=line,
        flat=len(panels),
    )
    return arrays, tuple(edges.values())


def _place(thing: Panel | Round) -> tuple[float, float, float, float]:
    if isinstance(thing, Panel):
        return *thing.start, *thing.end
    return *thing.at, thing.radius_m, thing.radius_m


def _lit(thing: Panel | Round) -> float:
    """How much of the light falls on it: walls across one another differ, so that a corner can be seen."""
    if isinstance(thing, Round):
        return 1.0
    direction = np.arctan2(thing.end[1] - thing.start[1], thing.end[0] - thing.start[0])
    return float(1.0 + 0.13 * np.cos(2.0 * direction + 0.5))
