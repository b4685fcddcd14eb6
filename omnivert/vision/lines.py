"""Edge points -> vertical lines: radial edges, sector histogram, peaks, bearings (II, steps 2 to 5)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.compiled import compiled
from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Array, Edges
from omnivert.vision.line_fit import fitted
from omnivert.vision.turns import arctan2, cell_of

Float = NDArray[np.float64]
Int = NDArray[np.int64]

RIM_MARGIN_PX = 2.0  # the rim itself is no line
_WIDE_RAD = np.deg2rad(0.5)  # votes this far on either side of a sector still count for its peak
_REACH_RAD = np.deg2rad(1.0)  # and this far on either side of a peak belong to its line
_SAME_RAD = 0.008  # two lines of one polarity that end up this close are one


class Votes(NamedTuple):
    """Edge points whose edge points at where the lines meet, (N,) each."""

    angle_rad: Float  # image angle atan2(-(v - cv), u - cu), (-pi, pi], of the point's line at the horizon
    radius_px: Float
    polarity: Int  # +1: the picture gets brighter in the sense of growing angle; -1: darker
    extent_px: Float  # length of line that the point stands for, along the radius


class Lines(NamedTuple):
    """Lines of one frame, by growing angle, (N,) each.

    A line that does not meet the ring's centre leans: at radius r its image angle is angle + slant (1 / r - 1 / h), h
    the horizon, where a tilt of the axis does not show.
    """

    angle_rad: Float  # image angle, (-pi, pi], at the horizon
    std_rad: Float
    polarity: Int  # +1, -1; 0: not told apart (paper)
    strength: Float  # share of Rmax - Rmin with an edge, 0..1
    inner_px: Float  # radius of the first and of the last of its points
    outer_px: Float
    slant_px: Float  # how far it passes the ring's centre, in the sense of growing angle: as all lines meet
    lean_px: Float  # what its own points say beyond `slant_px`, and the sigma of that
    lean_std_px: Float
    lever: Float  # by how much the angle falls when the slant grows, 1 / px
    found: int = 0  # lines that there would be, were not only the strongest kept; more than N: some are left out


def no_lines() -> Lines:
    return Lines(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64), *(np.empty(0),) * 7)


def lines_from_edges(
    edges: Edges,
    center: tuple[float, float],
    center_std: float,
    ring: MirrorRing,
    vision: Vision,
    meeting: tuple[float, float] = (0.0, 0.0),
) -> Lines:
    """The vertical lines around a ring centre.

    center, center_std  px
    meeting             px  where the lines meet, from the centre
    """
    r_max, tolerance = ring.r_max_px - RIM_MARGIN_PX, vision.edge_tolerance_deg
    votes = radial_votes(edges, center, ring.r_min_px, r_max, tolerance, ring.horizon, meeting)
    length = ring.r_max_px - ring.r_min_px
    if vision.mode == "paper":
        return sector_lines(votes, ring, center_std, vision)
    return refined_lines(votes, length, center_std, vision, ring.horizon, meeting)


def radial_votes(
    edges: Edges,
    center: tuple[float, float],
    r_min: float,
    r_max: float,
    tolerance_deg: float,
    horizon: float = 1.0,
    meeting: tuple[float, float] = (0.0, 0.0),
) -> Votes:
    """The edge points between two radii whose edge points at where lines meet within a tolerance.

    # The gradient of a radial edge is tangential: it is the edge, across the gradient, that must point at the centre.
    """
    tangent = float(np.tan(np.deg2rad(tolerance_deg)))
    table, polarity = _votes(*edges, *center, *meeting, r_min, r_max, horizon, tangent)
    return Votes(table[0], table[1], polarity, table[2])


@compiled
def _votes(
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
) -> tuple[Float, Int]:
    """Angle, radius and extent (3, N), polarity (N,)."""
    table, polarity = np.empty((3, u.size)), np.empty(u.size, dtype=np.int64)
    count = 0
    for k in range(u.size):
        du, dv = np.float64(u[k]) - center_u, np.float64(v[k]) - center_v
        square = du * du + dv * dv
        if square < r_min * r_min or square > r_max * r_max:
            continue
        from_u, from_v = du - meeting_u, dv - meeting_v
        gu, gv = np.float64(gradient_u[k]), np.float64(gradient_v[k])
        along = from_u * gu + from_v * gv  # distance x component along the line
        across = from_v * gu - from_u * gv  # distance x component in the sense of growing angle
        if abs(along) > tangent * abs(across):
            continue
        radius = np.sqrt(square)
        slant = (dv * meeting_u - du * meeting_v) / radius
        angle = arctan2(-dv, du) - slant * (1.0 / radius - 1.0 / horizon)
        if angle > np.pi:
            angle -= TURN
        elif angle <= -np.pi:
            angle += TURN
        table[0, count], table[1, count] = angle, radius
        # A thinned slanted edge has one point a row (or column), so fewer points than its length has pixels.
        table[2, count] = radius / max(abs(du), abs(dv))
        polarity[count] = 1 if across >= 0.0 else -1
        count += 1
    return table[:, :count], polarity[:count]


def sector_histogram(angle: Float, weight: Float | None, sectors: int) -> Float:
    """Votes in each of `sectors` equal sectors, the first from -pi on."""
    sector = ((angle / TURN + 0.5) * sectors).astype(np.intp) % sectors
    return np.bincount(sector, weights=weight, minlength=sectors).astype(np.float64)


def local_peaks(histogram: Float, threshold: float, reach: int = 1) -> Int:
    """Sectors at the threshold or above that no neighbour within `reach` exceeds; the first of equals; circular."""
    return np.flatnonzero(_peaks(histogram, threshold, reach)).astype(np.int64)


@compiled
def _peaks(histogram: Float, threshold: float, reach: int) -> NDArray[np.bool_]:
    sectors = histogram.size
    peak = histogram >= max(threshold, 1e-12)
    for k in range(sectors):
        if peak[k]:
            for step in range(1, reach + 1):
                before, after = histogram[(k - step) % sectors], histogram[(k + step) % sectors]
                if before >= histogram[k] or after > histogram[k]:
                    peak[k] = False
    return peak


@compiled
def _widened(histogram: Float, half: int) -> Float:
    """Each sector's votes and those of `half` sectors on either side."""
    sectors = histogram.size
    wide = np.zeros(sectors)
    for k in range(sectors):
        for step in range(-half, half + 1):
            wide[k] += histogram[(k + step) % sectors]
    return wide


