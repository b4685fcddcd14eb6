"""Ring and tracked lines drawn into the frame that they were found in."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.config import MirrorRing
from omnivert.messages import Bearings, Looks, Ring
from omnivert.pictures.labels import Bgr, Labels, Place
from omnivert.pictures.palette import Colour, track_color

Vector = NDArray[np.float64]

LEAST_SIDE_PX = 720  # a smaller picture is enlarged by a whole number, so that its numbers can be read
MOST_ENLARGED = 4
_DESIGNED_FOR_PX = 960.0  # shorter side that the sizes below are meant for
_MEETING = "meeting point"
_LETTERS, _BAND = 14.0, 28.0
_YOUNG, _OLD = 5, 20  # frames from which a line is drawn thicker, and thickest
_INK, _FAINT, _DARK, _ALARM = (240, 240, 240), (150, 150, 150), (24, 20, 18), (120, 200, 255)
_SHIFT = 4  # OpenCV takes coordinates in sixteenths of a pixel


@dataclass(frozen=True, slots=True)
class _Ray:
    """One line as it is drawn."""

    label: str
    color: Colour
    thickness: int
    start: Vector  # (2,) nearest to the centre
    end: Vector
    out: Vector  # (2,) unit, away from the centre
    rim: Vector  # where its ray meets the ring
    bright: int  # side that is brighter: +1 counter-clockwise of it, 0 not known
    moving: bool


@dataclass(frozen=True, slots=True)
class _Scale:
    """How the frame lies in its drawing."""

    k: int  # times larger
    unit: float  # px of the drawing that strokes and letters are measured in
    band: int  # px above the picture

    @classmethod
    def of(cls, height_px: int, width_px: int, has_band: bool) -> "_Scale":
        k = magnification(height_px, width_px)
        unit = max(k * min(height_px, width_px) / _DESIGNED_FOR_PX, 0.75)
        return cls(k, unit, round(_BAND * unit) if has_band else 0)

    def moved(self, u_px: float, v_px: float) -> Vector:
        """(2,) a place of the frame in the drawing; pixel centres at integer coordinates in both."""
        return np.array([self.k * (u_px + 0.5) - 0.5, self.k * (v_px + 0.5) - 0.5 + self.band])


def magnification(height_px: int, width_px: int) -> int:
    """How many times larger than the frame its picture is drawn."""
    return min(math.ceil(LEAST_SIDE_PX / min(height_px, width_px)), MOST_ENLARGED)


def overlay(
    picture: NDArray[np.uint8],
    bearings: Bearings,
    bearing_sign: int,
    r_min_px: float,
    index: int | None = None,
    expected: MirrorRing | None = None,
) -> Bgr:
    """The picture in colour, with the ring and each line in its track's colour, its number at the rim.

    picture       (H, W) or (H, W, 3) uint8
    bearing_sign  +1 or -1, as in the configuration
    r_min_px      where lines begin whose extent is not told
    index         of the frame: a band above the picture tells it, the time and what was found; None: no band
    expected      drawn dashed where no ring was found
    returns       (k H + band, k W, 3); pixel (u, v) lies at k (u + 1/2) - 1/2 from the left, k from `magnification`

    New lines are thin, old ones thick, moving ones dashed. A tick at the outer end points to the brighter side.
    Numbers stand where there is room, the oldest first; reasons in the lower left corner.
    """
    scale = _Scale.of(picture.shape[0], picture.shape[1], index is not None)
    drawn = _canvas(picture, scale)
    labels = Labels(drawn, _LETTERS * scale.unit, scale.band)
    if index is not None:
        labels.band(_header(bearings, index), _legend(bearings.looks), _INK, _FAINT)
    labels.paragraph(bearings.reasons, _ALARM)
    if bearings.ring is not None:
        _draw_found(drawn, labels, bearings, bearings.ring, bearing_sign, r_min_px, scale)
    elif expected is not None:
        _draw_expected(drawn, expected, scale)
    labels.write()
    return drawn


def _draw_expected(drawn: Bgr, ring: MirrorRing, scale: _Scale) -> None:
    center, radius = _point(scale.moved(*ring.center_px)), round(scale.k * ring.r_max_px * 2**_SHIFT)
    for color, thickness in ((_DARK, 3.0), (_ALARM, 1.0)):
        for start in range(0, 360, 10):
            width = _width(thickness * scale.unit)
            cv2.ellipse(drawn, center, (radius, radius), 0.0, start, start + 5, color, width, cv2.LINE_AA, _SHIFT)


def _draw_found(
    drawn: Bgr, labels: Labels, bearings: Bearings, ring: Ring, bearing_sign: int, r_min_px: float, scale: _Scale
) -> None:
    unit, center = scale.unit, scale.moved(ring.center_u_px, ring.center_v_px)
    meeting = bearings.meeting if bearings.meeting is not None and bearings.meeting.used else None
    origin = center if meeting is None else scale.moved(meeting.u_px, meeting.v_px)
    reach = scale.k * r_min_px, scale.k * ring.radius_px
    for radius in reach:
        for color, thickness in ((_DARK, 3.0), (_FAINT, 1.0)):
            at, r = _point(center), round(radius * 2**_SHIFT)
            cv2.circle(drawn, at, r, color, _width(thickness * unit), cv2.LINE_AA, _SHIFT)
    rays = _rays(bearings, bearing_sign, scale, reach, center, origin)
    for ray in reversed(rays):  # the oldest on top
        _draw_line(drawn, ray, unit)
    _draw_centers(drawn, labels, center, None if meeting is None else origin, unit)
    _draw_numbers(drawn, labels, rays, scale)


def _canvas(picture: NDArray[np.uint8], scale: _Scale) -> Bgr:
    k, band = scale.k, scale.band
    colour = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if picture.ndim == 2 else picture
    height, width = colour.shape[:2]
    drawn = np.full((band + k * height, k * width, 3), _DARK, dtype=np.uint8)
    drawn[band:] = cv2.resize(colour, (k * width, k * height), interpolation=cv2.INTER_LINEAR) if k > 1 else colour
    return drawn


def _header(bearings: Bearings, index: int) -> str:
    lines, looks, ring = len(bearings.track_id), bearings.looks, bearings.ring
    parts = [f"frame {index}", f"{1e-9 * bearings.stamp_ns:.3f} s", f"{lines} line{'' if lines == 1 else 's'}"]
    if looks is not None and looks.moving.any():
        parts.append(f"{int(looks.moving.sum())} moving")
    parts.append("no ring" if ring is None else f"{100 * ring.quality:.0f} % of the ring seen")
    return "   ·   ".join(parts)


def _legend(looks: Looks | None) -> str:
    return "thick: long tracked" + ("   tick: brighter side   dashed: moving" if looks is not None else "")


def _rays(
    bearings: Bearings,
    bearing_sign: int,
    scale: _Scale,
    reach: tuple[float, float],
    center: Vector,
    origin: Vector,
) -> list[_Ray]:
    """The lines, oldest first.

    reach           px of the drawing, from the ring's centre: where lines begin and end whose extent is not told
    center, origin  (2,) of the ring, and of the bearings
    """
    rays, looks = [], bearings.looks
    for i in np.argsort(-bearings.age_frames, kind="stable"):
        angle, track, age = (
            bearing_sign * float(bearings.bearing_rad[i]),
            int(bearings.track_id[i]),
            bearings.age_frames[i],
        )
        out = np.array([math.cos(angle), -math.sin(angle)])
        rim = _crossing(origin, out, center, reach[1])
        if looks is None:
            start, end = _crossing(origin, out, center, reach[0]), rim
        else:
            start, end = (origin + scale.k * float(r[i]) * out for r in (looks.inner_px, looks.outer_px))
        moving = looks is not None and bool(looks.moving[i])
        rays.append(
            _Ray(
                label=f"{track} moving" if moving else str(track),
                color=track_color(track),
                thickness=_width((1.0 if age < _YOUNG else 2.0 if age < _OLD else 3.0) * scale.unit),
                start=start,
                end=end,
                out=out,
                rim=rim,
                bright=0 if looks is None else int(looks.polarity[i]),
                moving=moving,
            )
        )
    return rays


def _draw_line(drawn: Bgr, ray: _Ray, unit: float) -> None:
    """Dark borders first, so that the line stands out from a bright picture too."""
    length = float(np.hypot(*(ray.end - ray.start)))
    dash, gap = (max(9.0 * unit, 1e-3 * length), 8.0 * unit) if ray.moving else (max(length, 1.0), 1.0)
    begins = np.arange(0.0, max(length, 1.0), dash + gap)
    strokes = [(ray.start + ray.out * at, ray.start + ray.out * min(at + dash, length)) for at in begins]
    if ray.bright:
        across = np.array([ray.out[1], -ray.out[0]])  # where the image angle grows
        strokes.append((ray.end, ray.end + across * ray.bright * (6.0 * unit + ray.thickness)))
    for color, thickness in ((_DARK, ray.thickness + 2 * _width(unit)), (ray.color, ray.thickness)):
        for start, end in strokes:
            cv2.line(drawn, _point(start), _point(end), color, thickness, cv2.LINE_AA, _SHIFT)


def _draw_centers(drawn: Bgr, labels: Labels, center: Vector, meeting: Vector | None, unit: float) -> None:
    """A cross on the ring's centre; a diamond, with its name, where the lines meet when they do not meet there."""
    arm = 9.0 * unit
    cross = [np.array(side) * arm for side in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    for color, thickness in ((_DARK, _width(3 * unit)), (_INK, _width(unit))):
        for a, b in ((0, 1), (2, 3)):
            cv2.line(drawn, _point(center + cross[a]), _point(center + cross[b]), color, thickness, cv2.LINE_AA, _SHIFT)
    if meeting is None:
        return
    corners = [_point(meeting + 0.8 * cross[side]) for side in (0, 2, 1, 3)]
    for color, thickness in ((_DARK, _width(4 * unit)), (_ALARM, _width(2 * unit))):
        cv2.polylines(drawn, [np.array(corners, dtype=np.int32)], True, color, thickness, cv2.LINE_AA, _SHIFT)
    below = arm + labels.extent(_MEETING)[1]
    labels.place(_MEETING, _ALARM, [(float(meeting[0]), float(meeting[1]) + side * below) for side in (1.0, -1.0)])


def _draw_numbers(drawn: Bgr, labels: Labels, rays: list[_Ray], scale: _Scale) -> None:
    """Outside the ring where there is room, else inside on the line; a thin stroke leads from the rim."""
    low, high = np.array([0, scale.band]), np.array([drawn.shape[1], drawn.shape[0]])
    for ray in rays:
        beyond = float((np.maximum(ray.rim - high, low - ray.rim) / np.maximum(np.abs(ray.out), 1e-3)).max())
        box = labels.place(ray.label, ray.color, _places(labels.extent(ray.label), ray, max(beyond, 0.0), scale.unit))
        if box is not None:
            nearest = np.clip(ray.rim, box[:2], box[2:])
            cv2.line(drawn, _point(ray.rim), _point(nearest), ray.color, _width(scale.unit), cv2.LINE_AA, _SHIFT)


def _places(extent: tuple[int, int], ray: _Ray, beyond: float, unit: float) -> list[Place]:
    """Middles for a text of this extent, best first.

    beyond  px of the line's way to the rim that lie outside the picture
    """
    across = np.array([ray.out[1], -ray.out[0]])
    half = 0.5 * float(np.abs(ray.out) @ extent)
    aside = 0.5 * float(np.abs(across) @ extent)
    row = 2.0 * half + 2.0 * unit
    near = 6.0 * unit + half
    outside = [(near + n * row, side * aside) for n in range(3) for side in (0.0, 0.5, -0.5, 1.0, -1.0)]
    inside = [(-beyond - near - n * 0.5 * row, 0.0) for n in range(8)]
    spots = [ray.rim + along * ray.out + shift * across for along, shift in (*outside, *inside)]
    return [(float(x), float(y)) for x, y in spots]


def _crossing(origin: Vector, out: Vector, center: Vector, radius: float) -> Vector:
    """(2,) where the ray from the origin leaves the circle; the point of it nearest to the circle if it never does."""
    to_center = center - origin
    along = float(to_center @ out)
    inside = radius**2 - float(to_center @ to_center) + along**2
    return np.asarray(origin + (along + math.sqrt(max(inside, 0.0))) * out)


def _width(wanted: float) -> int:
    return max(round(wanted), 1)


def _point(place: Vector) -> tuple[int, int]:
    return round(float(place[0]) * 2**_SHIFT), round(float(place[1]) * 2**_SHIFT)
