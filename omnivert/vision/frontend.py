"""The one step Frame -> Bearings, and its stages one by one for whoever times them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, Ring
from omnivert.vision.descriptor import Float32, descriptors
from omnivert.vision.edges import Box, Edges, box_around, thinned_edges
from omnivert.vision.image import Grey, grey_from_frame
from omnivert.vision.lines import Lines, lines_from_edges, no_lines
from omnivert.vision.ring import RingFinder, RingFound
from omnivert.vision.tracker import Tracked, Tracker


@dataclass(slots=True)
class Work:
    """One frame on its way through the stages; each fills in what the next ones need."""

    frame: Frame
    reasons: list[str] = field(default_factory=list)
    grey: Grey | None = None
    edges: Edges | None = None
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
        self._camera, self._ring, self._vision = config.camera, config.ring, config.vision
        self._finder = RingFinder(config.ring, config.vision)
        self._tracker = Tracker(config.vision)
        self.stages = (
            Stage("decode", self._decode),
            Stage("edges", self._find_edges),
            Stage("ring", self._find_ring),
            Stage("lines", self._find_lines),
            Stage("descriptors", self._describe),
            Stage("tracking", self._track),
        )
        """In order; `step` is `Work`, all of them, `bearings`."""

    def step(self, frame: Frame) -> Bearings:
        work = Work(frame)
        for stage in self.stages:
            stage.run(work)
        return self.bearings(work)

    def bearings(self, work: Work) -> Bearings:
        """The message of a frame that has been through all stages."""
        lines, tracked, found = work.lines, work.tracked, work.found
        assert tracked is not None, "not been through all stages"
        i = tracked.line
        return Bearings(
            stamp_ns=work.frame.stamp_ns,
            track_id=tracked.track_id,
            bearing_rad=wrap(self._camera.bearing_sign * lines.angle_rad[i]),
            std_rad=np.clip(lines.std_rad[i], 1e-6, np.pi),
            age_frames=tracked.age_frames.astype(np.int32),
            strength=lines.strength[i].astype(np.float32),
            ring=None if found is None else Ring(*found.circle[:4]),
            reasons=tuple(work.reasons),
        )

    def _decode(self, work: Work) -> None:
        camera, frame = self._camera, work.frame
        if (frame.width_px, frame.height_px) != (camera.width_px, camera.height_px):
            work.reasons.append(
                f"frame is {frame.width_px}x{frame.height_px}, configured {camera.width_px}x{camera.height_px}"
            )
            return
        try:
            work.grey = grey_from_frame(frame)
        except ValueError as error:
            work.reasons.append(str(error))

    def _find_edges(self, work: Work) -> None:
        if work.grey is None:
            return
        height, width = work.grey.shape
        reach = self._ring.r_max_px + 1.5 * self._vision.ring_search_px
        box = box_around(*self._finder.expected, reach, width, height)
        work.edges = thinned_edges(work.grey, box, self._vision.edge_min_magnitude)

    def _find_ring(self, work: Work) -> None:
        grey, edges = work.grey, work.edges
        if grey is None or edges is None:
            return

        def everywhere() -> Edges:
            work.edges = thinned_edges(grey, Box(0, 0, grey.shape[1], grey.shape[0]), self._vision.edge_min_magnitude)
            return work.edges

        work.found = self._finder.step(edges, everywhere)
        if work.found is None:
            work.reasons.append("ring not in the picture")
        elif work.found.reason:
            work.reasons.append(work.found.reason)

    def _find_lines(self, work: Work) -> None:
        if work.edges is None or work.found is None:
            return
        circle = work.found.circle
        center = (circle.u_px, circle.v_px)
        work.lines = lines_from_edges(work.edges, center, circle.std_px, self._ring, self._vision)
        if work.lines.angle_rad.size == 0:
            work.reasons.append("no lines")

    def _describe(self, work: Work) -> None:
        work.descriptor = np.empty((0, self._vision.areas * 2 * self._vision.bins), dtype=np.float32)
        if work.grey is not None and work.found is not None:
            center = work.found.circle[:2]
            work.descriptor = descriptors(work.grey, center, work.lines.angle_rad, self._ring, self._vision)

    def _track(self, work: Work) -> None:
        assert work.descriptor is not None
        work.tracked = self._tracker.step(work.lines, work.descriptor)
