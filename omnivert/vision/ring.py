"""Edge points -> the mirror's rim, in every frame (II, step 1)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Array, Edges

Float = NDArray[np.float64]

_ALONG = 0.82  # cos 35 deg: the gradient of a rim's edge points at the centre, or away from it, within this
_BINS = 360  # stretches of the rim that are asked one by one whether they were seen
_ON_RIM_PX = 1.5
_ON_RIM = 1.0 / 150.0  # of the radius
_BAND = 4.0  # half width of the band about the rim, as a multiple of what lies on it
_COARSE_RADIUS = 28.0  # cells; the wide search shrinks the picture until the rim has this radius
_WIDE_CANDIDATES = 4  # peaks of the wide search that are looked at closely
_CORRELATED = 3.0  # neighbouring points share their errors: the claimed sigma is so much larger
_RADIUS_STD_PX = 1.0  # how well the configuration knows the radius
_SHAKE_PX = 1.0  # how far a lost rim may have moved, each frame
_MIN_EDGES = 30
_BLOCK = 512  # edges that vote at a time: all stays in the cache


class Circle(NamedTuple):
    """A rim as fitted."""

    u_px: float
    v_px: float
    radius_px: float
    quality: float  # share of the whole circle that was seen, less what chance alone would show
    std_px: float  # of the centre, each axis


@dataclass(frozen=True, slots=True)
class RingFound:
    """The rim to use for one frame."""

    circle: Circle
    reason: str = ""  # not empty: this is the last good one, held because this frame shows none


class RingFinder:
    """Near the last centre first, all over the picture when it is not there, held when it is nowhere."""

    def __init__(self, ring: MirrorRing, vision: Vision) -> None:
        self._radius = ring.r_max_px
        self._vision = vision
        self._good: Circle | None = None
        self._lost_frames = 0
        self.expected = ring.center_px
        """Where the centre is looked for next, (u, v) px."""

    def step(self, edges: Edges, everywhere: Callable[[], Edges]) -> RingFound | None:
        """This frame's rim, or the last good one held with growing sigma, or None when there is none to hold.

        edges       around the expected rim
        everywhere  the edges of the whole picture, asked for only when the rim is not where it was expected
        """
        vision = self._vision
        refine = vision.mode != "paper"
        circle = circle_near(edges, self.expected, self._radius, vision.ring_search_px, refine=refine)
        if not self._seen(circle):
            circle = circle_anywhere(everywhere(), self._radius, refine=refine)
        if circle is not None and self._seen(circle):
            self._good, self._lost_frames = circle, 0
            self.expected = (circle.u_px, circle.v_px)
            return RingFound(circle)
        self._lost_frames += 1
        if self._good is None or self._lost_frames > vision.lookback_frames:
            return None
        std = float(np.hypot(self._good.std_px, _SHAKE_PX * np.sqrt(self._lost_frames)))
        quality = 0.0 if circle is None else min(circle.quality, vision.ring_min_quality)
        return RingFound(self._good._replace(quality=quality, std_px=std), "ring not in the picture; last one held")

    def _seen(self, circle: Circle | None) -> bool:
        return circle is not None and circle.quality >= self._vision.ring_min_quality


def circle_near(
    edges: Edges, center: tuple[float, float], radius: float, search: float, *, refine: bool = True
) -> Circle | None:
    """The circle of this radius that passes through most edges, its centre within `search` of `center` on each axis.

    center, radius, search  px
    refine                  fit centre and radius below the pixel; else the accumulator's maximum (the paper)
    """
    u, v = edges.u_px - np.float32(center[0]), edges.v_px - np.float32(center[1])
    reach = 1.5 * search + _BAND * _on_rim_px(radius)
    u, v, inside = _rim_edges(u, v, edges, radius, reach, search)
    if u.size < _MIN_EDGES:
        return None
    start = _accumulator_peak(u, v, radius, int(np.ceil(search)))
    cu, cv, fitted, std = _fitted(u, v, start, radius) if refine else (*start, radius, 0.5)
    strength = np.hypot(edges.gradient_u[inside], edges.gradient_v[inside])
    quality = _rim_share(u - np.float32(cu), v - np.float32(cv), strength, fitted)
    return Circle(center[0] + cu, center[1] + cv, fitted, quality, std)


def circle_anywhere(edges: Edges, radius: float, *, refine: bool = True) -> Circle | None:
    """The clearest circle of this radius, its centre anywhere within a radius of the edges; for when it is lost."""
    if edges.u_px.size < _MIN_EDGES:
        return None
    cell = max(radius / _COARSE_RADIUS, 1.0)
    margin = int(np.ceil(radius / cell)) + 2
    left, top = float(edges.u_px.min()), float(edges.v_px.min())
    column = ((edges.u_px - left) / cell).astype(np.intp) + margin
    row = ((edges.v_px - top) / cell).astype(np.intp) + margin
    shape = (int(row.max()) + 1 + margin, int(column.max()) + 1 + margin)
    picture = np.zeros(shape, dtype=np.float32)
    picture[row, column] = 1.0
    mask = np.zeros_like(picture)
    turn = np.linspace(0.0, TURN, int(8.0 * radius / cell), endpoint=False)
    mask[np.rint(radius / cell * np.sin(turn)).astype(int), np.rint(radius / cell * np.cos(turn)).astype(int)] = 1.0
    accumulator = np.fft.irfft2(np.fft.rfft2(picture) * np.fft.rfft2(mask), s=shape)
    best: Circle | None = None
    for _ in range(_WIDE_CANDIDATES):
        v, u = np.unravel_index(int(np.argmax(accumulator)), shape)
        accumulator[max(v - 3, 0) : v + 4, max(u - 3, 0) : u + 4] = 0.0
        center = (left + (float(u) - margin + 0.5) * cell, top + (float(v) - margin + 0.5) * cell)
        circle = circle_near(edges, center, radius, 2.0 * cell, refine=refine)
        if circle is not None and (best is None or circle.quality > best.quality):
            best = circle
    return best


def _rim_edges(
    u: Array, v: Array, edges: Edges, radius: float, reach: float, search: float
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Edges that may lie on the rim: about the right distance from the window's centre, gradient along the radius."""
    distance = np.hypot(u, v)
    ring = np.flatnonzero(np.abs(distance - radius) <= reach)
    u, v, gu, gv = u[ring], v[ring], edges.gradient_u[ring], edges.gradient_v[ring]
    # Seen from a centre that is off by `search`, the rim's gradients lean by up to this more.
    along = np.cos(min(np.arccos(_ALONG) + search / radius, 0.5 * np.pi))
    radial = np.abs(u * gu + v * gv) >= along * distance[ring] * np.hypot(gu, gv)
    return u[radial], v[radial], ring[radial]


