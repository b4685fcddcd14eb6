"""The omnidirectional camera, and the mirror in its picture."""

from typing import Annotated, Self

from pydantic import Field, Strict, model_validator

from omnivert.config.section import Id, Section, Sign


class Camera(Section):
    """The omnidirectional camera."""

    id: Id = "front"
    """Names the camera in keys and in the store."""
    source: str = "0"
    """Number of a camera, a device, a video file, a stream's URL (rtsp://, http://), or a folder of images."""
    width_px: int = Field(640, ge=32, le=16384)
    """Width of its pictures; asked of a camera, and told where they have another."""
    height_px: int = Field(480, ge=32, le=16384)
    """Height of its pictures."""
    frame_rate_hz: float = Field(15.0, gt=0.0, le=1000.0)
    """Rate to ask of a camera, and to play a folder of images at."""
    colour: bool = False
    """Publish and record the colours of a camera or video; vision works on grey, a third of the bytes."""
    bearing_sign: Sign = 1
    """+1: the image angle atan2(-(v - cv), u - cu) grows with the bearing; -1: it falls (mirror image)."""
    stamp_delay_s: float = Field(0.0, ge=0.0, le=1.0)
    """From the middle of the exposure to the stamp that the source gives; taken off every stamp."""
    reopen_s: float = Field(0.5, ge=0.01, le=60.0)
    """Pause between two attempts to open the source."""
    silent_after_s: float = Field(3.0, gt=0.0, le=3600.0)
    """Without a frame for so long, health says that the camera is silent."""


class MirrorRing(Section):
    """The mirror in the picture: its outer rim, and the ring between Rmin and Rmax that shows the world."""

    center_px: Annotated[tuple[float, float], Strict(False)] = (321.5, 239.0)
    """(u, v) where the centre is expected; each frame finds its own near it."""
    r_min_px: float = Field(63.0, gt=4.0, le=1e4)
    """Radius inside which the picture shows the robot itself; lines are sought outside it."""
    r_max_px: float = Field(225.0, gt=8.0, le=1e4)
    """Radius of the rim, known from one still image (II, step 1)."""
    horizon_px: float = Field(0.0, ge=0.0, le=1e4)
    """Radius at which level rays appear, where a tilted camera's bearings are read; 0: the middle of the ring."""

    @property
    def horizon(self) -> float:
        """Radius at which bearings are read off, px."""
        return self.horizon_px or 0.5 * (self.r_min_px + self.r_max_px)

    @model_validator(mode="after")
    def _ring_is_open(self) -> Self:
        if self.r_max_px < self.r_min_px + 16.0:
            raise ValueError("r_max_px must exceed r_min_px by at least 16 pixels")
        if self.horizon_px and not self.r_min_px < self.horizon_px < self.r_max_px:
            raise ValueError("horizon_px must lie between r_min_px and r_max_px, or be 0")
        return self
