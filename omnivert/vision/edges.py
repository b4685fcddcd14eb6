"""Grey picture -> thinned edge points with their gradients (II, steps 2 and 3); ring and lines both start here."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.vision.image import Grey

Array = NDArray[np.float32]

PLAIN = np.arange(256, dtype=np.float32)
"""The tone of the picture as it is."""

_EXPONENT = 1.5  # of the tone that light is turned back into
_WHITE_SHARE = 0.95  # of the ring's pixels are darker than what is taken for white
_USUAL_WHITE = 150.0  # of its ring, for a picture that is neither bright nor dim
_DARKEST_WHITE = 80.0  # grey steps; darker pictures stay dark, or their noise would become edges
_GRID_PX = 8  # a pixel in so many, each way, tells how bright the picture is
_LEAST_MAGNITUDE = 1.0  # grey steps x 8; a flat picture has no edges, whatever the configuration says


class Band(NamedTuple):
    """The pixels between two distances from a point, and which edges there are of use; as it stands, all of them."""

    u_px: float
    v_px: float
    inner_px: float
    outer_px: float
    toward_u_px: float = 0.0  # edges that point here are of use ...
    toward_v_px: float = 0.0
    leaning: float = 2.0  # ... to within an angle of which this is the square of the sine
    rim_px: float = np.inf  # from this distance on edges across the radius are, too ...
    rim_leaning: float = 0.0  # ... to within an angle of which this is the square of the sine


class Edges(NamedTuple):
    """Thinned edge points, (N,) each; u to the right, v down, pixel centres at integers."""

    u_px: Array  # below the pixel across the edge, along the picture axis nearer to the gradient
    v_px: Array
    gradient_u: Array  # Sobel, grey steps x 8
    gradient_v: Array


def no_edges() -> Edges:
    none = np.empty(0, dtype=np.float32)
    return Edges(none, none, none, none)


def everywhere(grey: Grey) -> Band:
    """The band that holds the whole picture."""
    height, width = grey.shape
    return Band(0.0, 0.0, 0.0, float(np.hypot(width, height)))


def tone_of_light(grey: Grey, band: Band) -> Array:
    """A tone that undoes a camera's exposure and a part of its response; (256,) grey steps.

    # Paper: Sobel on the grey values. Here: on (grey / white)^1.5, because the lens blurs light, and the camera's
    # response then moves every edge towards its dark side (robust sigma on the corridor 0.69 mrad, 0.51 so). White is
    # halfway between this picture's and a usual one: dim edges are found, and most noise is not.
    """
    inside = _inside(grey, *band[:4])
    if inside.size == 0:
        return PLAIN
    rank = int(_WHITE_SHARE * (inside.size - 1))
    white = max(float(np.partition(inside, rank)[rank]), _DARKEST_WHITE)
    return np.asarray(255.0 * (PLAIN / np.sqrt(white * _USUAL_WHITE)) ** _EXPONENT, dtype=np.float32)


@compiled
def _inside(grey: Grey, center_u: float, center_v: float, inner: float, outer: float) -> Grey:
    """Some of the pixels between two distances from a point."""
    height, width = grey.shape
    some = np.empty(((height - 1) // _GRID_PX + 1) * ((width - 1) // _GRID_PX + 1), dtype=np.uint8)
    count = 0
    for v in range(0, height, _GRID_PX):
        for u in range(0, width, _GRID_PX):
            square = (u - center_u) ** 2 + (v - center_v) ** 2
            if inner * inner <= square <= outer * outer:
                some[count] = grey[v, u]
                count += 1
    return some[:count]


class EdgeFinder:
    """Edge points of frame after frame in one room of memory, which is made when the first picture comes."""

    def __init__(self, min_magnitude: float) -> None:
        """min_magnitude  grey steps x 8; weaker pixels are no edge"""
        self._least = max(min_magnitude, _LEAST_MAGNITUDE)
        self._room = np.empty((4, 0), dtype=np.float32)
        self._rows = np.empty((4, 3, 0), dtype=np.float32)
        self._mask = np.empty(0, dtype=np.bool_)
        self._column = np.empty(0, dtype=np.float32)
        self._place = np.empty(0, dtype=np.int32)

    def step(self, grey: Grey, band: Band, tone: Array = PLAIN) -> Edges:
        """Points of use in the band where the gradient's magnitude (eq. 1) has a ridge across the edge.

        grey  (H, W)  uint8
        tone  (256,)  what the picture's grey values are taken for

        The points are views that the next step overwrites. The picture's two outermost rows and columns have none.
        """
        height, width = grey.shape
        if height < 5 or width < 5:
            return no_edges()
        if self._rows.shape[2] < width:
            self._rows = np.empty((4, 3, width), dtype=np.float32)
            self._mask = np.empty(width, dtype=np.bool_)
            self._column = np.arange(width, dtype=np.float32)
            self._place = np.empty(width + 1, dtype=np.int32)
        if self._room.shape[1] < grey.size:  # three pixels of four may be ridges, in a picture made to be difficult
            self._room = np.empty((4, grey.size), dtype=np.float32)
        rows = self._rows, self._mask, self._column, self._place
        count = _ridges(np.ascontiguousarray(grey), *band, tone, self._least, *rows, self._room)
        return Edges(*self._room[:, :count])


def thinned_edges(grey: Grey, band: Band, min_magnitude: float) -> Edges:
    """The edge points of one picture, for whoever has no next one."""
    return EdgeFinder(min_magnitude).step(grey, band)


@compiled
def _ridges(
    grey: Grey,
    center_u: float,
    center_v: float,
    inner: float,
    outer: float,
    toward_u: float,
    toward_v: float,
    leaning: float,
    rim: float,
    rim_leaning: float,
    tone: Array,
    least: float,
    rows: Array,
    mask: NDArray[np.bool_],
    column: Array,
    place: NDArray[np.int32],
    room: Array,
) -> int:
    """Writes u, v and both gradients of every ridge point into `room`, and tells how many there are.

    # Paper: silent on how edges are thinned. Here: along the picture axis nearer to the gradient, because an edge then
    # keeps exactly one point in each row (or column) that it crosses, and its place comes below the pixel for free.
    """
    height, width = grey.shape
    count = 0
    least_square = np.float32(least * least)
    top, bottom = max(int(np.ceil(center_v - outer)), 2), min(int(np.floor(center_v + outer)), height - 3)
    ready = top - 2  # the last row whose gradients stand in `rows`, three rows by three; the fourth holds tones
    toned = top - 3
    for v in range(top, bottom + 1):
        while ready < v + 1:
            ready += 1
            reach = np.sqrt(max(outer * outer - max(abs(ready - center_v) - 1.0, 0.0) ** 2, 0.0)) + 2.0
            left, right = max(int(center_u - reach), 1), min(int(center_u + reach) + 1, width - 2)
            while toned < ready + 1:
                toned += 1
                _tone_row(grey[toned], tone, rows[3, toned % 3])
            if left <= right:
                _sobel_row(
                    rows[3, (ready - 1) % 3], rows[3, ready % 3], rows[3, (ready + 1) % 3], left, right, rows[ready % 3]
                )
        away = (v - center_v) ** 2
        reach = np.sqrt(max(outer * outer - away, 0.0))
        left, right = max(int(np.ceil(center_u - reach)), 2), min(int(np.floor(center_u + reach)), width - 3)
        hole = np.sqrt(inner * inner - away) if inner * inner > away else -1.0
        hole_left = int(np.ceil(center_u - hole)) if hole >= 0.0 else right + 1
        hole_right = int(np.floor(center_u + hole)) if hole >= 0.0 else right
        before, here, after = rows[(v - 1) % 3], rows[v % 3], rows[(v + 1) % 3]
        for part in range(2):
            first, last = (left, min(hole_left - 1, right)) if part == 0 else (max(hole_right + 1, left), right)
            if first > last:
                continue
            ridge = mask[: last - first + 1]
            _ridge_row(
                here[0, first:],
                here[1, first:],
                here[2, first - 1 :],
                before[2, first:],
                after[2, first:],
                least_square,
                ridge,
            )
            _of_use(
                here[0, first:],
                here[1, first:],
                column[first:],
                np.float32(v - toward_v),
                np.float32(toward_u),
                np.float32(leaning),
                np.float32(v - center_v),
                np.float32(center_u),
                np.float32(rim * rim),
                np.float32(1.0 - rim_leaning),
                ridge,
            )
            count += _points(before, here, after, first, np.float32(v), ridge, place, room[:, count:])
    return count


@compiled
def _ridge_row(
    gradient_u: Array,
    gradient_v: Array,
    squares: Array,
    above: Array,
    below: Array,
    least: np.float32,
    ridge: NDArray[np.bool_],
) -> None:
    """Marks the pixels of a row that exceed both neighbours across the edge; `squares` begins one pixel earlier."""
    left, here, right = squares, squares[1:], squares[2:]
    for k in range(ridge.size):
        square = here[k]
        across_u = (square >= left[k]) & (square > right[k])
        across_v = (square >= above[k]) & (square > below[k])
        u, v = abs(gradient_u[k]), abs(gradient_v[k])
        ridge[k] = (square > least) & (((u >= v) & across_u) | ((u < v) & across_v))


@compiled
def _points(
    before: Array,
    here: Array,
    after: Array,
    first: int,
    v: np.float32,
    ridge: NDArray[np.bool_],
    place: NDArray[np.int32],
    room: Array,
) -> int:
    """Writes u, v and both gradients of a row's marked pixels, the parabola's top across the edge; their number."""
    count = 0
    for k in range(ridge.size):  # without a branch: marks come and go too fast to be guessed
        place[count] = first + k
        count += ridge[k]
    out_u, out_v, out_gradient_u, out_gradient_v = room[0], room[1], room[2], room[3]
    for i in range(count):
        u = place[i]
        gradient_u, gradient_v = here[0, u], here[1, u]
        along_u = abs(gradient_u) >= abs(gradient_v)
        out_u[i], out_v[i] = (here[2, u - 1], here[2, u + 1]) if along_u else (before[2, u], after[2, u])
        out_gradient_u[i], out_gradient_v[i] = gradient_u, gradient_v
    for i in range(count):
        gradient_u, gradient_v = out_gradient_u[i], out_gradient_v[i]
        a, b = np.sqrt(out_u[i]), np.sqrt(out_v[i])
        m = np.sqrt(gradient_u * gradient_u + gradient_v * gradient_v)
        offset = np.float32(0.5) * (a - b) / min(a - m - m + b, np.float32(-1e-6))
        along_u = abs(gradient_u) >= abs(gradient_v)
        out_u[i] = np.float32(place[i]) + (offset if along_u else np.float32(0.0))
        out_v[i] = v + (np.float32(0.0) if along_u else offset)
    return count


@compiled
def _of_use(
    gradient_u: Array,
    gradient_v: Array,
    column: Array,
    toward_dv: np.float32,
    toward_u: np.float32,
    leaning: np.float32,
    center_dv: np.float32,
    center_u: np.float32,
    rim_square: np.float32,
    across: np.float32,
    ridge: NDArray[np.bool_],
) -> None:
    """Takes the mark from the pixels of a row whose edge neither points where lines point nor lies across the rim."""
    for k in range(ridge.size):
        gu, gv = gradient_u[k], gradient_v[k]
        square = gu * gu + gv * gv
        du, radial_u = column[k] - toward_u, column[k] - center_u
        along, radial = du * gu + toward_dv * gv, radial_u * gu + center_dv * gv
        away = radial_u * radial_u + center_dv * center_dv
        points = along * along <= leaning * square * (du * du + toward_dv * toward_dv)
        rim = (away >= rim_square) & (radial * radial >= across * square * away)
        ridge[k] = ridge[k] & (points | rim)


@compiled
def _tone_row(grey: NDArray[np.uint8], tone: Array, row: Array) -> None:
    for u in range(grey.size):
        row[u] = tone[grey[u]]


@compiled
def _sobel_row(above: Array, here: Array, below: Array, left: int, right: int, row: Array) -> None:
    """Sobel along u and v, and their squares' sum, of the pixels left .. right of a row."""
    # Slices that all begin at 0: an index that cannot be negative is what lets the compiler work on many at a time.
    a, b, c = above[left - 1 :], above[left:], above[left + 1 :]
    d, f = here[left - 1 :], here[left + 1 :]
    g, h, i = below[left - 1 :], below[left:], below[left + 1 :]
    out_u, out_v, out_square = row[0, left:], row[1, left:], row[2, left:]
    for k in range(right - left + 1):
        falling, rising = i[k] - a[k], c[k] - g[k]  # the two diagonals are shared by both gradients
        across, down = f[k] - d[k], h[k] - b[k]
        gradient_u = falling + rising + across + across
        gradient_v = falling - rising + down + down
        out_u[k] = gradient_u
        out_v[k] = gradient_v
        out_square[k] = gradient_u * gradient_u + gradient_v * gradient_v