def _accumulator_peak(u: Array, v: Array, radius: float, search: int) -> tuple[float, float]:
    """Centre, relative to the window's, under which the circular mask covers most edges.

    The convolution of the binary edge image with the mask, turned round: every edge adds the mask to the accumulator.
    """
    side = 2 * search + 1
    own = np.arange(side, dtype=np.int32)
    offsets = (own - search).astype(np.float32)
    steep = np.abs(v) >= np.abs(u)
    accumulator = np.zeros((side, side))
    # Along u where the mask runs along u, along v elsewhere: it then has one cell a step and no gaps.
    for a, b, along_u in ((u[steep], v[steep], True), (v[~steep], u[~steep], False)):
        for i in range(0, a.size, _BLOCK):
            a_, b_ = a[i : i + _BLOCK, None], b[i : i + _BLOCK, None]
            root = np.sqrt(np.maximum(np.float32(radius**2) - (a_ - offsets) ** 2, np.float32(0.0)))
            other = np.rint(b_ - np.copysign(root, b_)).astype(np.int32) + search
            cell = (own * side + other)[(other >= 0) & (other < side)]
            votes = np.bincount(cell, minlength=side * side).reshape(side, side)
            accumulator += votes.T if along_u else votes
    smooth = np.asarray(cv2.blur(accumulator, (3, 3), borderType=cv2.BORDER_CONSTANT))
    v_peak, u_peak = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return float(u_peak - search), float(v_peak - search)


def _fitted(u: Array, v: Array, start: tuple[float, float], radius: float) -> tuple[float, float, float, float]:
    """Centre, radius and the centre's sigma by robust least squares on the points near the circle; px.

    # Paper: the accumulator's maximum, to the pixel, radius fixed. Here: both fitted below the pixel, because the
    # centre's error turns every bearing by up to (error / r), and a radius held 1 px wrong would shift a half-covered
    # rim (rms on the corridor 0.31 px to the pixel, 0.03 px fitted).
    """
    c, r = np.array(start), radius
    x, y = u.astype(np.float64), v.astype(np.float64)
    std = 0.5
    for width in _on_rim_px(radius) * np.array((3.3, 2.0, 1.3, 1.0, 1.0)):
        du, dv = x - c[0], y - c[1]
        distance = np.hypot(du, dv)
        e = distance - r
        weight = np.maximum(1.0 - (e / width) ** 2, 0.0) ** 2
        near = weight > 0.0
        if np.count_nonzero(near) < _MIN_EDGES:
            break
        e, w = e[near], weight[near]
        slope = np.stack((du[near] / distance[near], dv[near] / distance[near], np.ones_like(e)))
        variance = float(np.sum(w * e**2) / np.sum(w))
        normal = (slope * w) @ slope.T
        normal[2, 2] += variance / _RADIUS_STD_PX**2
        right = slope @ (w * e)
        right[2] += variance / _RADIUS_STD_PX**2 * (radius - r)
        normal += np.eye(3) * 1e-6
        change = np.linalg.solve(normal, right)
        c, r = c + change[:2], r + float(change[2])
        std = _CORRELATED * float(np.sqrt(max(variance, 0.01) * np.max(np.diag(np.linalg.inv(normal))[:2])))
    return float(c[0]), float(c[1]), float(r), min(max(std, 1e-3), radius)


def _rim_share(u: Array, v: Array, strength: Array, radius: float) -> float:
    """Share of the circle where the strongest edge of a band about the rim lies on it, less what chance gives; 0..1."""
    on = _on_rim_px(radius)
    e = np.hypot(u, v) - radius
    band = np.flatnonzero(np.abs(e) <= _BAND * on)
    place = ((np.arctan2(v[band], u[band]) / TURN + 0.5) * _BINS).astype(np.intp) % _BINS
    order = np.lexsort((strength[band], place))
    place, e = place[order], e[band[order]]
    last = np.append(place[1:] != place[:-1], True) if place.size else np.empty(0, dtype=np.bool_)  # the strongest
    seen = np.count_nonzero(np.abs(e[last]) <= on) - np.count_nonzero(last) / _BAND
    return max(float(seen) / (1.0 - 1.0 / _BAND) / _BINS, 0.0)


def _on_rim_px(radius: float) -> float:
    """How far off the circle an edge still belongs to the rim; no mirror's rim is quite round."""
    return max(_ON_RIM_PX, _ON_RIM * radius)
