"""People who walk about: where each of them is at a time, as round things."""

import numpy as np

from omnivert.simulation.place import Person
from omnivert.simulation.surfaces import Look, Round
from omnivert.simulation.tiles import Tile

BODY = ((0.13, 0.0, 0.85, 0.7), (0.21, 0.85, 1.5, 1.0), (0.10, 1.52, 1.78, 1.9))
"""Radius, from, to (m), brightness relative to the person's: legs, trunk, head."""
LATER_S = 4.3  # the next one walks the same way


def bodies(people: tuple[Person, ...], count: int, time_s: float) -> list[Round]:
    """So many people at a time since the start; those beyond `people` walk the same ways, each round of them later."""
    rounds = []
    for index in range(count if people else 0):
        person = people[index % len(people)]
        x, y = place_of(person, time_s + LATER_S * (index // len(people)))
        rounds += [
            Round((x, y), radius, low, high, Look(min(shade * person.brightness, 1.0), Tile.CARPET, 0.1), "person")
            for radius, low, high, shade in BODY
        ]
    return rounds


def place_of(person: Person, time_s: float) -> tuple[float, float]:
    """m, on the way to its end and back again"""
    way = np.array(person.way)
    ends = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    if ends[-1] == 0.0:
        return float(way[0, 0]), float(way[0, 1])
    gone = person.speed_m_s * time_s % (2.0 * ends[-1])
    along = min(gone, 2.0 * ends[-1] - gone)
    return float(np.interp(along, ends, way[:, 0])), float(np.interp(along, ends, way[:, 1]))
