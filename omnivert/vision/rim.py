"""Edge points of one picture -> the mirror's rim: where it is, and its shape (II, step 1)."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.compiled import compiled
from omnivert.vision.cholesky import factored, solved
from omnivert.vision.edges import Array, Edges
from omnivert.vision.turns import arctan2, cell_of

Float = NDArray[np.float64]

_ALONG = 0.82  # cos 35 deg: the gradient of a rim's edge points at the centre, or away from it, within this
_BINS = 360  # stretches of the rim that are asked one by one whether they were seen
_ON_RIM_PX = 1.5
_ON_RIM = 1.0 / 150.0  # of the radius
RIM_BAND = 4.0  # half width of the band about the rim, as a multiple of what lies on it
_COARSE_RADIUS = 28.0  # cells; the wide search shrinks the picture until the rim has this radius
_WIDE_CANDIDATES = 4  # peaks of the wide search that are looked at closely
_CORRELATED = 3.0  # neighbouring points share their errors: the claimed sigma is so much larger
_MIN_EDGES = 30
_WIDTHS = (3.3, 2.0, 1.3)  # points farther off the rim have no say; step after step, of what lies on it
_TAIL = 3.0  # sigmas, in the last steps
_SETTLED_PX = 0.003
_BEST_PX = 0.05  # no edge point is better than this


class Shape(NamedTuple):
    """A rim as the camera sees it: at angle a its radius is radius + even cos 2a + odd sin 2a."""

    radius_px: float
    even_px: float  # an ellipse, when the camera does not look along the mirror's axis
    odd_px: float
    std_px: tuple[float, float, float]  # how well the three are known


class Circle(NamedTuple):
    """A rim as fitted."""

    u_px: float
    v_px: float
    radius_px: float
    quality: float  # share of the whole circle that was seen, less what chance alone would show
    std_px: float  # of the centre, each axis
    even_px: float = 0.0  # see Shape
    odd_px: float = 0.0


def configured_shape(radius: float) -> Shape:
    """What is known of a rim before it has been seen: round, its radius measured to about a pixel."""
    slack = max(1.0, 0.005 * radius)
    return Shape(radius, 0.0, 0.0, (slack, slack, slack))


def circle_here(edges: Edges, center: tuple[float, float], shape: Shape, step: float) -> Circle | None:
    """The rim whose centre is within a few pixels of `center`, at most `step`, without looking around."""
    return _circle(edges, center, shape, 0.0, step, refine=True)


def circle_near(
    edges: Edges, center: tuple[float, float], shape: Shape, search: float, *, refine: bool = True
) -> Circle | None:
    """The rim of about this shape that passes through most edges, its centre within `search` of `center` on each axis.

    center, search  px
    refine          fit centre and shape below the pixel; else the accumulator's maximum (the paper)
    """
    return _circle(edges, center, shape, search, 1.5 * search, refine=refine)


def _circle(
    edges: Edges, center: tuple[float, float], shape: Shape, search: float, lean: float, *, refine: bool
) -> Circle | None:
    radius = shape.radius_px
    reach, leaning = rim_zone(radius, lean)
    rim = _rim_edges(*edges, *center, radius, reach, 1.0 - leaning)
    u, v, strength = rim
    if u.size < _MIN_EDGES:
        return None
    start = _accumulator_peak(u, v, radius, int(np.ceil(search))) if search > 0.0 else (0.0, 0.0)
    fit = _fitted(u, v, start, shape, far=search > 0.0) if refine else _Fit(*start, radius, 0.0, 0.0, 0.5)
    quality = _rim_share(u, v, strength, fit.u, fit.v, fit.radius, fit.even, fit.odd, on_rim_px(radius))
    return Circle(center[0] + fit.u, center[1] + fit.v, fit.radius, quality, fit.std, fit.even, fit.odd)


def rim_zone(radius: float, off: float) -> tuple[float, float]:
    """Where a rim's edges are, seen from a centre that may be off by so much: how far from the radius, px, and how
    far their gradients turn from it, the square of the sine."""
    angle = min(np.arccos(_ALONG) + off / radius, 0.5 * np.pi)
    return off + RIM_BAND * on_rim_px(radius), float(np.sin(angle)) ** 2


def circle_anywhere(edges: Edges, shape: Shape, *, refine: bool = True) -> Circle | None:
    """The clearest rim of about this shape, its centre anywhere within a radius of the edges; for when it is lost."""
    if edges.u_px.size < _MIN_EDGES:
        return None
    radius = shape.radius_px
    cell = max(radius / _COARSE_RADIUS, 1.0)
    margin = int(np.ceil(radius / cell)) + 2
    left, top = float(edges.u_px.min()), float(edges.v_px.min())
    column = ((edges.u_px - left) / cell).astype(np.intp) + margin
    row = ((edges.v_px - top) / cell).astype(np.intp) + margin
    size = (int(row.max()) + 1 + margin, int(column.max()) + 1 + margin)
    picture = np.zeros(size, dtype=np.float32)
    picture[row, column] = 1.0
    mask = np.zeros_like(picture)
    turn = np.linspace(0.0, TURN, int(8.0 * radius / cell), endpoint=False)
    mask[np.rint(radius / cell * np.sin(turn)).astype(int), np.rint(radius / cell * np.cos(turn)).astype(int)] = 1.0
    accumulator = np.fft.irfft2(np.fft.rfft2(picture) * np.fft.rfft2(mask), s=size)
    best: Circle | None = None
    for _ in range(_WIDE_CANDIDATES):
        v, u = np.unravel_index(int(np.argmax(accumulator)), size)
        accumulator[max(v - 3, 0) : v + 4, max(u - 3, 0) : u + 4] = 0.0
        center = (left + (float(u) - margin + 0.5) * cell, top + (float(v) - margin + 0.5) * cell)
        circle = circle_near(edges, center, shape, 2.0 * cell, refine=refine)
        if circle is not None and (best is None or circle.quality > best.quality):
            best = circle
    return best


@compiled
def _rim_edges(
    u: Array,
    v: Array,
    gradient_u: Array,
    gradient_v: Array,
    center_u: float,
    center_v: float,
    radius: float,
    reach: float,
    along: float,
) -> Float:
    """Edges that may lie on the rim, relative to the centre: u, v, strength (3, N).

    They are about the right distance from the centre, and their gradient runs along the radius.

    along  least square of the cosine between gradient and radius
    """
    low, high = max(radius - reach, 0.0) ** 2, (radius + reach) ** 2
    kept = np.empty((3, u.size))
    count = 0
    for k in range(u.size):
        du, dv = np.float64(u[k]) - center_u, np.float64(v[k]) - center_v
        square = du * du + dv * dv
        if square < low or square > high:
            continue
        gu, gv = np.float64(gradient_u[k]), np.float64(gradient_v[k])
        strength = gu * gu + gv * gv
        radial = du * gu + dv * gv
        if radial * radial < along * square * strength:
            continue
        kept[0, count], kept[1, count], kept[2, count] = du, dv, np.sqrt(strength)
        count += 1
    return kept[:, :count]


def _accumulator_peak(u: Float, v: Float, radius: float, search: int) -> tuple[float, float]:
    """Centre, relative to the window's, under which the circular mask covers most edges.

    The convolution of the binary edge image with the mask, turned round: every edge adds the mask to the accumulator.
    """
    smooth = np.asarray(cv2.blur(_accumulator(u, v, radius, search), (3, 3), borderType=cv2.BORDER_CONSTANT))
    v_peak, u_peak = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return float(u_peak - search), float(v_peak - search)


@compiled
def _accumulator(u: Float, v: Float, radius: float, search: int) -> Float:
    side = 2 * search + 1
    votes = np.zeros((side, side))
    for k in range(u.size):
        # Along u where the mask runs along u, along v elsewhere: it then has one cell a step and no gaps.
        along_u = abs(v[k]) >= abs(u[k])
        a, b = (u[k], v[k]) if along_u else (v[k], u[k])
        for own in range(side):
            root = np.sqrt(max(radius * radius - (a - (own - search)) ** 2, 0.0))
            other = int(np.rint(b - np.copysign(root, b))) + search
            if 0 <= other < side:
                if along_u:
                    votes[other, own] += 1.0
                else:
                    votes[own, other] += 1.0
    return votes


class _Fit(NamedTuple):
    u: float
    v: float
    radius: float
    even: float
    odd: float
    std: float


def _fitted(u: Float, v: Float, start: tuple[float, float], shape: Shape, *, far: bool) -> _Fit:
    """Centre and shape by robust least squares on the points near the rim; px, relative to the window's centre.

    # Paper: the accumulator's maximum, to the pixel, radius fixed, round. Here: all fitted below the pixel, because the
    # centre's error turns every bearing by up to (error / r), and a rim that is not round, or of another radius than
    # measured, would shift the centre when a part of it is covered. What is known of the shape takes part.
    """
    first, *then = _WIDTHS if far else _WIDTHS[1:]
    widths = on_rim_px(shape.radius_px) * np.array((first, *then, 0.0, 0.0, 0.0))
    x, std = _refined(u, v, np.array((*start, *shape[:3])), np.array(shape[:3]), np.array(shape.std_px), widths)
    u0, v0, radius, even, odd = (float(value) for value in x)
    return _Fit(u0, v0, radius, even, odd, min(max(std, 1e-3), radius))


@compiled
def _refined(u: Float, v: Float, x: Float, known: Float, known_std: Float, widths: Float) -> tuple[Float, float]:
    """Gauss-Newton from x = (u, v, radius, even, odd), a step a width; the solution, and the centre's sigma, px."""
    std = 0.5
    width = widths[0]
    for step in range(1, widths.size):
        normal, right, weight, square, count = _rim_normal(u, v, x, width)
        if count < _MIN_EDGES:
            break
        spread = max(square / weight, _BEST_PX * _BEST_PX)
        # Lights and edges of the world that end beside the rim pull at it: no wider than the rim itself scatters.
        width = max(widths[step], _TAIL * np.sqrt(spread))
        variance = _CORRELATED * _CORRELATED * spread
        for i in range(3):
            information = variance / (known_std[i] * known_std[i])
            normal[2 + i, 2 + i] += information
            right[2 + i] += information * (known[i] - x[2 + i])
        for i in range(5):
            normal[i, i] += 1e-6
        lower = factored(normal)
        move = solved(lower, right)
        most = 0.0
        for i in range(5):
            x[i] += move[i]
            most = max(most, abs(move[i]))
        std = 0.0
        for i in range(2):
            right[:] = 0.0
            right[i] = variance
            std = max(std, np.sqrt(solved(lower, right)[i]))
        if widths[step] == 0.0 and most < _SETTLED_PX:
            break
    return x, std


