"""Lines of frame after frame -> where they meet: off the ring's centre when the mirror's axis is not vertical.

A tilted mirror shows a vertical line off the ring's centre, by the same vector for all lines, as long as the tilt is
small: they meet in a point. At the horizon, where level rays appear, a tilt does not show, so bearings are read there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import MirrorRing
from omnivert.vision.edges import Edges
from omnivert.vision.lines import RIM_MARGIN_PX, Lines, radial_votes, sector_histogram

Float = NDArray[np.float64]

_FADE = 0.97  # of what older frames say, each frame
_LEAST_LINES = 5
_NOD_GAIN = 0.05
_LOOSE_PX = 0.5  # how far off its point a line passes that is not quite straight
_TAIL = 4.0  # sigmas from which a line loses its say
_PRIOR_PX = 10.0
_USED_PX = 1.0 / 500.0  # of Rmax: a point nearer to the centre is the centre
_SURE = 4.0  # sigmas
_SPAN = 0.9  # of Rmin: how far from the centre the first search looks
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
        self._nodding = 0.0  # variance between frames, px^2
        self._now = np.zeros(2)
        self._used = False

    @property
    def begun(self) -> bool:
        """The search over all the ring has been; edges that point elsewhere are of no more use."""
        return self._searched

    @property
    def known(self) -> Meeting | None:
        """The point as known so far; None until lines have been seen."""
        if not self._searched:
            return None
        mean, covariance = self._mean()
        u, v = self._now if self._used else mean
        return Meeting(float(u), float(v), float(np.sqrt(np.max(np.diag(covariance)))), self._used)

    @property
    def point(self) -> tuple[float, float]:
        """Where lines are taken to meet in the next frame."""
        if not self._used:
            return 0.0, 0.0
        u, v = self._mean()[0]
        return float(u), float(v)

    def search(self, edges: Edges, center: tuple[float, float], tolerance_deg: float) -> None:
        """Begins, on the first frame that shows a ring, at the point about which its edges are sharpest."""
        if self._searched or edges.u_px.size < _COARSE_POINTS // 10:
            return
        self._searched = True
        u, v = sharpest_point(edges, center, self._ring, tolerance_deg)
        if (u, v) != (0.0, 0.0):
            self._used = True
            self._information = np.eye(2) / (0.1 * _SPAN * self._ring.r_min_px) ** 2
            self._now = np.array((u, v))
            self._vector = self._information @ self._now

    def corrected(self, lines: Lines) -> Lines:
        """The lines as this frame's own meeting point has them, which is learnt from by how much each of them leans.

        The mean over the frames is the tilt that the camera is mounted with; what frames differ by, the robot's
        nodding. A frame's own point is believed against the mean as far as frames are seen to differ.
        """
        use = np.isfinite(lines.lean_std_px)
        if np.count_nonzero(use) < _LEAST_LINES:
            return lines
        off, information = _common_lean(lines.angle_rad[use], lines.lean_px[use], lines.lean_std_px[use])
        before = np.array(self.point)
        covariance = np.linalg.inv(information + np.eye(2) / _PRIOR_PX**2)
        mean, mean_covariance = self._mean()
        surprise = before + off - mean
        extra = float(np.mean(surprise**2 - np.diag(covariance) - np.diag(mean_covariance)))
        self._nodding = max(self._nodding + _NOD_GAIN * (extra - self._nodding), 0.0)
        weight = np.linalg.inv(covariance + np.eye(2) * self._nodding)
        self._information = _FADE * self._information + weight
        self._vector = _FADE * self._vector + weight @ (before + off)
        self._decide()
        if not self._used:
            return lines
        mean, mean_covariance = self._mean()
        prior = np.linalg.inv(mean_covariance + np.eye(2) * self._nodding)
        covariance = np.linalg.inv(information + prior)
        self._now = covariance @ (information @ (before + off) + prior @ mean)
        change = self._now - before
        slant = -np.sin(lines.angle_rad) * change[0] - np.cos(lines.angle_rad) * change[1]
        std = np.hypot(lines.std_rad, lines.lever * np.sqrt(np.max(np.diag(covariance))))
        return lines._replace(
            angle_rad=wrap(lines.angle_rad - slant * lines.lever),
            std_rad=std,
            slant_px=lines.slant_px + slant,
            lean_px=lines.lean_px - slant,
        )

    def _mean(self) -> tuple[Float, Float]:
        covariance = np.asarray(np.linalg.inv(self._information), dtype=np.float64)
        return covariance @ self._vector, covariance

    def _decide(self) -> None:
        mean, covariance = self._mean()
        shift = float(np.hypot(*mean)) + np.sqrt(self._nodding)
        least = max(_USED_PX * self._ring.r_max_px, _SURE * float(np.sqrt(np.max(np.diag(covariance)))))
        self._used = bool(shift > (0.5 * least if self._used else least))


def _common_lean(angle: Float, lean: Float, std: Float) -> tuple[Float, Float]:
    """The shift of the meeting point that explains how lines lean, robustly: px (2,), and its information (2, 2)."""
    normal = np.stack((-np.sin(angle), -np.cos(angle)))
    variance = std**2 + _LOOSE_PX**2
    off, information = np.zeros(2), np.zeros((2, 2))
    for _ in range(4):
        rest = lean - normal.T @ off
        weight = np.maximum(1.0 - rest**2 / (variance * _TAIL**2), 0.0) ** 2 / variance
        information = (normal * weight) @ normal.T
        off = np.linalg.solve(information + np.eye(2) * 1e-6, normal @ (weight * lean))
    return off, information


def sharpest_point(
    edges: Edges, center: tuple[float, float], ring: MirrorRing, tolerance_deg: float
) -> tuple[float, float]:
    """The point, from the centre, about which the edge points pile up most; (0, 0) unless another is clearly better."""
    step = max(edges.u_px.size // _COARSE_POINTS, 1)
    some = Edges(*(np.ascontiguousarray(values[::step]) for values in edges))
    r_max = ring.r_max_px - RIM_MARGIN_PX

    def sharpness(u: float, v: float) -> float:
        votes = radial_votes(some, center, ring.r_min_px, r_max, tolerance_deg, ring.horizon, (u, v))
        return float(np.sum(sector_histogram(votes.angle_rad, None, _SECTORS) ** 2))

    reach = _SPAN * ring.r_min_px
    best = (0.0, 0.0)
    for span in (reach, reach / 4.0, reach / 16.0):
        around = [(best[0] + i * span / 4.0, best[1] + j * span / 4.0) for i in range(-4, 5) for j in range(-4, 5)]
        best = max(around, key=lambda point: sharpness(*point))
    within = np.hypot(*best) <= 1.05 * reach  # beyond it, what was found is where the search ended
    return best if within and sharpness(*best) > _CLEARER * sharpness(0.0, 0.0) else (0.0, 0.0)
