"""Every setting: its unit in its name, its range, its meaning and its source in the paper beside it."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    Strict,
    StringConstraints,
    model_validator,
)

from omnivert.config.calibration import Calibration
from omnivert.config.section import Section

Id = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,31}$")]  # one chunk of a key


def _end_point(text: str) -> str:
    if not re.fullmatch(r"[a-z][a-z0-9_-]*/[^?#]+(\?[^#]+)?(#.+)?", text):
        raise ValueError("an end point is PROTOCOL/ADDRESS, such as tcp/127.0.0.1:7447")
    return text


def _whole(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("a whole number is needed")
    return value


Dissimilarity = Literal["l1", "l2", "linf", "jeffrey", "chi-square", "bhattacharyya", "quadratic", "ssd", "zncc"]
EndPoint = Annotated[str, AfterValidator(_end_point)]
Sign = Annotated[Literal[1, -1], BeforeValidator(_whole)]  # to Python, and so to a Literal, true and 1.0 are 1


class Robot(Section):
    """The drive."""

    id: Id = "demo"
    """Names the robot in keys and in the store."""
    wheel_base_m: float = Field(0.40, ge=0.05, le=5.0)
    """Distance between the wheels' contact points, e (eq. 15)."""


class Encoder(Section):
    """The wheel encoders."""

    id: Id = "base"
    port: str = "/dev/ttyUSB0"
    """Any pyserial port or URL; a name in /dev/serial/by-id stays the same when the plug goes into another socket."""
    baud: int = Field(115200, ge=300, le=4_000_000)
    wheel_diameter_m: float = Field(0.15, ge=0.01, le=2.0)
    ticks_per_rev: int = Field(2000, ge=1, le=10_000_000)
    """Counts per turn of the wheel, gear included."""
    left_sign: Sign = 1
    """-1 where the raw count falls when the robot drives forward."""
    right_sign: Sign = 1
    counter_bits: int = Field(32, ge=8, le=63)
    """Width of the device's counters, for undoing their rollover."""
    max_speed_m_s: float = Field(5.0, gt=0.0, le=100.0)
    """A wheel that seems faster than this between two messages has jumped, not driven."""
    max_gap_s: float = Field(0.5, gt=0.0, le=60.0)
    """After a longer silence in which the wheels turned, the way between is unknown."""
    noise_k_m: float = Field(2e-4, gt=0.0, le=0.1)
    """K of eq. 31: variance of a wheel's displacement per metre driven (Chong and Kleeman)."""
    clock_window_s: float = Field(30.0, ge=1.0, le=3600.0)
    """The device's clock is fitted to this machine's over this time; longer averages more, shorter follows drift."""
    clock_max_skew: float = Field(0.01, ge=0.0, le=0.1)
    """Largest relative error of the device's clock; ceramic resonators reach 0.005."""
    restart_after_lines: int = Field(5, ge=2, le=1000)
    """Refused lines in a row that agree among each other, until the device is taken to have been restarted."""
    reopen_s: float = Field(0.5, ge=0.01, le=60.0)
    """Pause between two attempts to open the port."""
    silent_after_s: float = Field(2.0, gt=0.0, le=3600.0)
    """Without a right line for so long, health says that the encoder is silent."""

    @property
    def metres_per_tick(self) -> float:
        return self.wheel_diameter_m * 3.141592653589793 / self.ticks_per_rev


class Camera(Section):
    """The omnidirectional camera."""

    id: Id = "front"
    source: str = "0"
    """Number of a camera, a device, a video file, a stream's URL, or a folder of images."""
    width_px: int = Field(640, ge=32, le=16384)
    height_px: int = Field(480, ge=32, le=16384)
    frame_rate_hz: float = Field(15.0, gt=0.0, le=1000.0)
    """Rate to ask of a camera, and to play a folder of images at."""
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