@compiled
def _take_sectors(owner: Int, at: Int, reach: int, first: int) -> None:
    """Writes lines first, first + 1, ... into the sectors around their peaks; a nearer peak takes a sector."""
    for step in range(reach, -1, -1):
        for k in range(at.size):
            owner[(at[k] + step) % owner.size] = first + k
        for k in range(at.size):
            owner[(at[k] - step) % owner.size] = first + k


def sector_lines(votes: Votes, ring: MirrorRing, center_std: float, vision: Vision) -> Lines:
    """The paper's lines: one histogram, one vote a point, the bearing in the middle of the sector."""
    length = ring.r_max_px - ring.r_min_px
    histogram = sector_histogram(votes.angle_rad, None, vision.sectors)
    peaks = local_peaks(histogram, vision.min_length * length)
    at = strongest(peaks, histogram, vision.max_lines)
    angle = wrap(((at + 0.5) * (TURN / vision.sectors) - np.pi).astype(np.float64))
    sector_std = TURN / vision.sectors / np.sqrt(12.0)
    std = np.full(at.size, np.hypot(max(sector_std, np.deg2rad(vision.bearing_std_deg)), center_std / length))
    inner, outer = np.full(at.size, ring.r_min_px), np.full(at.size, ring.r_max_px)
    none, any_lean, strength = np.zeros(at.size), np.full(at.size, np.inf), np.minimum(histogram[at] / length, 1.0)
    return Lines(angle, std, none.astype(np.int64), strength, inner, outer, none, none, any_lean, none, peaks.size)


