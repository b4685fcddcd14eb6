"""Edge points -> vertical lines: radial edges, sector histogram, peaks, bearings (II, steps 2 to 5)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Edges

Float = NDArray[np.float64]
Int = NDArray[np.int64]

_RIM_MARGIN_PX = 2.0  # the rim itself is no line
_WIDE_RAD = np.deg2rad(0.5)  # votes this far on either side of a sector still count for its peak
_REACH_RAD = np.deg2rad(1.0)  # and this far on either side of a peak belong to its line
_SAME_RAD = 0.008  # two lines of one polarity that end up this close are one
_CORRELATED_PX = 4.0  # neighbouring points of an edge share their error over about this many


class Votes(NamedTuple):
    """Edge points whose edge points at the centre, (N,) each."""

    angle_rad: Float  # image angle atan2(-(v - cv), u - cu), (-pi, pi]
    radius_px: Float
    polarity: Int  # +1: the picture gets brighter in the sense of growing angle; -1: darker
    extent_px: Float  # length of line that the point stands for, along the radius


class Lines(NamedTuple):
    """Lines of one frame, by growing angle, (N,) each."""

    angle_rad: Float  # image angle, (-pi, pi]
    std_rad: Float
    polarity: Int  # +1, -1; 0: not told apart (paper)
    strength: Float  # share of Rmax - Rmin with an edge, 0..1


def no_lines() -> Lines:
    return Lines(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64), np.empty(0))


def lines_from_edges(
    edges: Edges, center: tuple[float, float], center_std: float, ring: MirrorRing, vision: Vision
) -> Lines:
    """The vertical lines around a ring centre.

    center, center_std  px
    """
    votes = radial_votes(edges, center, ring.r_min_px, ring.r_max_px - _RIM_MARGIN_PX, vision.edge_tolerance_deg)
    length = ring.r_max_px - ring.r_min_px
    if vision.mode == "paper":
        return sector_lines(votes, length, center_std, vision)
    return refined_lines(votes, length, center_std, vision)


def radial_votes(edges: Edges, center: tuple[float, float], r_min: float, r_max: float, tolerance_deg: float) -> Votes:
    """The edge points between two radii whose edge points at the centre within a tolerance.

    # The gradient of a radial edge is tangential: it is the edge, across the gradient, that must point at the centre.
    """
    u, v = edges.u_px - np.float32(center[0]), edges.v_px - np.float32(center[1])
    square = u * u + v * v
    along = np.abs(u * edges.gradient_u + v * edges.gradient_v)  # r x component along the radius
    across = v * edges.gradient_u - u * edges.gradient_v  # r x component in the sense of growing angle
    keep = (square >= r_min**2) & (square <= r_max**2) & (along <= np.tan(np.deg2rad(tolerance_deg)) * np.abs(across))
    x, y = u[keep].astype(np.float64), -v[keep].astype(np.float64)
    radius = np.sqrt(square[keep].astype(np.float64))
    polarity = np.where(across[keep] >= 0.0, 1, -1).astype(np.int64)
    # A thinned slanted edge has one point a row (or column), so fewer points than its length has pixels.
    return Votes(np.arctan2(y, x), radius, polarity, radius / np.maximum(np.abs(x), np.abs(y)))


def sector_histogram(angle: Float, weight: Float | None, sectors: int) -> Float:
    """Votes in each of `sectors` equal sectors, the first from -pi on."""
    sector = ((angle / TURN + 0.5) * sectors).astype(np.intp) % sectors
    return np.bincount(sector, weights=weight, minlength=sectors).astype(np.float64)


def local_peaks(histogram: Float, threshold: float, reach: int = 1) -> Int:
    """Sectors at the threshold or above that no neighbour within `reach` exceeds; the first of equals; circular."""
    peak = histogram >= max(threshold, 1e-12)
    for step in range(1, reach + 1):
        peak &= (histogram > np.roll(histogram, step)) & (histogram >= np.roll(histogram, -step))
    return np.flatnonzero(peak).astype(np.int64)


def sector_lines(votes: Votes, length: float, center_std: float, vision: Vision) -> Lines:
    """The paper's lines: one histogram, one vote a point, the bearing in the middle of the sector."""
    histogram = sector_histogram(votes.angle_rad, None, vision.sectors)
    at = strongest(local_peaks(histogram, vision.min_length * length), histogram, vision.max_lines)
    angle = wrap(((at + 0.5) * (TURN / vision.sectors) - np.pi).astype(np.float64))
    sector_std = TURN / vision.sectors / np.sqrt(12.0)
    std = np.full(at.size, np.hypot(max(sector_std, np.deg2rad(vision.bearing_std_deg)), center_std / length))
    return Lines(angle, std, np.zeros(at.size, dtype=np.int64), np.minimum(histogram[at] / length, 1.0))


