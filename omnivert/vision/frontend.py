"""The one step Frame -> Bearings, and its stages one by one for whoever times them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from omnivert.angles import wrap
from omnivert.config import Config, MirrorRing
from omnivert.messages import Bearings, Frame, Looks, MeetingPoint, Ring
from omnivert.vision.descriptor import Float32
from omnivert.vision.doubt import doubted
from omnivert.vision.edges import PLAIN, Array, Band, EdgeFinder, Edges, everywhere, tone_of_light
from omnivert.vision.faults import FaultFinder
from omnivert.vision.image import WORK_RADIUS_PX, Grey, grey_from_frame, shrunk
from omnivert.vision.lines import Lines, lines_from_edges, no_lines
from omnivert.vision.meeting import MeetingFinder
from omnivert.vision.panorama import line_rows
from omnivert.vision.ring import RingFinder, RingFound
from omnivert.vision.tracker import Tracked, Tracker

_OTHER_SIZE = 0.02  # by so much a rim may differ from the configured one


@dataclass(slots=True)
class Work:
    """One frame on its way through the stages; each fills in what the next ones need."""

    frame: Frame
    reasons: list[str] = field(default_factory=list)
    grey: Grey | None = None
    tone: Array = field(default_factory=lambda: PLAIN)
    edges: Edges | None = None
    sifted: bool = False  # of all edges only those of use
    found: RingFound | None = None
    lines: Lines = field(default_factory=no_lines)
    descriptor: Float32 | None = None
    tracked: Tracked | None = None


@dataclass(frozen=True, slots=True)
class Stage:
    name: str
    run: Callable[[Work], None]


class FrontEnd:
    """A frame in, its tracked lines out; a bad frame gives bearings without lines and the reasons why."""

    def __init__(self, config: Config) -> None:
        self._camera, self._vision = config.camera, config.vision
        self._paper = config.vision.mode == "paper"
        # Paper: works on the picture as it is. Here: on one whose rim has a radius of 288 pixels at most, because
        # a lens spreads its edges over more pixels of a finer sensor, and time would grow with them.
        self._scale = 1.0 if self._paper else min(WORK_RADIUS_PX / config.ring.r_max_px, 1.0)
        self._size = round(self._camera.width_px * self._scale), round(self._camera.height_px * self._scale)
        self._edges = EdgeFinder(config.vision.edge_min_magnitude)
        self._finder = RingFinder(_scaled(config.ring, self._scale), config.vision)
        self._take_ring(_scaled(config.ring, self._scale))
        self._tracker = Tracker(config.vision)
        self.stages = (
            Stage("decode", self._decode),
            Stage("edges", self._find_edges),
            Stage("ring", self._find_ring),
            Stage("lines", self._find_lines),
            Stage("faults", self._find_faults),
            Stage("descriptors", self._describe),
            Stage("tracking", self._track),
        )
        """In order; `step` is `Work`, all of them, `bearings`."""

    def _take_ring(self, ring: MirrorRing) -> None:
        self._ring = ring
        self._meeting = MeetingFinder(ring)
        self._faults = FaultFinder(ring)

    def step(self, frame: Frame) -> Bearings:
        work = Work(frame)
        for stage in self.stages:
            stage.run(work)
        return self.bearings(work)

    def bearings(self, work: Work) -> Bearings:
        """The message of a frame that has been through all stages."""
        lines, tracked = work.lines, work.tracked
        assert tracked is not None, "not been through all stages"
        i = tracked.line
        return Bearings(
            stamp_ns=work.frame.stamp_ns,
            track_id=tracked.track_id,
            bearing_rad=wrap(self._camera.bearing_sign * lines.angle_rad[i]),
            std_rad=np.clip(lines.std_rad[i], 1e-6, np.pi),
            age_frames=tracked.age_frames.astype(np.int32),
            strength=lines.strength[i].astype(np.float32),
            ring=self._told_ring(work.found),
            reasons=tuple(work.reasons),
            meeting=self._told_meeting(work.found),
            looks=Looks(
                polarity=lines.polarity[i].astype(np.int32),
                inner_px=(lines.inner_px[i] / self._scale).astype(np.float32),
                outer_px=(lines.outer_px[i] / self._scale).astype(np.float32),
                quality=tracked.quality.astype(np.float32),
                moving=tracked.moving.astype(np.uint8),
            ),
        )

    def _told_ring(self, found: RingFound | None) -> Ring | None:
        if found is None:
            return None
        circle, scale = found.circle, self._scale
        u, v = self._place(circle.u_px, circle.v_px)
        return Ring(u, v, circle.radius_px / scale, circle.quality, circle.std_px / scale)

    def _told_meeting(self, found: RingFound | None) -> MeetingPoint | None:
        known = self._meeting.known
        if found is None or known is None or self._paper:
            return None
        u, v = self._place(found.circle.u_px + known.u_px, found.circle.v_px + known.v_px)
        return MeetingPoint(u, v, known.std_px / self._scale, known.used)

    def _place(self, u: float, v: float) -> tuple[float, float]:
        """A place in the worked-on picture as one in the frame; pixel centres are at integers in both."""
        width, height = self._size
        return (u + 0.5) * self._camera.width_px / width - 0.5, (v + 0.5) * self._camera.height_px / height - 0.5

    def _decode(self, work: Work) -> None:
        camera, frame = self._camera, work.frame
        if (frame.width_px, frame.height_px) != (camera.width_px, camera.height_px):
            work.reasons.append(
                f"frame is {frame.width_px}x{frame.height_px}, configured {camera.width_px}x{camera.height_px}"
            )
            return
        try:
            grey = grey_from_frame(frame)
        except ValueError as error:
            work.reasons.append(str(error))
            return
        work.grey = shrunk(grey, self._scale)

    def _find_edges(self, work: Work) -> None:
        if work.grey is not None:
            meeting = self._meeting.point if self._meeting.begun else None
            band = self._finder.band(meeting, self._vision.edge_tolerance_deg)
            work.tone = PLAIN if self._paper else tone_of_light(work.grey, band)
            work.edges = self._edges.step(work.grey, band, work.tone)
            work.sifted = band.leaning < 1.0

    def _find_ring(self, work: Work) -> None:
        grey, edges = work.grey, work.edges
        if grey is None or edges is None:
            return

        def edges_of(band: Band | None) -> Edges:
            work.edges = self._edges.step(grey, everywhere(grey) if band is None else band, work.tone)
            work.sifted = False
            return work.edges

        work.found = self._finder.step(edges, edges_of)
        if work.found is None:
            work.reasons.append("ring not in the picture")
            return
        if work.found.reason:
            work.reasons.append(work.found.reason)
        times = work.found.circle.radius_px / self._ring.r_max_px
        if abs(times - 1.0) > _OTHER_SIZE and not self._paper:  # all of the mirror is of another size than configured
            self._take_ring(_resized(self._ring, times))

    def _find_lines(self, work: Work) -> None:
        grey, edges = work.grey, work.edges
        if grey is None or edges is None or work.found is None:
            return
        circle, vision = work.found.circle, self._vision
        center = (circle.u_px, circle.v_px)
        if not self._paper:
            self._meeting.search(edges, center, vision.edge_tolerance_deg)

        def about(meeting: tuple[float, float]) -> Lines:
            return lines_from_edges(edges, center, circle.std_px, self._ring, vision, meeting)

        if self._paper:
            work.lines = about((0.0, 0.0))
        else:
            work.lines = doubted(self._meeting.lines(about), grey, center, self._ring)
        if work.lines.angle_rad.size == 0:
            work.reasons.append("no lines")

    def _find_faults(self, work: Work) -> None:
        if work.grey is not None and work.edges is not None:
            work.reasons.extend(self._faults.step(work.grey, work.found, work.edges, work.lines, sifted=work.sifted))

    def _describe(self, work: Work) -> None:
        work.descriptor = np.empty((0, self._vision.areas * 2 * self._vision.bins), dtype=np.float32)
        if work.grey is not None and work.found is not None:
            center, lines = work.found.circle[:2], work.lines
            work.descriptor = line_rows(work.grey, center, lines.angle_rad, self._ring, self._vision, lines.slant_px)

    def _track(self, work: Work) -> None:
        assert work.descriptor is not None
        work.tracked = self._tracker.step(work.lines, work.descriptor)


def _scaled(ring: MirrorRing, scale: float) -> MirrorRing:
    """The ring as it is in a picture shrunk by so much."""
    u, v = ((place + 0.5) * scale - 0.5 for place in ring.center_px)
    return _resized(ring, scale).model_copy(update={"center_px": (u, v)}) if scale != 1.0 else ring


def _resized(ring: MirrorRing, times: float) -> MirrorRing:
    """The ring with its radii so many times as large; not held to what a configuration may be."""
    names = ("r_min_px", "r_max_px", "horizon_px")
    return ring.model_copy(update={name: times * getattr(ring, name) for name in names})
