"""Pictures whose rim is known -> Rmin: where the robot's own image ends and the world begins."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.vision.fall import Grid, falls
from omnivert.vision.image import WORK_RADIUS_PX, Grey
from omnivert.vision.survey import MOST_SEARCHED, Rim, Smaller

Float = NDArray[np.float64]

SAFE_SHARE = 0.30  # of Rmax: Rmin where nothing tells it; the robot's own image ends below it in the mirrors we know
_LEAST, _MOST = 0.08, 0.50  # of Rmax: where the robot's own image may end
_OFF = 0.06  # of Rmax: how far the middle of that image may lie from the rim's
_STEP_PX = 2.0  # from one such middle to the next
_WIDTH = 0.05  # of the radius: how wide its border may be
_BLUR_PX = 1.0
_CLEAR = 0.85  # one-sidedness of a border that is believed by itself ...
_SUPPORTED = 0.55  # ... and of one beyond which the pictures begin to change
_TIE = 0.06  # borders that come so near to the best are as good; the outermost is taken
_AWAY = 1.5  # a border's say shrinks with its distance from the middle, in Rmax
_CHANGE, _CHANGE_STEPS = 0.25, 6.0  # a place changes: by this share of what the world does, and by so many grey steps
_MOVED_SHARE = 0.5  # of the world's places that change, when the camera has moved
_LEAST_PICTURES = 3  # that tell what changes
_NEAR_PX = 6.0  # radii within this may be the same border's
_GAP = 0.02  # of Rmax, to both sides of a border: where change is asked


class Told(StrEnum):
    """What an Rmin rests on."""

    BOTH = "both"  # a border, and the pictures change beyond it
    CHANGE = "change"  # the pictures change beyond it; no clear border
    BORDER = "border"  # a clear border; the pictures do not tell more
    NOTHING = "nothing"  # a share of Rmax


class Inner(NamedTuple):
    """Rmin, about the rim's centre."""

    radius_px: float
    std_px: float
    told: Told


class _Border(NamedTuple):
    radius: float
    away: float  # of its centre from the rim's
    net: float  # one-sidedness
    slack: float  # half the range of radii that are as good


def inner_radius(pictures: Sequence[Grey], rim: Rim) -> Inner:
    """Where the robot's own image ends.

    pictures  (H, W) uint8, those in which the rim was found are used

    It is the same in every picture, and a camera looks at a round thing: the mirror shows its lens and its holder.
    """
    some = np.unique(np.linspace(0, len(rim.used) - 1, min(len(rim.used), 2 * MOST_SEARCHED)).astype(int))
    smaller = [Smaller.of(pictures[rim.used[k]], WORK_RADIUS_PX / rim.radius_px) for k in some]
    centers = np.array([one.into(*rim.centers_px[k]) for one, k in zip(smaller, some, strict=True)])
    scale = smaller[0].down
    radius, blurred = scale * rim.radius_px, [_blurred(one.grey) for one in smaller]
    change = _change(blurred, centers, radius)
    borders = _borders(blurred, centers, radius)
    if change is None:
        clear = [(border, border.net) for border in borders if border.net >= _CLEAR]
        return _inner(_outermost(clear, radius), scale, Told.BORDER) if clear else _untold(rim)
    gap = max(_GAP * radius, 2.0)
    within, beyond = ([float(np.interp(b.radius + side, *change)) for b in borders] for side in (-gap, gap))
    told = list(zip(borders, within, beyond, strict=True))
    there = [(b, b.net + after - before) for b, before, after in told if after - before > _CHANGE]
    if there:
        return _inner(_outermost(there, radius), scale, Told.BOTH)
    clear = [(b, b.net) for b, before, _ in told if b.net >= _CLEAR and before < _MOVED_SHARE]
    if clear:
        return _inner(_outermost(clear, radius), scale, Told.BORDER)
    starts = _sets_in(*change)
    return _untold(rim) if starts is None else Inner(starts / scale, max(_GAP * rim.radius_px, 2.0), Told.CHANGE)