class Bus(Section):
    """Zenoh, with the door closed: no scouting, and only the end points named here."""

    endpoint: EndPoint = "tcp/127.0.0.1:7447"
    """Where the router listens and the services connect; unixsock-stream/PATH for a socket of the file system."""
    listen: Annotated[tuple[EndPoint, ...], Strict(False)] = ()
    """More end points for the router, such as tcp/192.168.1.5:7447 for monitors on other machines."""
    shared_memory: bool = True
    """Large messages between processes of one machine go through shared memory."""
    max_message_bytes: int = Field(64 * 2**20, ge=1024, le=2**30)
    """A larger message is refused."""
    queue_messages: int = Field(20_000, ge=16, le=10_000_000)
    """Messages that may wait in a service for its loop; beyond it the oldest are dropped, and counted."""
    queue_bytes: int = Field(256 * 2**20, ge=2**20, le=2**34)
    """The same as a size."""


class Vision(Section):
    """Vertical lines, descriptor, matching, tracks (II-IV, IX-A). `mode = "paper"` takes the paper's values."""

    PAPER: ClassVar[Mapping[str, float]] = {
        "edge_tolerance_deg": 5.0,
        "min_length": 0.5,
        "bearing_std_deg": 0.04,
        "edge_min_magnitude": 30.0,
    }

    mode: Literal["default", "paper"] = "default"
    ring_search_px: float = Field(20.0, ge=1.0, le=500.0)
    """How far from the expected centre the ring is looked for first."""
    ring_min_quality: float = Field(0.30, ge=0.0, le=1.0)
    """Share of the rim that must be seen, else the frame's ring is lost."""
    edge_tolerance_deg: float = Field(15.0, gt=0.0, le=45.0)
    """Edges that point at the centre within this are kept. Paper: 5 deg (II, step 2)."""
    edge_min_magnitude: float = Field(32.0, ge=0.0, le=1000.0)
    """Sobel magnitude below which a pixel is no edge (grey steps x 8; by default of the picture in full light)."""
    sectors: int = Field(720, ge=90, le=7200)
    """Sectors of the histogram (II, step 4)."""
    min_length: float = Field(0.26, gt=0.0, le=1.0)
    """Votes that make a line, as a share of Rmax - Rmin. Paper: 0.5 (II, step 5)."""
    min_length_continued: float = Field(0.18, gt=0.0, le=1.0)
    """Shorter lines down to this may continue a track, never begin one. Not in the paper, unused in its mode."""
    max_lines: int = Field(200, ge=1, le=2000)
    """The strongest lines that are kept of one frame."""
    areas: Annotated[Literal[3, 5], BeforeValidator(_whole)] = 3
    """Circular areas of the descriptor along the line (III); 5 overlap by half."""
    bins: Annotated[Literal[8, 16, 32], BeforeValidator(_whole)] = 32
    """Bins of each orientation histogram, N_b (III)."""
    clip: float = Field(0.1, gt=0.0, le=1.0)
    """Histogram values are clipped here and scaled to unit length again (III)."""
    dissimilarity: Dissimilarity = "l2"
    """How unlike two lines are: by descriptors, or by patches of the panorama: ssd, zncc (IV, V). Paper: l2."""
    f1: float = Field(1.05, gt=0.0, le=4.0)
    """A match needs minD < F1 (eq. 8). Every dissimilarity is brought to the size of l2 first."""
    f2: float = Field(0.75, gt=0.0, le=4.0)
    """A match needs minD < F2 <D> (eq. 9)."""
    f3: float = Field(0.8, gt=0.0, le=4.0)
    """A match needs minD < F3 SminD (eq. 10)."""
    mutual: bool = False
    """The A_i nearest to B_j must be the one that B_j is nearest to. Not in the paper; only its mode goes by rules."""
    lookback_frames: int = Field(20, ge=1, le=1000)
    """A line without a match is looked for this many frames back (IX-A)."""
    bearing_std_deg: float = Field(0.018, gt=0.0, le=10.0)
    """What a bearing's sigma never falls below, however many points its line has [the paper is silent]."""

    @model_validator(mode="before")
    @classmethod
    def _paper_values(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "paper":
            return {**cls.PAPER, **given}
        return given


class Timeline(Section):
    """Putting the streams into the order of their stamps."""

    lateness_s: float = Field(0.25, gt=0.0, le=60.0)
    """Live, how long a message waits for a stream that lags. On a playback every message is waited for."""
    max_jump_s: float = Field(60.0, gt=0.0, le=86400.0)
    """A stamp farther ahead than this of its stream is refused."""
    confirmations: int = Field(5, ge=2, le=1000)
    """Messages in a row that agree with each other, but not with the stream, and mean that the clock has changed."""
    max_held: int = Field(20000, ge=100, le=10_000_000)
    """Messages held back at most; beyond it the oldest go on."""


class Storage(Section):
    path: Annotated[Path, Strict(False)] = Path("extrinsics.db")
    """The SQLite file; relative to the working directory."""
    locked_s: float = Field(2.0, gt=0.0, le=60.0)
    """How long to wait for another program that has the file locked."""
    waiting_max: int = Field(100, ge=1, le=10_000)
    """Extrinsics kept in memory while the file cannot be written; beyond it the oldest are given up and counted."""


class Player(Section):
    """Playing a recording in place of the bridge."""

    frames_ahead: int = Field(4, ge=1, le=1000)
    """Frames that may be on their way before the player waits for a result."""
    patience_s: float = Field(30.0, ge=0.1, le=3600.0)
    """Without a result for so long, the frames on their way are counted as lost, and the playback goes on."""
    comeback_s: float = Field(20.0, ge=0.0, le=3600.0)
    """How long a playback waits for a service that has gone."""
    wait_s: float = Field(120.0, ge=0.0, le=3600.0)
    """How long it waits at the start for the services that it was told to wait for."""


class Config(Section):
    """Everything that can be set. `robot`, `encoder`, `camera` and `ring` describe the machine: the rig."""

    robot: Robot = Robot()
    encoder: Encoder = Encoder()
    camera: Camera = Camera()
    ring: MirrorRing = MirrorRing()
    bus: Bus = Bus()
    vision: Vision = Vision()
    calibration: Calibration = Calibration()
    timeline: Timeline = Timeline()
    storage: Storage = Storage()
    player: Player = Player()

    @model_validator(mode="after")
    def _ring_is_in_the_picture(self) -> Self:
        width, height, reach = self.camera.width_px, self.camera.height_px, self.ring.r_max_px
        u, v = self.ring.center_px
        if not (-reach <= u <= width + reach and -reach <= v <= height + reach):
            raise ValueError(
                f"ring.center_px = ({u:g}, {v:g}) is farther than r_max_px outside the picture of {width} x {height}"
            )
        return self

    def rig(self) -> dict[str, dict[str, Any]]:
        """What a recording carries of the machine that made it: geometry and signs, not how its devices are reached."""
        return {table: getattr(self, table).model_dump(mode="json", include=keys) for table, keys in _RIG.items()}

    def rig_digest(self) -> str:
        """Fingerprint of all that a stored mount depends on: eight digits for each table that has a part in it."""
        values = self._mount_depends_on().values()
        return "-".join(hashlib.sha256(json.dumps(part, sort_keys=True).encode()).hexdigest()[:8] for part in values)

    def rig_changes(self, digest: str) -> tuple[str, ...]:
        """Where this configuration differs from that of another `rig_digest`: "table (key, key ...)"; () when nowhere.

        A digest of another form can be compared only as a whole.
        """
        ours, theirs = self.rig_digest().split("-"), digest.split("-")
        tables = self._mount_depends_on()
        if len(ours) != len(theirs):
            return (f"{', '.join(tables)} (which one can not be told from {digest})",)
        return tuple(
            f"{table} ({', '.join(keys)})"
            for (table, keys), our, their in zip(tables.items(), ours, theirs, strict=True)
            if our != their
        )

    def _mount_depends_on(self) -> dict[str, dict[str, Any]]:
        depends = {table: {key: rig[key] for key in sorted(rig.keys() - _FREE)} for table, rig in self.rig().items()}
        depends["camera"]["stamp_delay_s"] = self.camera.stamp_delay_s  # turns the mount by the way in that time
        depends["calibration"] = {"mode": self.calibration.mode}
        return depends


_RIG: dict[str, set[str]] = {
    "robot": {"id", "wheel_base_m"},
    "encoder": {"id", "wheel_diameter_m", "ticks_per_rev", "left_sign", "right_sign", "noise_k_m"},
    "camera": {"id", "width_px", "height_px", "bearing_sign", "frame_rate_hz"},
    "ring": {"center_px", "r_min_px", "r_max_px", "horizon_px"},
}
_FREE = {"noise_k_m", "frame_rate_hz", "center_px"}  # may change without moving the camera