@compiled
def _seen_from(du: float, dv: float) -> tuple[float, float, float, float, float]:
    """A point from the centre: distance, cos and sin of its angle a, cos 2a and sin 2a; also on the centre itself."""
    distance = max(np.sqrt(du * du + dv * dv), 1e-9)
    cos, sin = du / distance, dv / distance
    return distance, cos, sin, cos * cos - sin * sin, 2.0 * cos * sin


@compiled
def _rim_normal(u: Float, v: Float, x: Float, width: float) -> tuple[Float, Float, float, float, int]:
    """Normal equations of one step: matrix (5, 5), right side (5,), sum of weights, weighted squares, points used."""
    normal, right, slope = np.zeros((5, 5)), np.zeros(5), np.empty(5)
    sum_weight = sum_square = 0.0
    count = 0
    for k in range(u.size):
        du, dv = u[k] - x[0], v[k] - x[1]
        distance, cos, sin, even, odd = _seen_from(du, dv)
        e = distance - x[2] - x[3] * even - x[4] * odd
        near = 1.0 - (e / width) ** 2
        if near <= 0.0:
            continue
        weight = near * near
        slope[0], slope[1], slope[2], slope[3], slope[4] = cos, sin, 1.0, even, odd
        for i in range(5):
            part = weight * slope[i]
            right[i] += part * e
            for j in range(i, 5):
                normal[i, j] += part * slope[j]
        sum_weight += weight
        sum_square += weight * e * e
        count += 1
    for i in range(5):
        for j in range(i):
            normal[i, j] = normal[j, i]
    return normal, right, sum_weight, sum_square, count


