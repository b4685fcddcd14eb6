"""How the time of the vision grows with the picture and with the lines in it."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from omnivert.bench.contender import WARM_UP
from omnivert.bench.vision import decoded, raw, timed_step
from omnivert.bench.yardstick import sobel_pair_s
from omnivert.config import Config, parsed
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd
from omnivert.vision.image import Grey
from omnivert.wire.recording import Recording

SIZES = ((320, 240), (480, 360), (640, 480), (1024, 768), (1280, 960), (1600, 1200), (2048, 1536), (2592, 1944))
LINES = (5, 10, 20, 40, 80, 120, 160, 200)
DRAWN = 50  # lines in a picture of any size
FRAMES = 12  # for each point, after the first few


@dataclass(frozen=True, slots=True)
class Point:
    """One picture size and one number of lines."""

    width_px: int
    height_px: int
    ring_pixels: int  # between the two radii, in the picture or not
    drawn: int | None  # radial edges in a drawn picture; None: a frame of the recording, scaled
    lines: float  # found, mean
    vision_ms: float  # whole step, the least of some: what else the machine does can only add to it
    sobel_pair_ms: float


@dataclass(frozen=True, slots=True)
class Growth:
    """Three series of points.

    sizes   drawn pictures of growing size, ring and all, with the same lines in them
    frames  the recording's frames scaled to the same sizes; enlarged ones are blurred and lose lines
    lines   drawn pictures of the recording's size with more and more lines
    """

    sizes: tuple[Point, ...]
    frames: tuple[Point, ...]
    lines: tuple[Point, ...]

    @property
    def exponent(self) -> float:
        """Slope of log time over log ring pixels, from `sizes`: 1 is in proportion."""
        pixels, took = np.log([(p.ring_pixels, p.vision_ms) for p in self.sizes]).T
        return float(np.polyfit(pixels, took, 1)[0])

    @property
    def us_per_line(self) -> float:
        """Slope of time over lines found, from `lines`."""
        lines, took = np.array([(p.lines, p.vision_ms) for p in self.lines]).T
        return 1e3 * float(np.polyfit(lines, took, 1)[0])

    def json(self) -> dict[str, Any]:
        series = {name: [asdict(p) for p in getattr(self, name)] for name in ("sizes", "frames", "lines")}
        return {**series, "exponent_in_ring_pixels": self.exponent, "us_per_line": self.us_per_line}


POINTS = 2 * len(SIZES) + len(LINES)


def growth(recording: Recording, config: Config, moved: Callable[[], None] = lambda: None) -> Growth:
    """All three series.

    moved  called after each of POINTS points
    """
    frames = [f for f in decoded(recording, FRAMES + WARM_UP) if f.format is PixelFormat.GREY8]
    pictures = [f.data.reshape(f.height_px, f.width_px) for f in frames]
    scaled = [scaled_config(config, height / config.camera.height_px) for _, height in SIZES]

    def told(points: Iterator[Point]) -> tuple[Point, ...]:
        found = []
        for point in points:
            moved()
            found.append(point)
        return tuple(found)

    return Growth(
        sizes=told(_drawn(there, DRAWN) for there in scaled),
        frames=told(_scaled(pictures, there) for there in scaled),
        lines=told(_drawn(config, count) for count in LINES),
    )


def scaled_config(config: Config, scale: float) -> Config:
    """The configuration for frames of the same scene, scaled: sizes, ring, and how far it is looked for."""
    body = config.model_dump(exclude_unset=True)
    camera, ring, vision = config.camera, config.ring, config.vision
    size = {"width_px": round(camera.width_px * scale), "height_px": round(camera.height_px * scale)}
    # Pixel centres lie at whole coordinates, so the picture's corner is at -0.5.
    center = tuple((c + 0.5) * scale - 0.5 for c in ring.center_px)
    radii = {"r_min_px": ring.r_min_px * scale, "r_max_px": ring.r_max_px * scale}
    body["camera"] = {**body.get("camera", {}), **size}
    body["ring"] = {**body.get("ring", {}), "center_px": center, **radii}
    body["vision"] = {**body.get("vision", {}), "ring_search_px": vision.ring_search_px * scale}
    return parsed(body, "a scaled picture")


def picture_with_lines(config: Config, count: int, seed: int = 0) -> Grey:
    """A ring of wedges between `count` radial edges, each a grey step of 40 to 120, (height, width)."""
    camera, ring = config.camera, config.ring
    rng = np.random.default_rng(seed)
    spread = 2.0 * np.pi / count
    angle = spread * (np.arange(count) + rng.uniform(-0.25, 0.25, count))
    level = 128.0 + np.where(np.arange(count) % 2, 1.0, -1.0) * rng.uniform(20.0, 60.0, count)
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    x, y = u - ring.center_px[0], ring.center_px[1] - v
    radius, theta = np.hypot(x, y), np.mod(np.arctan2(y, x), 2.0 * np.pi)
    wedge = np.searchsorted(angle, theta) % count
    picture = np.where((radius <= ring.r_max_px) & (radius >= ring.r_min_px), level[wedge], 0.0)
    noisy = cv2.GaussianBlur(picture, (0, 0), 0.7) + rng.normal(0.0, 1.0, picture.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)


def _scaled(pictures: Sequence[Grey], config: Config) -> Point:
    size = (config.camera.width_px, config.camera.height_px)
    way = cv2.INTER_AREA if pictures and size[0] < pictures[0].shape[1] else cv2.INTER_CUBIC
    frames = [raw(np.asarray(cv2.resize(picture, size, interpolation=way)), k) for k, picture in enumerate(pictures)]
    return _timed(frames, config, None)


def _drawn(config: Config, count: int) -> Point:
    frame = raw(picture_with_lines(config, count), 0)
    return _timed([frame] * (FRAMES + WARM_UP), config, count)


def _timed(frames: Sequence[Frame], config: Config, drawn: int | None) -> Point:
    front_end, stages = FrontEnd(config), defaultdict[str, list[float]](list)
    took, sobel, lines = [], [], []
    for frame in frames:
        sobel.append(sobel_pair_s(frame.data.reshape(frame.height_px, frame.width_px)))
        bearings, seconds = timed_step(front_end, frame, stages)
        took.append(seconds)
        lines.append(bearings.track_id.size)
    ring = config.ring
    return Point(
        width_px=config.camera.width_px,
        height_px=config.camera.height_px,
        ring_pixels=round(np.pi * (ring.r_max_px**2 - ring.r_min_px**2)),
        drawn=drawn,
        lines=float(np.mean(lines)),
        vision_ms=1e3 * min(took[WARM_UP:] or took),
        sobel_pair_ms=1e3 * min(sobel[WARM_UP:] or sobel),
    )