def strongest(at: Int, histogram: Float, count: int) -> Int:
    """The `count` highest of some sectors, still in order."""
    if at.size <= count:
        return at
    return np.sort(at[np.argsort(-histogram[at], kind="stable")[:count]])


def refined_lines(
    votes: Votes, length: float, center_std: float, vision: Vision, horizon: float, meeting: tuple[float, float]
) -> Lines:
    """Lines of either polarity by themselves, each bearing fitted to its points.

    # Paper: one histogram, bearings at the middle of a sector. Here: one for each polarity, because the two sides of a
    # narrow bar would suppress each other; and a fit, because a sector is much wider than what the points can tell
    # (robust sigma on the corridor, same ring centre: 2.9 mrad at the middle of a sector, 0.7 mrad fitted).
    """
    sectors, left_out = vision.sectors, 0
    half, reach = round(_WIDE_RAD / TURN * sectors), max(round(_REACH_RAD / TURN * sectors), 1)
    least = min(vision.min_length, vision.min_length_continued) * length
    table = _polar_histograms(votes.angle_rad, votes.extent_px, votes.polarity, sectors)
    starts: list[Float] = []
    polarities: list[Int] = []
    owner = np.full((2, sectors), -1, dtype=np.int64)  # the line that a sector's points belong to
    for row, sign in enumerate((1, -1)):
        wide = _widened(table[row], half)
        at = strongest(peaks := np.flatnonzero(_peaks(wide, least, reach)), wide, vision.max_lines)
        left_out += peaks.size - at.size
        _take_sectors(owner[row], at, reach, sum(a.size for a in starts))
        starts.append(wrap(((at + 0.5) * (TURN / sectors) - np.pi).astype(np.float64)))
        polarities.append(np.full(at.size, sign, dtype=np.int64))
    angle, polarity = np.concatenate(starts), np.concatenate(polarities)
    fit = fitted(*votes, owner, angle, horizon)
    angle, std, strength, inner, outer, lean, lean_std, lever = fit
    angle, strength = wrap(angle), strength / length
    std = np.hypot(np.hypot(std, np.deg2rad(vision.bearing_std_deg)), center_std / horizon)
    order = np.flatnonzero(_distinct(angle, polarity, strength) & (strength * length >= least))
    found = order.size + left_out
    if order.size > vision.max_lines:
        order = order[np.argsort(-strength[order], kind="stable")[: vision.max_lines]]
    order = order[np.argsort(angle[order], kind="stable")]
    slant = -np.sin(angle) * meeting[0] - np.cos(angle) * meeting[1]
    rest = (np.minimum(strength, 1.0), inner, outer, slant, lean, lean_std, lever)
    return Lines(angle[order], std[order], polarity[order], *(values[order] for values in rest))._replace(found=found)


@compiled
def _polar_histograms(angle: Float, weight: Float, polarity: Int, sectors: int) -> Float:
    """(2, sectors): the rising edges' votes in sectors, and the falling ones'."""
    histogram = np.zeros((2, sectors))
    for k in range(angle.size):
        histogram[0 if polarity[k] > 0 else 1, cell_of(angle[k], sectors)] += weight[k]
    return histogram


@compiled
def _distinct(angle: Float, polarity: Int, strength: Float) -> NDArray[np.bool_]:
    """Which lines no stronger one of the same polarity has run into; the first of equals stays."""
    keep = np.ones(angle.size, dtype=np.bool_)
    for i in range(angle.size):
        for j in range(angle.size):
            apart = abs(angle[i] - angle[j])
            near = min(apart, TURN - apart) < _SAME_RAD and polarity[i] == polarity[j]
            if near and (strength[j] > strength[i] or (strength[j] == strength[i] and j < i)):
                keep[i] = False
    return keep