@compiled
def _rim_share(
    u: Float,
    v: Float,
    strength: Float,
    center_u: float,
    center_v: float,
    radius: float,
    even: float,
    odd: float,
    on_rim: float,
) -> float:
    """Share of the rim where the strongest edge of a band about it lies on it, less what chance gives; 0..1."""
    strongest, off = np.zeros(_BINS), np.zeros(_BINS)
    for k in range(u.size):
        du, dv = u[k] - center_u, v[k] - center_v
        distance, _, _, cos_2a, sin_2a = _seen_from(du, dv)
        e = distance - radius - even * cos_2a - odd * sin_2a
        if abs(e) > RIM_BAND * on_rim:
            continue
        place = cell_of(arctan2(dv, du), _BINS)
        if strength[k] > strongest[place]:
            strongest[place], off[place] = strength[k], abs(e)
    taken = on = 0
    for place in range(_BINS):
        if strongest[place] > 0.0:
            taken += 1
            on += off[place] <= on_rim
    return max((on - taken / RIM_BAND) / (1.0 - 1.0 / RIM_BAND) / _BINS, 0.0)


def on_rim_px(radius: float) -> float:
    """How far off the circle an edge still belongs to the rim; no mirror's rim is quite round."""
    return max(_ON_RIM_PX, _ON_RIM * radius)
