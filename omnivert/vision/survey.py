"""Pictures through a mirror that nobody has measured -> its rim: centre and Rmax, with what speaks for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.vision.edges import EdgeFinder, Edges, everywhere, tone_of_light
from omnivert.vision.fall import Grid, falls
from omnivert.vision.image import WORK_RADIUS_PX, Grey, shrunk
from omnivert.vision.rim import Circle, circle_near, configured_shape

Float = NDArray[np.float64]

MOST_SEARCHED = 12  # pictures that the wide search asks; the close fit asks all
_SIDE_PX = 120  # shorter side of the picture in the wide search
_LEAST_RADIUS, _MOST_RADIUS = 0.20, 0.75  # of the shorter side
_CENTERS_PX, _RADII_PX = 3.0, 1.5  # steps of the wide search
_WIDTH = 0.06  # of the radius: how wide the rim may be in the wide search
_FALLS, _RISES = 0.80, 0.90  # one-sidedness of a rim; photographs of rooms and noise come to 0.65
_LEAST_SEEN = 0.5  # share of the rim that lies in the picture
_LEAST_QUALITY = 0.30  # share of the rim that must be an edge
_SIZES = tuple(1.0 + 0.01 * k for k in range(-4, 5))  # of the wide search's radius, for the close fit
_SEARCH = 0.04  # of the radius: how far off the wide search may be
_AGREE_PX, _AGREE = 3.0, 0.015  # rims within this, or this share of the radius, are one
_FLAT_STEPS = 8  # grey steps between the darkest and the brightest place of a picture that shows nothing
_ALIKE, _TOUCHING = 0.03, 0.15  # circles as one-sided as the best, and as close to it in radii, lie on one rim
_EDGE_MAGNITUDE = 24.0  # grey steps x 8
_FLOOR_PX = 0.1  # no rim is known better: what counts as its edge is a choice


class Rim(NamedTuple):
    """The rim that most pictures agree on."""

    u_px: float
    v_px: float
    radius_px: float
    center_std_px: float  # of the mean, each axis
    radius_std_px: float
    spread_px: float  # how far the centre moves between pictures, each axis; 0.0: one picture
    quality: float  # share of the rim that is an edge, median
    bright: bool  # the mirror is brighter than what surrounds it; else darker
    centers_px: Float  # (N, 2) u, v of each picture that agrees
    used: tuple[int, ...]  # which pictures those are


@dataclass(frozen=True, slots=True)
class NoRim:
    """Why no rim was found."""

    reason: str


def surveyed(pictures: Sequence[Grey]) -> Rim | NoRim:
    """The mirror's rim in pictures of one camera, all of one size.

    pictures  (H, W) uint8 each, at least one; the more they differ, the surer the result

    The wide search asks where the picture falls from bright to dark all around; the close one fits the rim's edge.
    """
    found = _wide(pictures)
    if isinstance(found, NoRim):
        return found
    fitted = [_fitted(pictures, wide) for wide in found]
    return next((one for one in fitted if isinstance(one, Rim)), fitted[0])


def _fitted(pictures: Sequence[Grey], found: "_Wide") -> Rim | NoRim:
    """The rim near what the wide search has found."""
    fits = [_close(grey, found) for grey in pictures]
    there = [k for k, fit in enumerate(fits) if fit is not None]
    if not there:
        return NoRim("a round bright patch is there, but nothing at its border is the edge of a mirror")
    circles = np.array([fit[:3] for fit in fits if fit is not None])
    off = np.abs(circles - np.median(circles, axis=0)).max(axis=1)
    one = off <= max(_AGREE_PX, _AGREE * found.radius_px)
    if np.count_nonzero(one) * 2 < len(pictures):
        return NoRim(f"only {np.count_nonzero(one)} of {len(pictures)} pictures show the rim in one place")
    used = tuple(k for k, agrees in zip(there, one, strict=True) if agrees)
    circles, told = circles[one], [fit for fit in (fits[k] for k in used) if fit is not None]
    u, v, radius = (float(value) for value in circles.mean(axis=0))
    own = float(np.median([fit.std_px for fit in told]))
    spread = circles.std(axis=0, ddof=1) if len(used) > 1 else np.zeros(3)
    root = float(np.sqrt(len(used)))
    return Rim(
        u_px=u,
        v_px=v,
        radius_px=radius,
        center_std_px=max(float(np.hypot(own, spread[:2].max())) / root, _FLOOR_PX),
        radius_std_px=max(float(np.hypot(0.5 * configured_shape(radius).std_px[0], spread[2])) / root, _FLOOR_PX),
        spread_px=float(spread[:2].max()),
        quality=float(np.median([fit.quality for fit in told])),
        bright=found.bright,
        centers_px=circles[:, :2],
        used=used,
    )


class Smaller(NamedTuple):
    """A picture made smaller, and how places in it and in the one it was made of belong together."""

    grey: Grey
    across: float  # its width as a share of the other's: its size is whole pixels, so not quite what was asked for
    down: float

    @classmethod
    def of(cls, grey: Grey, scale: float) -> "Smaller":
        small = shrunk(grey, scale)
        return cls(small, small.shape[1] / grey.shape[1], small.shape[0] / grey.shape[0])

    def into(self, u: float, v: float) -> tuple[float, float]:
        """A place of the picture in this one; pixel centres are at integers in both."""
        return (u + 0.5) * self.across - 0.5, (v + 0.5) * self.down - 0.5

    def back(self, u: float, v: float) -> tuple[float, float]:
        return (u + 0.5) / self.across - 0.5, (v + 0.5) / self.down - 0.5


class _Wide(NamedTuple):
    u_px: float
    v_px: float
    radius_px: float
    bright: bool


def _wide(pictures: Sequence[Grey]) -> list[_Wide] | NoRim:
    """The circle across which most pictures fall nearly all around, and the one across which they rise; at least one.

    The first is preferred: around many mirrors lies a dark band, and the world is bright again beyond it.
    """
    scale = _SIDE_PX / min(pictures[0].shape)
    some = np.unique(np.linspace(0, len(pictures) - 1, min(len(pictures), MOST_SEARCHED)).astype(int))
    small = [Smaller.of(pictures[k], scale) for k in some]
    if max(int(np.ptp(one.grey)) for one in small) < _FLAT_STEPS:
        return NoRim("every picture is of one grey: nothing is in it")
    rows, columns = small[0].grey.shape
    radii = np.arange(_LEAST_RADIUS * min(rows, columns), _MOST_RADIUS * min(rows, columns), _RADII_PX)
    grid = Grid(np.arange(0.0, columns, _CENTERS_PX), np.arange(0.0, rows, _CENTERS_PX), radii)
    each = _sided(small, grid)
    together, found = np.median(each, axis=0), []
    for sign, least in ((1.0, _FALLS), (-1.0, _RISES)):
        # The steps of the wide search are about as wide as a rim: closer steps show how good the best circle is.
        near = _about(_middle(sign * together, grid))
        closer = sign * np.median(_sided(small, near), axis=0)
        if float(np.max(closer)) >= least:
            u, v, radius = _middle(closer, near)
            found.append(_Wide(*small[0].back(u, v), radius / small[0].down, sign > 0))
    if found:
        return found
    if 2 * np.count_nonzero(each.max(axis=(1, 2, 3)) >= _FALLS) > len(small) > 1:
        return NoRim("the pictures show a rim each, but not in one place: were they taken with one camera and mirror?")
    most = 100.0 * float(np.max(np.abs(together)))
    return NoRim(f"no circle parts bright from dark all around; the best does so along {most:.0f} % of it")


def _sided(small: Sequence[Smaller], grid: Grid) -> Float:
    """(N, V, U, R) one-sidedness of each picture; 0 where too little of the circle lies in it."""
    asked = [falls(one.grey, grid, _WIDTH) for one in small]
    return np.array([np.where(seen >= _LEAST_SEEN, net, 0.0) for net, seen in asked])


def _about(circle: tuple[float, float, float]) -> Grid:
    """Circles in close steps about this one."""
    u, v, radius = circle
    off = np.arange(-_CENTERS_PX, _CENTERS_PX + 1.0)
    return Grid(u + off, v + off, radius + np.arange(-2.0 * _RADII_PX, 2.0 * _RADII_PX + 0.5, 0.5))


def _middle(sided: Float, grid: Grid) -> tuple[float, float, float]:
    """The best circle, u, v, radius: a wide rim is crossed by many, so the mean of those that are as good and near."""
    places = np.stack(np.meshgrid(grid.v_px, grid.u_px, grid.radius_px, indexing="ij"), axis=-1)
    at = places[np.unravel_index(int(np.argmax(sided)), sided.shape)]
    like = places[sided >= float(np.max(sided)) - _ALIKE]
    v, u, radius = like[np.abs(like - at).max(axis=1) <= _TOUCHING * at[2]].mean(axis=0)
    return float(u), float(v), float(radius)


def _close(grey: Grey, wide: _Wide) -> Circle | None:
    """The rim's edge in one picture; None when there is none.

    A soft rim is found only in a picture made small enough, and circles of the wrong size pull at what is found.
    """
    small = Smaller.of(grey, WORK_RADIUS_PX / wide.radius_px)
    edges = _edges(small.grey)
    center, radius = small.into(wide.u_px, wide.v_px), wide.radius_px * small.down
    tried = (circle_near(edges, center, configured_shape(times * radius), _SEARCH * radius) for times in _SIZES)
    best = max((circle for circle in tried if circle is not None), key=lambda circle: circle.quality, default=None)
    if best is None:
        return None
    again = circle_near(edges, best[:2], configured_shape(best.radius_px), 2.0)
    if again is not None and again.quality >= best.quality - _ALIKE:
        best = again
    if best.quality < _LEAST_QUALITY:
        return None
    u, v = small.back(best.u_px, best.v_px)
    return best._replace(u_px=u, v_px=v, radius_px=best.radius_px / small.down, std_px=best.std_px / small.down)


def _edges(grey: Grey) -> Edges:
    band = everywhere(grey)
    return EdgeFinder(_EDGE_MAGNITUDE).step(grey, band, tone_of_light(grey, band))
