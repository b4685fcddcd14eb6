"""A path file: legs, one after the other; and the commanded way of the wheels along them."""

from math import radians
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, Strict, model_validator

from omnivert.config.section import Section
from omnivert.simulation.place import Pose
from omnivert.simulation.robot import Leg, lasts_s, told_steps

Array = NDArray[np.float64]

MOST_DEG = 36_000.0  # of a leg's turn
MOST_S = 4.0 * 3600.0  # of a drive: every sample of it is held


class RouteLeg(Section):
    """One of: a way straight ahead, a turn on the spot, an arc, a rest. Negative: backward, clockwise."""

    straight_m: float | None = Field(None, ge=-1000.0, le=1000.0)
    turn_deg: float | None = Field(None, ge=-MOST_DEG, le=MOST_DEG)
    arc_m: float | None = Field(None, ge=-1000.0, le=1000.0)
    """Way along the arc ..."""
    radius_m: float | None = Field(None, ge=-1000.0, le=1000.0)
    """... about a point so far to the left, to the right when negative."""
    rest_s: float | None = Field(None, gt=0.0, le=3600.0)

    @model_validator(mode="after")
    def _is_one_thing(self) -> Self:
        given = [name for name in ("straight_m", "turn_deg", "arc_m", "rest_s") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError("a leg is one of straight_m, turn_deg, arc_m with radius_m, rest_s")
        if (self.arc_m is None) != (self.radius_m is None) or self.radius_m == 0.0:
            raise ValueError("an arc has arc_m and radius_m, which is not 0")
        if abs(self.leg[1]) > radians(MOST_DEG) * (1.0 + 1e-9):
            raise ValueError(f"an arc turns by {MOST_DEG:g} degrees at most")
        return self

    @property
    def leg(self) -> Leg:
        """(m, rad, s)"""
        turn = radians(self.turn_deg or 0.0)
        if self.arc_m is not None and self.radius_m is not None:
            turn = self.arc_m / self.radius_m
        return (self.straight_m or 0.0) + (self.arc_m or 0.0), turn, self.rest_s or 0.0


class Route(Section):
    """A path to drive."""

    start: Pose | None = None
    """x, y in m, heading in degrees; the world's own without it."""
    speed_m_s: float = Field(0.15, gt=0.0, le=5.0)
    turn_deg_s: float = Field(9.0, gt=0.0, le=360.0)
    leg: Annotated[tuple[RouteLeg, ...], Strict(False), Field(min_length=1)]

    @model_validator(mode="after")
    def _ends_some_time(self) -> Self:
        seconds = lasts_s(self.legs, self.speed_m_s, radians(self.turn_deg_s))
        if seconds > MOST_S:
            raise ValueError(f"this takes {seconds / 3600.0:.3g} h, and a drive lasts {MOST_S / 3600.0:g} h at most")
        return self

    @property
    def legs(self) -> list[Leg]:
        """(m, rad, s) of each"""
        return [leg.leg for leg in self.leg]


def commanded(route: Route, base_m: float, sample_s: float) -> Array:
    """(S, 2) way of the right and left wheel in each sample"""
    return told_steps(route.legs, base_m, sample_s, route.speed_m_s, radians(route.turn_deg_s))
