"""The lines of a frame as strokes over its picture."""

import math

from omnivert.formats.foxglove.file import Circle, Point, Rgb, Stroke
from omnivert.messages import Bearings

NEW, FOLLOWED, MOVING, FRAME = (1.0, 0.85, 0.2), (0.3, 0.9, 0.45), (1.0, 0.35, 0.3), (0.75, 0.75, 0.8)
_YOUNG = 5  # frames that a line is shown as new


def drawn(bearings: Bearings, bearing_sign: int, r_min_px: float) -> tuple[list[Circle], list[Stroke]]:
    """The ring, and each line from its inner to its outer end; nothing where no ring was found.

    bearing_sign  +1 or -1, as in the configuration
    r_min_px      where the ring begins, and lines whose extent is not told
    """
    ring, looks = bearings.ring, bearings.looks
    if ring is None:
        return [], []
    center = _corner(ring.center_u_px, ring.center_v_px)
    circles = [Circle(center, radius, FRAME) for radius in (r_min_px, ring.radius_px)]
    meeting = bearings.meeting if bearings.meeting is not None and bearings.meeting.used else None
    origin = center if meeting is None else _corner(meeting.u_px, meeting.v_px)
    strokes = []
    for i, track in enumerate(bearings.track_id.tolist()):
        angle = bearing_sign * float(bearings.bearing_rad[i])
        inner, outer = (r_min_px, ring.radius_px)
        if looks is not None:
            inner, outer = float(looks.inner_px[i]), float(looks.outer_px[i])
        moving = looks is not None and bool(looks.moving[i])
        young = int(bearings.age_frames[i]) < _YOUNG
        colour: Rgb = MOVING if moving else NEW if young else FOLLOWED
        start, end = (_along(origin, angle, radius) for radius in (inner, outer))
        strokes.append(Stroke(start, end, colour, 1.0 if young else 2.0, str(track)))
    return circles, strokes


def _along(origin: Point, angle: float, radius: float) -> Point:
    """In the picture v grows downward, and angles grow counter-clockwise on the screen."""
    return origin[0] + radius * math.cos(angle), origin[1] - radius * math.sin(angle)


def _corner(u: float, v: float) -> Point:
    """From integer coordinates at a pixel's middle to those at its outer corner."""
    return u + 0.5, v + 0.5
