"""Lines of frame after frame -> where they meet: off the ring's centre when the mirror's axis is not vertical.

A tilted mirror shows a vertical line off the ring's centre, by the same vector for all lines, as long as the tilt is
small: they meet in a point. At the horizon, where level rays appear, a tilt does not show, so bearings are read there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.config import MirrorRing
from omnivert.vision.edges import Array, Edges
from omnivert.vision.lines import Lines

Float = NDArray[np.float64]

_FADE = 0.97  # of what older frames say, each frame
_LEAST_LINES = 5
_LOOSE_PX = 0.5  # how far off its point a line passes that is not quite straight
_TAIL = 4.0  # sigmas from which a line loses its say
_PRIOR_PX = 10.0
_USED_PX = 1.0 / 500.0  # of Rmax: a point nearer to the centre is the centre
_SURE = 4.0  # sigmas
_SPAN = 0.75  # of Rmin: how far from the centre the first search looks
_COARSE_POINTS = 4000
_CLEARER = 1.4  # how much sharper the lines must be about another point to begin there
_SECTORS = 360


class Meeting(NamedTuple):
    """Where lines meet, from the ring's centre, px."""

    u_px: float
    v_px: float
    std_px: float
    used: bool


class MeetingFinder:
    """Looks over all the ring once, then follows what the lines of every frame say."""

    def __init__(self, ring: MirrorRing) -> None:
        self._ring = ring
        self._searched = False
        self._information = np.eye(2) / _PRIOR_PX**2
        self._vector = np.zeros(2)
        self._used = False

    @property
    def known(self) -> Meeting | None:
        """The point as known so far; None until lines have been seen."""
        if not self._searched:
            return None
        inverse = np.linalg.inv(self._information)
        u, v = (float(value) for value in inverse @ self._vector)
        return Meeting(u, v, float(np.sqrt(np.max(np.diag(inverse)))), self._used)

    @property
    def point(self) -> tuple[float, float]:
        """Where lines are taken to meet in the next frame."""
        known = self.known
        return (known.u_px, known.v_px) if known is not None and known.used else (0.0, 0.0)

    def search(self, edges: Edges, center: tuple[float, float], tolerance_deg: float) -> None:
        """Begins, on the first frame that shows a ring, at the point about which its edges are sharpest."""
        if self._searched or edges.u_px.size < _COARSE_POINTS // 10:
            return
        self._searched = True
        u, v = sharpest_point(edges, center, self._ring, tolerance_deg)
        if (u, v) != (0.0, 0.0):
            self._used = True
            self._information = np.eye(2) / (0.1 * _SPAN * self._ring.r_min_px) ** 2
            self._vector = self._information @ np.array((u, v))

    def learn(self, lines: Lines) -> None:
        """Takes in by how much each line leans away from where the lines of this frame were taken to meet."""
        use = np.isfinite(lines.lean_std_px)
        if np.count_nonzero(use) < _LEAST_LINES:
            return
        normal = np.stack((-np.sin(lines.angle_rad[use]), -np.cos(lines.angle_rad[use])))
        lean, variance = lines.lean_px[use], lines.lean_std_px[use] ** 2 + _LOOSE_PX**2
        off = np.zeros(2)
        information = np.zeros((2, 2))
        for _ in range(4):
            rest = lean - normal.T @ off
            weight = np.maximum(1.0 - rest**2 / (variance * _TAIL**2), 0.0) ** 2 / variance
            information = (normal * weight) @ normal.T
            off = np.linalg.solve(information + np.eye(2) * 1e-6, normal @ (weight * lean))
        meeting = np.array(self.point) + off
        self._information = _FADE * self._information + information
        self._vector = _FADE * self._vector + information @ meeting
        known = self.known
        assert known is not None
        distance = float(np.hypot(known.u_px, known.v_px))
        least = max(_USED_PX * self._ring.r_max_px, _SURE * known.std_px)
        self._used = distance > (0.5 * least if self._used else least)


def sharpest_point(
    edges: Edges, center: tuple[float, float], ring: MirrorRing, tolerance_deg: float
) -> tuple[float, float]:
    """The point, from the centre, about which the edge points pile up most; (0, 0) unless another is clearly better."""
    step = max(edges.u_px.size // _COARSE_POINTS, 1)
    some = Edges(*(np.ascontiguousarray(values[::step]) for values in edges))
    tangent = float(np.tan(np.deg2rad(tolerance_deg)))

    def sharpness(u: float, v: float) -> float:
        return _sharpness(*some, *center, u, v, ring.r_min_px, ring.r_max_px - 2.0, ring.horizon, tangent)

    reach = _SPAN * ring.r_min_px
    best = (0.0, 0.0)
    for span in (reach, reach / 4.0, reach / 16.0):
        around = [(best[0] + i * span / 4.0, best[1] + j * span / 4.0) for i in range(-4, 5) for j in range(-4, 5)]
        best = max(around, key=lambda point: sharpness(*point))
    return best if sharpness(*best) > _CLEARER * sharpness(0.0, 0.0) else (0.0, 0.0)


@compiled
def _sharpness(
    u: Array,
    v: Array,
    gradient_u: Array,
    gradient_v: Array,
    center_u: float,
    center_v: float,
    meeting_u: float,
    meeting_v: float,
    r_min: float,
    r_max: float,
    horizon: float,
    tangent: float,
) -> float:
    """Sum of squares of the sector histogram about a point."""
    histogram = np.zeros(_SECTORS)
    for k in range(u.size):
        du, dv = np.float64(u[k]) - center_u, np.float64(v[k]) - center_v
        square = du * du + dv * dv
        if square < r_min * r_min or square > r_max * r_max:
            continue
        from_u, from_v = du - meeting_u, dv - meeting_v
        if abs(from_u * gradient_u[k] + from_v * gradient_v[k]) > tangent * abs(
            from_v * gradient_u[k] - from_u * gradient_v[k]
        ):
            continue
        radius = np.sqrt(square)
        slant = (dv * meeting_u - du * meeting_v) / radius
        turn = (np.arctan2(-dv, du) - slant * (1.0 / radius - 1.0 / horizon)) / (2.0 * np.pi) + 1.5
        histogram[int(turn * _SECTORS) % _SECTORS] += 1.0
    return np.sum(histogram * histogram)