def _untold(rim: Rim) -> Inner:
    return Inner(SAFE_SHARE * rim.radius_px, 0.0, Told.NOTHING)


def _blurred(grey: Grey) -> Grey:
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), _BLUR_PX), dtype=np.uint8)


def _inner(border: _Border, scale: float, told: Told) -> Inner:
    return Inner((border.radius + border.away) / scale, max(border.slack, 1.0) / scale, told)


def _outermost(borders: list[tuple[_Border, float]], radius: float) -> _Border:
    said = [(border, value - _AWAY * border.away / radius) for border, value in borders]
    best = max(value for _, value in said)
    return max((border for border, value in said if value >= best - _TIE), key=lambda border: border.radius)


def _borders(pictures: Sequence[Grey], centers: Float, radius: float) -> list[_Border]:
    """Circles near the middle across which the pictures are one-sided: a local best among the radii each."""
    steps = int(_OFF * radius / _STEP_PX)
    off = _STEP_PX * np.arange(-steps, steps + 1)  # the rim's own centre among them
    radii = np.arange(_LEAST * radius, _MOST * radius, 1.0)
    some = slice(None, None, max(len(pictures) // MOST_SEARCHED, 1))
    each = zip(pictures[some], centers[some], strict=True)
    net = np.median([falls(grey, Grid(u + off, v + off, radii), _WIDTH)[0] for grey, (u, v) in each], axis=0)
    away = np.hypot(off[:, None], off[None, :]).ravel()
    borders = []
    for sided in (net, -net):  # bright or dark inside
        flat = sided.reshape(-1, radii.size)
        value = flat - _AWAY * away[:, None] / radius
        place, best = value.argmax(axis=0), value.max(axis=0)
        for k in range(1, radii.size - 1):
            one = flat[place[k]]
            if best[k] >= max(best[k - 1], best[k + 1]) and one[k] >= _SUPPORTED:
                like = (one >= one[k] - _TIE) & (np.abs(radii - radii[k]) <= _NEAR_PX)
                slack = float(np.abs(radii - radii[k])[like].max())
                borders.append(_Border(float(radii[k]), float(away[place[k]]), float(one[k]), slack))
    return borders


def _change(pictures: Sequence[Grey], centers: Float, radius: float) -> tuple[Float, Float] | None:
    """(R,) radii, (R,) share of the places at each that change from picture to picture; None: the world does not."""
    if len(pictures) < _LEAST_PICTURES:
        return None
    turn = np.linspace(0.0, TURN, 360, endpoint=False)[:, None]
    radii = np.arange(_LEAST * radius / 2.0, 0.95 * radius, 1.0)
    around = [
        cv2.remap(
            grey,
            (u + radii * np.cos(turn)).astype(np.float32),
            (v + radii * np.sin(turn)).astype(np.float32),
            cv2.INTER_LINEAR,
        )
        for grey, (u, v) in zip(pictures, centers, strict=True)
    ]
    stack = np.array(around, dtype=np.float32)
    world = radii >= _MOST * radius
    # A brighter picture is another exposure, or a brighter world: what is steady under either of them does not change.
    bright = np.maximum(stack[:, :, world].mean(axis=(1, 2)), 1.0)
    spread = np.minimum(stack.std(axis=0), (stack * (bright.mean() / bright)[:, None, None]).std(axis=0))
    changes = spread > max(_CHANGE_STEPS, _CHANGE * float(np.median(spread[:, world])))
    share = changes.mean(axis=0)
    return (radii, share) if float(np.median(share[world])) >= _MOVED_SHARE else None


def _sets_in(radii: Float, share: Float) -> float | None:
    """The radius from which on most places change, at every radius; None when they do from the middle on."""
    still = np.flatnonzero(share < _MOVED_SHARE)
    last = int(still[-1]) if still.size else 0
    return float(radii[last + 1]) if 0 < last < radii.size // 2 else None