def strongest(at: Int, histogram: Float, count: int) -> Int:
    """The `count` highest of some sectors, still in order."""
    if at.size <= count:
        return at
    return np.sort(at[np.argsort(-histogram[at], kind="stable")[:count]])


def refined_lines(votes: Votes, length: float, center_std: float, vision: Vision) -> Lines:
    """Lines of either polarity by themselves, each bearing fitted to its points.

    # Paper: one histogram, bearings at the middle of a sector. Here: one for each polarity, because the two sides of a
    # narrow bar would suppress each other; and a fit, because a sector is much wider than what the points can tell
    # (robust sigma on the corridor, same ring centre: 2.9 mrad at the middle of a sector, 0.7 mrad fitted).
    """
    sectors = vision.sectors
    half, reach = round(_WIDE_RAD / TURN * sectors), max(round(_REACH_RAD / TURN * sectors), 1)
    least = min(vision.min_length, vision.min_length_continued) * length
    sector = ((votes.angle_rad / TURN + 0.5) * sectors).astype(np.intp) % sectors
    side = (votes.polarity < 0).astype(np.intp)
    starts: list[Float] = []
    polarities: list[Int] = []
    owner = np.full((2, sectors), -1, dtype=np.intp)  # the line that a sector's points belong to
    for row, sign in enumerate((1, -1)):
        mine = side == row
        histogram = sector_histogram(votes.angle_rad[mine], votes.extent_px[mine], sectors)
        wide = sum((np.roll(histogram, step) for step in range(-half, half + 1) if step), histogram)
        at = strongest(local_peaks(wide, least, reach), wide, vision.max_lines)
        first = sum(a.size for a in starts)
        for step in range(reach, -1, -1):  # nearer peaks overwrite
            owner[row, (at + step) % sectors] = first + np.arange(at.size)
            owner[row, (at - step) % sectors] = first + np.arange(at.size)
        starts.append(wrap(((at + 0.5) * (TURN / sectors) - np.pi).astype(np.float64)))
        polarities.append(np.full(at.size, sign, dtype=np.int64))
    angle, polarity = np.concatenate(starts), np.concatenate(polarities)
    line = owner[side, sector]
    mine = line >= 0
    line, theta, radius, extent = line[mine], votes.angle_rad[mine], votes.radius_px[mine], votes.extent_px[mine]
    angle, std, strength = _fitted(line, theta, radius, extent, angle, length, vision)
    std = np.hypot(std, center_std / (0.5 * length))
    keep = _distinct(angle, polarity, strength) & (strength * length >= least)
    order = np.flatnonzero(keep)
    if order.size > vision.max_lines:
        order = order[np.argsort(-strength[order], kind="stable")[: vision.max_lines]]
    order = order[np.argsort(angle[order], kind="stable")]
    return Lines(angle[order], std[order], polarity[order], np.minimum(strength[order], 1.0))


def _fitted(
    line: NDArray[np.intp], theta: Float, radius: Float, extent: Float, angle: Float, length: float, vision: Vision
) -> tuple[Float, Float, Float]:
    """Angle, sigma and strength of every line by robust least squares on its points' distances from the ray."""
    n = angle.size
    std, strength = np.full(n, np.pi), np.zeros(n)
    for width in (4.0, 2.5, 1.5, 1.5):
        e = radius * wrap(theta - angle[line])
        weight = np.maximum(1.0 - (e / width) ** 2, 0.0) ** 2 * extent

        def total(value: Float) -> Float:
            return np.bincount(line, weights=value, minlength=n).astype(np.float64)

        square = np.maximum(total(weight * radius**2), 1.0)
        angle = wrap(angle + total(weight * radius * e) / square)
        variance = total(weight * e**2) / np.maximum(total(weight), 1e-9)
        std = np.sqrt(_CORRELATED_PX * np.maximum(variance, 0.02) / square)
        strength = total(extent * (np.abs(e) <= width)) / length
    return angle, np.hypot(std, np.deg2rad(vision.bearing_std_deg)), strength


def _distinct(angle: Float, polarity: Int, strength: Float) -> NDArray[np.bool_]:
    """Which lines no stronger one of the same polarity has run into."""
    if angle.size < 2:
        return np.ones(angle.size, dtype=np.bool_)
    near = (np.abs(wrap(angle[:, None] - angle[None, :])) < _SAME_RAD) & (polarity[:, None] == polarity[None, :])
    rank = np.argsort(np.argsort(-strength, kind="stable"), kind="stable")
    beaten: NDArray[np.bool_] = np.any(near & (rank[:, None] > rank[None, :]), axis=1)
    return ~beaten
