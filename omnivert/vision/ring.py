"""Edge points of frame after frame -> the ring to use, and what is learnt of the rim's shape (II, step 1)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnivert.config import MirrorRing, Vision
from omnivert.vision.edges import Band, Edges
from omnivert.vision.rim import (
    RIM_BAND,
    Circle,
    Shape,
    circle_anywhere,
    circle_here,
    circle_near,
    configured_shape,
    on_rim_px,
    rim_zone,
)

_SHAKE_PX = 1.0  # how far a lost rim may have moved, each frame
_STEP_PX = 6.0  # how far from the last centre a rim is looked for that was just seen
_STILL = 0.8  # a rim of this share of the last quality is taken to be the last one, without looking around
_LEARNT_FRAMES = 50  # the rim's shape is averaged over this many frames
_OTHER_SIZES = (*(1.0 + sign * 0.03 * k for k in range(1, 8) for sign in (1.0, -1.0)), 1.0)
_FINE_SIZES = tuple(1.0 + 0.005 * k for k in range(-3, 4))
_SURE_QUALITY = 0.8  # the whole rim, nearly: it is of the configured size
_OTHER_QUALITY = 0.5  # share of a rim that is not of the configured size that must be seen
_SHAPE_FLOOR_PX = 0.05  # and never believed to be known better


@dataclass(frozen=True, slots=True)
class RingFound:
    """The rim to use for one frame."""

    circle: Circle
    reason: str = ""  # not empty: this is the last good one, held because this frame shows none


class RingFinder:
    """Where it was first, then around, then all over the picture; held when it is nowhere.

    The rim's shape belongs to the camera and is learnt over the frames, so that a part of the rim is enough.
    """

    def __init__(self, ring: MirrorRing, vision: Vision) -> None:
        self._ring = ring
        self._vision = vision
        self._forget()
        self._lost_frames = 0

    def _forget(self) -> None:
        self._shape = configured_shape(self._ring.r_max_px)
        self._learnt = 0
        self._good: Circle | None = None
        self._weak_frames, self._doubt_after = 0, self._vision.lookback_frames

    def band(self, meeting: tuple[float, float] | None, tolerance_deg: float) -> Band:
        """The part of the picture whose edges the next frame needs first.

        meeting        px  where lines meet, from the centre; None: that is not known yet
        tolerance_deg      edges that point there within this may be lines
        """
        band = self._band(self._search)
        if meeting is None or not self._just_seen:
            return band
        # The centre may move by a step until then, which turns everything about it.
        turned = np.deg2rad(tolerance_deg) + np.arcsin(min(_STEP_PX / max(self._r_min, 1e-9), 1.0))
        reach, rim_leaning = rim_zone(self._shape.radius_px, 1.5 * self._search)
        return band._replace(
            toward_u_px=band.u_px + meeting[0],
            toward_v_px=band.v_px + meeting[1],
            leaning=float(np.sin(min(turned, 0.5 * np.pi))) ** 2,
            rim_px=self._shape.radius_px - reach,
            rim_leaning=rim_leaning,
        )

    def step(self, edges: Edges, edges_of: Callable[[Band | None], Edges]) -> RingFound | None:
        """This frame's rim, or the last good one held with growing sigma, or None when there is none to hold.

        edges     of `band`
        edges_of  the edges of another part of the picture, None: all of it; asked for only when the rim is not where
                  it was expected
        """
        vision, shape = self._vision, self._shape
        refine = vision.mode != "paper"
        circle = None
        if refine and self._good is not None and self._just_seen:
            circle = circle_here(edges, (self._good.u_px, self._good.v_px), shape, _STEP_PX)
            if circle is not None and circle.quality < _STILL * self._good.quality:
                circle = None
        if not self._seen(circle):
            circle = circle_near(edges, self._expected, shape, self._search, refine=refine)
        if not self._seen(circle) and self._search < vision.ring_search_px:
            wide = edges_of(self._band(vision.ring_search_px))
            circle = circle_near(wide, self._expected, shape, vision.ring_search_px, refine=refine)
        everything: Edges | None = None
        if not self._seen(circle):
            everything = edges_of(None)
            circle = circle_anywhere(everything, shape, refine=refine)
        if refine and self._is_doubtful(circle):
            circle = self._of_other_size(circle, edges_of(None) if everything is None else everything)
        if circle is not None and self._seen(circle):
            self._good, self._lost_frames = circle, 0
            if refine:
                self._learn(circle)
            return RingFound(circle)
        self._lost_frames += 1
        if self._good is not None and self._lost_frames > vision.lookback_frames:
            self._forget()  # what was seen may never have been the mirror
        if self._good is None:
            return None
        std = float(np.hypot(self._good.std_px, _SHAKE_PX * np.sqrt(self._lost_frames)))
        quality = 0.0 if circle is None else min(circle.quality, vision.ring_min_quality)
        return RingFound(self._good._replace(quality=quality, std_px=std), "ring not in the picture; last one held")

    def _is_doubtful(self, circle: Circle | None) -> bool:
        """Whether a rim that is not nearly whole may be a part of another: asked at first, and when it stays so."""
        sure = circle is not None and circle.quality >= _SURE_QUALITY
        self._weak_frames = 0 if sure else self._weak_frames + 1
        if self._good is None:
            return not sure
        if self._weak_frames < self._doubt_after or not self._seen(circle):
            return False
        self._weak_frames, self._doubt_after = 0, 2 * self._doubt_after
        return True

    def _of_other_size(self, circle: Circle | None, edges: Edges) -> Circle | None:
        """A rim of another size, when it is clearer than `circle`.

        A circle of the wrong size can lie along half a rim, so that all sizes are tried then; of none, one a frame.
        """
        sizes = _OTHER_SIZES
        if not self._seen(circle):
            sizes = sizes[self._lost_frames % len(sizes) :][:1]
        for times in sizes:
            other = circle_anywhere(edges, configured_shape(times * self._ring.r_max_px))
            least = max(_OTHER_QUALITY, self._vision.ring_min_quality, 0.0 if circle is None else circle.quality + 0.1)
            if other is None or other.quality < least:
                continue
            # It was found by the part of it that the tried size fits; of nearly this size, all of it is.
            nearly = (
                circle_near(edges, other[:2], configured_shape(fine * other.radius_px), _STEP_PX)
                for fine in _FINE_SIZES
            )
            circle = max((c for c in (other, *nearly) if c is not None), key=lambda c: c.quality)
            self._shape = configured_shape(circle.radius_px)
        return circle

    @property
    def _r_min(self) -> float:
        """Of the ring that is there: when the rim is not of the configured size, all of the mirror is not."""
        return self._ring.r_min_px * self._shape.radius_px / self._ring.r_max_px

    @property
    def _expected(self) -> tuple[float, float]:
        return self._ring.center_px if self._good is None else (self._good.u_px, self._good.v_px)

    @property
    def _search(self) -> float:
        return min(_STEP_PX, self._vision.ring_search_px) if self._just_seen else self._vision.ring_search_px

    @property
    def _just_seen(self) -> bool:
        return self._good is not None and self._lost_frames == 0

    def _band(self, search: float) -> Band:
        radius = self._shape.radius_px
        inner, outer = self._r_min - search, radius + 1.5 * search + RIM_BAND * on_rim_px(radius)
        return Band(*self._expected, max(inner, 0.0), outer)

    def _seen(self, circle: Circle | None) -> bool:
        return circle is not None and circle.quality >= self._vision.ring_min_quality

    def _learn(self, circle: Circle) -> None:
        """Takes this frame's shape into the average; a rim seen in part counts by its part."""
        self._learnt = min(self._learnt + 1, _LEARNT_FRAMES)
        gain = circle.quality / self._learnt
        old = self._shape
        seen = np.array((circle.radius_px, circle.even_px, circle.odd_px))
        mean = np.array(old[:3]) + gain * (seen - np.array(old[:3]))
        slack = max(configured_shape(self._ring.r_max_px).std_px[0] / self._learnt, _SHAPE_FLOOR_PX)
        radius, even, odd = (float(value) for value in mean)
        self._shape = Shape(radius, even, odd, (slack, slack, slack))
