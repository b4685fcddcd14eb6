"""Walls and what hangs or stands at them -> panels and columns."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnivert.simulation.place import Fixture, Kind, Place, Wall, stretches
from omnivert.simulation.surfaces import Look, Panel, Round
from omnivert.simulation.tiles import Tile

Array = NDArray[np.float64]
Things = tuple[list[Panel], list[Round]]

OFF_M = 0.01  # what hangs on a wall is in front of it by this
_SEED = 1988  # of the backs of books


@dataclass(frozen=True, slots=True)
class Usual:
    """What a fixture is when nothing is said of it."""

    width_m: float
    low_m: float
    high_m: float
    depth_m: float
    look: Look


USUAL: dict[Kind, Usual] = {
    "door": Usual(0.95, 0.0, 2.1, 0.05, Look(0.25, Tile.WOOD, 0.12)),
    "window": Usual(1.4, 0.9, 2.3, 0.06, Look(1.0, Tile.PLAIN, 0.0)),
    "poster": Usual(0.7, 1.0, 1.9, OFF_M, Look(0.4, Tile.PAINTING, 0.35)),
    "board": Usual(1.6, 0.9, 1.9, 0.03, Look(0.85, Tile.PLAIN, 0.0)),
    "shelf": Usual(0.9, 0.0, 1.9, 0.35, Look(0.3, Tile.WOOD, 0.1)),
    "cabinet": Usual(0.8, 0.0, 1.25, 0.4, Look(0.35, Tile.PLASTER, 0.03)),
    "pilaster": Usual(0.3, 0.0, 0.0, 0.14, Look(0.7, Tile.PLASTER, 0.03)),
    "pipe": Usual(0.09, 0.0, 0.0, 0.06, Look(0.75, Tile.PLAIN, 0.0)),
}
"""A height of 0 is that of the wall."""


@dataclass(frozen=True, slots=True)
class _Site:
    """A stretch of wall: its points by metres along it and off it, into the room."""

    start: Array
    along: Array  # unit vector
    off: Array

    def at(self, along_m: float, off_m: float) -> tuple[float, float]:
        x, y = self.start + along_m * self.along + off_m * self.off
        return float(x), float(y)


def built(place: Place) -> Things:
    """Everything in the room that does not move."""
    panels: list[Panel] = []
    rounds: list[Round] = []
    rng = np.random.default_rng(_SEED)
    for wall in place.wall:
        more = _walls(wall, place.ceiling.high_m, rng)
        panels += more[0]
        rounds += more[1]
    for pillar in place.pillar:
        high = pillar.high_m or place.ceiling.high_m
        rounds.append(Round(pillar.at, pillar.radius_m, 0.0, high, Look(pillar.brightness)))
    return panels, rounds


def _walls(wall: Wall, ceiling_m: float, rng: np.random.Generator) -> Things:
    high = wall.high_m or ceiling_m
    panels: list[Panel] = []
    rounds: list[Round] = []
    began_m = 0.0
    for a, b, length in stretches(wall):
        panels.append(Panel(a, b, 0.0, high, Look(wall.brightness)))
        along = (np.array(b) - a) / max(length, 1e-9)
        site = _Site(np.array(a), along, np.array([-along[1], along[0]]))
        for fixture in wall.fixtures:
            if began_m <= fixture.at_m < began_m + length:
                more = _fixture(fixture, site, fixture.at_m - began_m, high, rng)
                panels += more[0]
                rounds += more[1]
        began_m += length
    return panels, rounds


def _fixture(fixture: Fixture, site: _Site, at_m: float, wall_m: float, rng: np.random.Generator) -> Things:
    usual = USUAL[fixture.kind]
    width, depth = fixture.width_m or usual.width_m, fixture.depth_m or usual.depth_m
    low = usual.low_m if fixture.low_m is None else fixture.low_m
    high = min(fixture.high_m or usual.high_m or wall_m, wall_m)
    bright = usual.look.brightness if fixture.brightness is None else fixture.brightness
    look = Look(bright, usual.look.tile, usual.look.contrast)
    left, right = at_m - 0.5 * width, at_m + 0.5 * width
    kind = fixture.kind
    if low >= high:  # where it would hang is no wall any more
        return [], []
    match kind:
        case "pipe":
            return [], [Round(site.at(at_m, depth), 0.5 * width, low, high, look, kind)]
        case "door":
            frame, jamb = Look(0.75, Tile.PLAIN, 0.0), 0.08
            return [
                Panel(site.at(left, OFF_M), site.at(right, OFF_M), low, high, look, kind),
                *_box(site, left - jamb, left, depth, low, high + jamb, frame, "door_frame"),
                *_box(site, right, right + jamb, depth, low, high + jamb, frame, "door_frame"),
                Panel(site.at(left, depth), site.at(right, depth), high, high + jamb, frame, "door_frame"),
            ], []
        case "window" | "board":
            frame, bar = Look(0.2, Tile.PLAIN, 0.0), 0.05
            middle = [0.5 * (left + right - bar)] if kind == "window" else []
            bars = [left - bar, right, *middle]
            return [
                Panel(site.at(left, OFF_M), site.at(right, OFF_M), low, high, look, kind),
                *(
                    Panel(site.at(at, depth), site.at(at + bar, depth), low - bar, high + bar, frame, f"{kind}_frame")
                    for at in bars
                ),
            ], []
        case "shelf":
            return [
                *_box(site, left, right, depth, low, high, look, kind),
                *_books(site, left, right, depth, high, rng),
            ], []
        case "cabinet" | "pilaster":
            return _box(site, left, right, depth, low, high, look, kind), []
        case "poster":
            return [Panel(site.at(left, depth), site.at(right, depth), low, high, look, kind)], []


def _box(
    site: _Site, left: float, right: float, depth: float, low: float, high: float, look: Look, kind: str
) -> list[Panel]:
    """Two sides and a front."""
    corners = [site.at(left, 0.0), site.at(left, depth), site.at(right, depth), site.at(right, 0.0)]
    return [Panel(a, b, low, high, look, kind) for a, b in pairwise(corners)]


def _books(site: _Site, left: float, right: float, depth: float, high: float, rng: np.random.Generator) -> list[Panel]:
    """Rows of backs in front of a shelf, each of its own width, height and colour."""
    books: list[Panel] = []
    for board in np.arange(0.75, high - 0.3, 0.38).tolist():
        at = left + 0.05
        while (end := at + rng.uniform(0.06, 0.16)) < right - 0.05:
            look = Look(float(rng.choice([0.08, 0.2, 0.4, 0.65])), Tile.PLAIN, 0.0)
            top = board + rng.uniform(0.2, 0.32)
            books.append(Panel(site.at(at, depth + OFF_M), site.at(end, depth + OFF_M), board, top, look, "book"))
            at = end
    return books
