"""Lines of frame after frame -> where they meet: off the ring's centre when the mirror's axis is not vertical.

A tilted mirror shows a vertical line off the ring's centre, by the same vector for all lines, as long as the tilt is
small: they meet in a point. At the horizon, where level rays appear, a tilt does not show, so bearings are read there.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.compiled import compiled
from omnivert.config import MirrorRing
from omnivert.vision.edges import Edges
from omnivert.vision.lines import RIM_MARGIN_PX, Lines, radial_votes, sector_histogram

Float = NDArray[np.float64]

_FADE = 0.99  # of what older frames say, each frame
_LEAST_LINES = 5
_LOOSE_PX = 0.5  # how far off its point a line passes that is not quite straight
_TAILS = (32.0, 16.0, 8.0, 4.0, 4.0)  # sigmas from which a line loses its say; step after step
_PRIOR_PX = 10.0  # nothing is known of where lines meet
_NOD_PX = 0.3  # by so much a robot is taken to nod before it has been seen to ...
_NOD_FRAMES = 2.0  # ... which counts for so many frames
_NOD_LASTS = 8.0  # frames; neighbouring ones nod alike, so that their mean is known the worse
_EQUAL_PX = 1.0  # frames that know the point better than this count alike, as their own nodding is in it
_FAR_PX = 0.7  # lines found about a point that is so far off lean too much to be fitted well: they are found again ...
_LOOKS = 4  # ... until they have been found so often
_USED_PX = 1.0 / 500.0  # of Rmax: a point nearer to the centre is the centre
_SURE = 4.0  # sigmas
_SPAN = 0.9  # of Rmin: how far from the centre the first search looks
_COARSE_POINTS = 4000
_EARLY_FRAMES = 3
_AGREE = 0.15  # of Rmin: two searches this near found the same
_SEARCH_TOLERANCE_DEG = 20.0  # from far off its point, a line's edges lean
_CLEARER = 1.4  # how much sharper the lines must be about another point to begin there
_SECTORS = 360


class Meeting(NamedTuple):
    """Where lines meet, from the ring's centre, px."""

    u_px: float
    v_px: float
    std_px: float
    used: bool


class MeetingFinder:
    """Looks over all the ring in the first frames, then follows what the lines of every frame say."""

    def __init__(self, ring: MirrorRing) -> None:
        self._ring = ring
        self._frame, self._next_search = 0, 0
        self._other: tuple[float, float] | None = None  # what the last search found, when it was not where lines meet
        self._seen = _Sums()
        self._now, self._now_std = (0.0, 0.0), _PRIOR_PX
        self._used = False

    @property
    def begun(self) -> bool:
        """The search over all the ring has been, and is not due again; edges that point elsewhere are of no use."""
        # A search takes as long as some frames do. Later on only lines that meet far off are worth it.
        settled = self._frame >= _EARLY_FRAMES and _apart(self.point, (0.0, 0.0)) < _AGREE * self._ring.r_min_px
        return settled or self._frame < self._next_search

    @property
    def known(self) -> Meeting | None:
        """The point as known so far; None until lines have been seen."""
        if self._next_search == 0:
            return None
        seen = self._seen
        (u, v), std = (self._now, self._now_std) if self._used else (seen.mean, np.sqrt(seen.mean_variance))
        return Meeting(u, v, float(std), self._used)

    @property
    def point(self) -> tuple[float, float]:
        """Where lines are taken to meet in the next frame."""
        return self._seen.mean if self._used else (0.0, 0.0)

    def search(self, edges: Edges, center: tuple[float, float], tolerance_deg: float) -> None:
        """Looks for the point about which all edges are sharpest: in the first frame that shows a ring, then ever less.

        What is found once the first frame has decided must be found in two frames on end before it counts: one bad
        picture, be it the first, does not last.
        """
        if self.begun or edges.u_px.size < _COARSE_POINTS // 10:
            return
        first, here = self._next_search == 0, self.point
        found = sharpest_point(edges, center, self._ring, max(tolerance_deg, _SEARCH_TOLERANCE_DEG), here)
        self._next_search = max(2 * self._frame, 1)
        if _apart(found, here) < _AGREE * self._ring.r_min_px:
            self._other = None
        elif first or (self._other is not None and _apart(found, self._other) < _AGREE * self._ring.r_min_px):
            self._begin_at(found)
        else:
            self._other, self._next_search = found, self._frame + 1

    def _begin_at(self, point: tuple[float, float]) -> None:
        self._seen, self._other = _Sums(), None
        self._used = point != (0.0, 0.0)
        if self._used:
            self._now, self._now_std = point, 0.1 * _SPAN * self._ring.r_min_px
            self._seen.add(*point, self._now_std**2)

    def lines(self, about: Callable[[tuple[float, float]], Lines]) -> Lines:
        """A frame's lines as its own meeting point has them, which is learnt from by how much each of them leans.

        about  finds the frame's lines, when told where they meet

        The mean over the frames is the tilt that the camera is mounted with; what frames differ by, the robot's
        nodding. A frame's own point is believed against the mean as far as frames are seen to differ.
        """
        self._frame += 1
        u, v = self.point
        for look in range(1, _LOOKS + 1):
            lines = about((u, v))
            off, shown, count = _common_lean(lines.angle_rad, lines.lean_px, lines.lean_std_px)
            if count < _LEAST_LINES:
                return lines
            if look == _LOOKS or np.hypot(*off) < _FAR_PX:
                break
            u, v = u + off[0], v + off[1]
        seen = self._seen
        seen.add(u + off[0], v + off[1], _weighed(shown, 1.0 / _PRIOR_PX**2, off, off)[1])
        self._decide()
        if not self._used:
            return lines
        mean = seen.mean[0] - u, seen.mean[1] - v
        now, variance = _weighed(shown, 1.0 / (seen.mean_variance + seen.nodding), off, mean)
        self._now, self._now_std = (u + now[0], v + now[1]), float(np.sqrt(variance))
        slant = -np.sin(lines.angle_rad) * now[0] - np.cos(lines.angle_rad) * now[1]
        return lines._replace(
            angle_rad=wrap(lines.angle_rad - slant * lines.lever),
            std_rad=np.hypot(lines.std_rad, lines.lever * self._now_std),
            slant_px=lines.slant_px + slant,
            lean_px=lines.lean_px - slant,
        )

    def _decide(self) -> None:
        seen = self._seen
        shift = float(np.hypot(*seen.mean)) + np.sqrt(seen.nodding)
        least = max(_USED_PX * self._ring.r_max_px, _SURE * float(np.sqrt(seen.mean_variance)))
        self._used = bool(shift > (0.5 * least if self._used else least))


