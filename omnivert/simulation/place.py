"""A world file: the room, what stands and walks in it, and the camera on the robot; TOML that a person can write."""

from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from omnivert.config.section import Section

Coordinate = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
Point = Annotated[tuple[Coordinate, Coordinate], Strict(False)]
Pose = Annotated[tuple[Coordinate, Coordinate, Annotated[float, Field(ge=-36_000.0, le=36_000.0)]], Strict(False)]
Metres = Annotated[float, Field(gt=0.0, le=1000.0)]
Brightness = Annotated[float, Field(ge=0.0, le=1.0)]
Kind = Literal["door", "window", "poster", "board", "shelf", "cabinet", "pilaster", "pipe"]


class Fixture(Section):
    """Something on a wall. What is not given is as usual for its kind."""

    kind: Kind
    at_m: float = Field(ge=0.0)
    """Of its middle, along the wall from its first point."""
    width_m: Metres | None = None
    low_m: float | None = Field(None, ge=0.0)
    high_m: Metres | None = None
    depth_m: Metres | None = None
    brightness: Brightness | None = None

    @model_validator(mode="after")
    def _is_upright(self) -> Self:
        if self.low_m is not None and self.high_m is not None and self.low_m >= self.high_m:
            raise ValueError("low_m must be below high_m")
        return self


class Wall(Section):
    """Straight walls from point to point; the room lies to the left of the way along them."""

    points: Annotated[tuple[Point, ...], Strict(False), Field(min_length=2)]
    closed: bool = False
    """The last point is joined to the first."""
    brightness: Brightness = 0.55
    high_m: Metres | None = None
    """Up to the ceiling without it."""
    fixtures: Annotated[tuple[Fixture, ...], Strict(False)] = ()


class Pillar(Section):
    """A round column."""

    at: Point
    radius_m: Metres = 0.2
    high_m: Metres | None = None
    brightness: Brightness = 0.6


class Person(Section):
    """Somebody who walks to and fro along a way, for ever."""

    way: Annotated[tuple[Point, ...], Strict(False), Field(min_length=2)]
    speed_m_s: float = Field(0.9, gt=0.0, le=10.0)
    brightness: Brightness = 0.18


class Ceiling(Section):
    """Above, with lamps in rows."""

    high_m: Metres = 2.8
    brightness: Brightness = 0.6
    lamps_x_m: Metres = 3.0
    """From lamp to lamp, along x."""
    lamps_y_m: Metres = 2.4


class SimulatedCamera(Section):
    """Where it sits, its mirror, and how well it sees. Size, ring and rate are those of the robot's configuration."""

    phi_deg: float = Field(-19.5, ge=-180.0, le=180.0)
    rho_m: float = Field(0.23, ge=0.0, le=5.0)
    psi_deg: float = Field(18.9, ge=-180.0, le=180.0)
    height_m: Metres = 0.9
    """Of the mirror's focus above the floor."""
    eccentricity: float = Field(1.3017, gt=1.0, le=100.0)
    """Of the hyperboloid."""
    top_deg: float = Field(22.0, gt=0.0, le=60.0)
    """Elevation that the rim shows."""
    tilt_deg: float = Field(0.0, ge=0.0, le=15.0)
    """The mirror's axis leans by this ..."""
    tilt_toward_deg: float = Field(0.0, ge=-180.0, le=180.0)
    """... toward this bearing of the camera."""
    vibration_px: float = Field(0.5, ge=0.0, le=10.0)
    """Sigma of the ring's centre, each way, anew in each picture."""
    noise_grey: float = Field(2.0, ge=0.0, le=100.0)
    """Sigma of a pixel, in grey steps."""
    exposure_stops: float = Field(0.2, ge=0.0, le=4.0)
    """The exposure swings by this, as a power of two, once in 40 s."""
    shutter_s: float = Field(0.0, ge=0.0, le=0.2)
    """Time over which a turn smears the picture."""


class SimulatedLaser(Section):
    """A planar laser at the robot's origin, swept all around at each picture."""

    height_m: Metres = 0.35
    beams: int = Field(720, ge=1, le=10_000)
    range_m: float = Field(20.0, gt=0.0, le=1000.0)
    noise_m: float = Field(0.01, ge=0.0, le=1.0)


class Place(Section):
    """A whole world."""

    start: Pose = (0.0, 0.0, 0.0)
    """Of the robot: x, y in m, heading in degrees."""
    floor_brightness: Brightness = 0.3
    ceiling: Ceiling = Ceiling()
    camera: SimulatedCamera = SimulatedCamera()
    laser: SimulatedLaser = SimulatedLaser()
    wall: Annotated[tuple[Wall, ...], Strict(False), Field(min_length=1)]
    pillar: Annotated[tuple[Pillar, ...], Strict(False)] = ()
    person: Annotated[tuple[Person, ...], Strict(False)] = ()

    @model_validator(mode="after")
    def _camera_is_below_the_ceiling(self) -> Self:
        if self.camera.height_m >= self.ceiling.high_m:
            raise ValueError("camera.height_m must be below ceiling.high_m")
        return self

    @model_validator(mode="after")
    def _fixtures_are_on_their_walls(self) -> Self:
        for wall in self.wall:
            ends = np.cumsum([0.0, *(length for *_, length in stretches(wall))])
            for fixture in wall.fixtures:
                if fixture.at_m > ends[-1]:
                    raise ValueError(
                        f"the {fixture.kind} at_m = {fixture.at_m:g} is beyond its wall of {ends[-1]:.2f} m"
                    )
        return self


def stretches(wall: Wall) -> list[tuple[Point, Point, float]]:
    """The straight parts of a wall: from, to, length in m."""
    points = [*wall.points, *(wall.points[:1] if wall.closed else ())]
    return [(a, b, float(np.hypot(b[0] - a[0], b[1] - a[1]))) for a, b in pairwise(points)]
