"""A picture, its ring, its edges and lines -> what is wrong with the picture, in words fit for `reasons`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.compiled import compiled
from omnivert.config import MirrorRing
from omnivert.vision.edges import Array, Edges
from omnivert.vision.image import Grey
from omnivert.vision.lines import Lines
from omnivert.vision.ring import RingFound

Float = NDArray[np.float64]

_SPOKES, _SECTORS, _RADII = 72, 36, 16  # samples of the ring; two spokes a sector
_MARGIN_PX = 4.0  # the rim and the camera's own picture are no part of it
_BLACK, _WHITE = 10, 250  # grey
_MUCH = 0.2  # of the ring; healthy rings have 0 black, 0.07 white and 0 without edges at most
_POINTS = 800  # edge points that are looked at
_BARE = 10  # edge points that a sector at least has; healthy ones have 60 and more
_GRID_PX = 8
_REMEMBERED = 31  # frames
_KNOWN_FRAMES, _KNOWN_LINES = 3, 10  # from which on there is something to compare with
_ALL_BARE = 0.9
_MANY_TIMES = 2.0
_FEWER_EDGES, _SHORTER_LINES = 0.65, 0.7  # 2 deg of turn leave 0.48 and 0.60; healthy pictures vary by a tenth


class _Looks(NamedTuple):
    """What the ring of one frame holds."""

    bare: float  # share of directions with hardly an edge, 0..1
    density: float  # edge points in a direction that is not bare
    lines: float
    strength: float  # of all lines together


class FaultFinder:
    """Looks at frame after frame; remembers how many edges and lines the last ones had.

    Frames with few of them are remembered, too: what goes on for long is how this camera sees this place.
    """

    def __init__(self, ring: MirrorRing) -> None:
        self._ring = ring
        turn = (np.arange(_SPOKES) + 0.5) * (TURN / _SPOKES)
        r_min, r_max = ring.r_min_px + _MARGIN_PX, max(ring.r_max_px - _MARGIN_PX, ring.r_min_px + _MARGIN_PX)
        area = (np.arange(_RADII) + 0.5) / _RADII
        self._radius = np.sqrt(r_min**2 + area * (r_max**2 - r_min**2))  # each stands for the same area
        self._cos, self._sin = np.cos(turn), np.sin(turn)
        self._before = np.empty((_REMEMBERED, len(_Looks._fields)))
        self._seen = 0

    def step(
        self, grey: Grey, found: RingFound | None, edges: Edges, lines: Lines, *, sifted: bool = True
    ) -> list[str]:
        """What is wrong, worst first; nothing for a good picture.

        sifted  the edges are those of use, as in most frames; of all edges there are more, and they are not remembered
        """
        u, v = self._ring.center_px if found is None else found.circle[:2]
        kept = lines.angle_rad.size
        told = [f"{lines.found} lines found, the strongest {kept} kept"] if lines.found > kept else []
        black, white = _tones(grey, u, v, self._cos, self._sin, self._radius, _BLACK, _WHITE)
        rest = self._rest(grey, v)
        if black > _MUCH:
            return [f"{_tens(black)} % of the ring is black", *told]
        if white > _MUCH:
            return [f"{_tens(white)} % of the ring is white", *told]
        if rest > 0.0:
            return [f"picture breaks off: its last {_tens(rest)} % are one grey", *told]
        looks = self._looks((u, v), edges, lines)
        told = [*self._against_before(looks), *told]
        if sifted and found is not None and not found.reason and not self._is_passing_by(lines):
            self._before[self._seen % _REMEMBERED] = looks
            self._seen += 1
        return told

    def _rest(self, grey: Grey, center_v: float) -> float:
        """Share of the picture, from its end on, that is one grey; 0 unless it reaches far into the ring."""
        some = grey[::_GRID_PX, ::_GRID_PX]
        last = some[-1, -1]
        if np.any(some[-1] != last):
            return 0.0
        other = np.flatnonzero(np.any(some != last, axis=1))
        rows = some.shape[0] - 1 - (int(other[-1]) if other.size else -1)
        r_max = self._ring.r_max_px
        into = min(center_v + r_max, grey.shape[0]) - (grey.shape[0] - rows * _GRID_PX)
        return rows / some.shape[0] if into > 2.0 * _MUCH * r_max else 0.0

    def _looks(self, center: tuple[float, float], edges: Edges, lines: Lines) -> _Looks:
        step, r_min, r_max = max(edges.u_px.size // _POINTS, 1), self._radius[0], self._radius[-1]
        bare, points = _edge_spread(edges.u_px, edges.v_px, step, *center, r_min, r_max, _SECTORS, _BARE)
        density = points / max(_SECTORS * (1.0 - bare), 1.0)
        return _Looks(bare, density, lines.angle_rad.size, float(np.sum(lines.strength)))

    def _is_passing_by(self, lines: Lines) -> bool:
        """Whether there are many lines too many at once, as of blinds; after them a good picture would look smeared."""
        kept = lines.angle_rad.size
        return self._seen > 0 and lines.found > kept > _MANY_TIMES * self._usual().lines

    def _usual(self) -> _Looks:
        """The median of what is remembered."""
        before = self._before[: self._seen]
        middle = before.shape[0] // 2
        return _Looks(*np.partition(before, middle, axis=0)[middle].tolist())

    def _against_before(self, now: _Looks) -> list[str]:
        """Blur takes away edge points and lines all around, a cover all of them in a part."""
        if self._seen < _KNOWN_FRAMES:
            return []
        usual = self._usual()
        thin = now.density < _FEWER_EDGES * usual.density and now.strength < _SHORTER_LINES * usual.strength
        if now.bare > usual.bare + _MUCH and (now.bare > _ALL_BARE or not thin):
            return [f"hardly an edge in {_tens(now.bare)} % of the ring, more than before"]
        if thin and usual.lines >= _KNOWN_LINES:
            return ["far fewer edges than before: smeared or out of focus"]
        return []


def _tens(share: float) -> int:
    return 10 * round(10.0 * share)


@compiled
def _tones(
    grey: Grey, center_u: float, center_v: float, cos: Float, sin: Float, radius: Float, black: int, white: int
) -> tuple[float, float]:
    """Shares of the samples: black ones in spokes that are mostly black, and white ones."""
    height, width = grey.shape
    total = all_black = all_white = 0
    for i in range(cos.size):
        dark = here = 0
        for k in range(radius.size):
            u, v = int(np.rint(center_u + radius[k] * cos[i])), int(np.rint(center_v - radius[k] * sin[i]))
            if u < 0 or v < 0 or u >= width or v >= height:
                continue
            here += 1
            dark += grey[v, u] <= black
            all_white += grey[v, u] >= white
        total += here
        if 2 * dark > here:
            all_black += dark
    return all_black / max(total, 1), all_white / max(total, 1)


@compiled
def _edge_spread(
    u: Array,
    v: Array,
    step: int,
    center_u: float,
    center_v: float,
    r_min: float,
    r_max: float,
    sectors: int,
    bare: int,
) -> tuple[float, float]:
    """Share of sectors with less than `bare` points, and the number of points in the ring, from every `step`-th.

    The sectors are equal in size but for a quarter.
    """
    count = np.zeros(sectors, dtype=np.int64)
    for k in range(0, u.size, step):
        x, y = u[k] - center_u, center_v - v[k]
        square = x * x + y * y
        if square < r_min * r_min or square > r_max * r_max:
            continue
        along = y / (abs(x) + abs(y))  # -1..1; grows with the angle on the right, falls on the left
        turn = 1.0 + along if x >= 0.0 else 3.0 - along  # 0..4 around
        count[min(int(turn * 0.25 * sectors), sectors - 1)] += 1
    empty = total = 0
    for k in range(sectors):
        total += count[k] * step
        empty += count[k] * step < bare
    return empty / sectors, float(total)