def _apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


@dataclass(slots=True)
class _Sums:
    """Faded sums over the frames: what the point was in each, and how well that was known."""

    weight: float = 0.0
    weight_square: float = 0.0
    u: float = 0.0
    v: float = 0.0
    square: float = 0.0
    variance: float = 0.0

    def add(self, u: float, v: float, variance: float) -> None:
        """A frame's point, px, and its variance on each axis, px^2."""
        weight = 1.0 / (variance + _EQUAL_PX**2)
        self.weight = _FADE * self.weight + weight
        self.weight_square = _FADE**2 * self.weight_square + weight**2
        self.u = _FADE * self.u + weight * u
        self.v = _FADE * self.v + weight * v
        self.square = _FADE * self.square + weight * 0.5 * (u * u + v * v)
        self.variance = _FADE * self.variance + weight * variance

    @property
    def mean(self) -> tuple[float, float]:
        return (self.u / self.weight, self.v / self.weight) if self.weight > 0.0 else (0.0, 0.0)

    @property
    def frames(self) -> float:
        """How many equal frames would say as much."""
        return self.weight**2 / self.weight_square if self.weight > 0.0 else 0.0

    @property
    def nodding(self) -> float:
        """Variance of the point between frames on each axis, beyond what they know it to, px^2."""
        n, (u, v) = self.frames, self.mean
        more = 0.0
        if n > 1.0:
            scatter = max(self.square / self.weight - 0.5 * (u * u + v * v), 0.0) * n / (n - 1.0)
            more = max(scatter - self.variance / self.weight, 0.0)
        return (max(n - 1.0, 0.0) * more + _NOD_FRAMES * _NOD_PX**2) / (max(n - 1.0, 0.0) + _NOD_FRAMES)

    @property
    def mean_variance(self) -> float:
        """Of the mean on each axis, px^2."""
        if self.weight == 0.0:
            return _PRIOR_PX**2
        return (self.variance / self.weight + min(_NOD_LASTS, self.frames) * self.nodding) / self.frames


def _weighed(
    information: tuple[float, float, float], prior: float, shown: tuple[float, float], mean: tuple[float, float]
) -> tuple[tuple[float, float], float]:
    """A point that is shown and one that is known, each by its information; the mean variance of its coordinates.

    information  uu, uv, vv of `shown`
    prior        of `mean`, on each axis
    """
    (a, b, d), (p, q) = information, (shown[0] - mean[0], shown[1] - mean[1])
    determinant = (a + prior) * (d + prior) - b * b
    right = a * p + b * q, b * p + d * q
    u = ((d + prior) * right[0] - b * right[1]) / determinant
    v = ((a + prior) * right[1] - b * right[0]) / determinant
    return (mean[0] + u, mean[1] + v), 0.5 * (a + d + 2.0 * prior) / determinant


@compiled
def _common_lean(angle: Float, lean: Float, std: Float) -> tuple[tuple[float, float], tuple[float, float, float], int]:
    """The shift of the meeting point that explains how lines lean, robustly, px; its information uu, uv, vv; lines."""
    normal_u, normal_v = -np.sin(angle), -np.cos(angle)
    off_u = off_v = a = b = d = 0.0
    count = 0
    for tail in _TAILS:
        a = b = d = p = q = 0.0
        count = 0
        for k in range(angle.size):
            if not np.isfinite(std[k]):
                continue
            count += 1
            variance = std[k] * std[k] + _LOOSE_PX * _LOOSE_PX
            rest = lean[k] - normal_u[k] * off_u - normal_v[k] * off_v
            near = max(1.0 - rest * rest / (variance * tail * tail), 0.0)
            weight = near * near / variance
            a += weight * normal_u[k] * normal_u[k]
            b += weight * normal_u[k] * normal_v[k]
            d += weight * normal_v[k] * normal_v[k]
            p += weight * normal_u[k] * lean[k]
            q += weight * normal_v[k] * lean[k]
        determinant = (a + 1e-6) * (d + 1e-6) - b * b
        off_u, off_v = ((d + 1e-6) * p - b * q) / determinant, ((a + 1e-6) * q - b * p) / determinant
    return (off_u, off_v), (a, b, d), count


def sharpest_point(
    edges: Edges,
    center: tuple[float, float],
    ring: MirrorRing,
    tolerance_deg: float,
    here: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, float]:
    """The point, from the centre, about which the edge points pile up most; `here` unless another is clearly better."""
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
    return best if within and sharpness(*best) > _CLEARER * sharpness(*here) else here
