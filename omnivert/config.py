"""One TOML file -> frozen, validated settings. Every number has its unit in its name, its meaning and source beside it.

A table that is left out takes its defaults; an unknown key, a wrong type or a number out of range is refused with the
nearest right key or the unit that was probably meant.
"""

import difflib
import hashlib
import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, model_validator

from omnivert.errors import UseError

Id = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,31}$")]  # one chunk of a key


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)


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
    """Any pyserial port or URL."""
    baud: int = Field(115200, ge=300, le=4_000_000)
    wheel_diameter_m: float = Field(0.15, ge=0.01, le=2.0)
    ticks_per_rev: int = Field(2000, ge=1, le=10_000_000)
    """Counts per turn of the wheel, gear included."""
    left_sign: Literal[1, -1] = 1
    """-1 where the raw count falls when the robot drives forward."""
    right_sign: Literal[1, -1] = 1
    counter_bits: int = Field(32, ge=8, le=63)
    """Width of the device's counters, for undoing their rollover."""
    max_speed_m_s: float = Field(5.0, gt=0.0, le=100.0)
    """A wheel that seems faster than this between two messages has jumped, not driven."""
    noise_k_m: float = Field(2e-4, gt=0.0, le=0.1)
    """K of eq. 31: variance of a wheel's displacement per metre driven (Chong and Kleeman)."""

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
    bearing_sign: Literal[1, -1] = 1
    """+1: the image angle atan2(-(v - cv), u - cu) grows with the bearing; -1: it falls (mirror image)."""


class MirrorRing(Section):
    """The mirror in the picture: its outer rim, and the ring between Rmin and Rmax that shows the world."""

    center_px: tuple[float, float] = (321.5, 239.0)
    """(u, v) where the centre is expected; each frame finds its own near it."""
    r_min_px: float = Field(63.0, gt=4.0, le=1e4)
    r_max_px: float = Field(225.0, gt=8.0, le=1e4)
    """Radius of the rim, known from one still image (II, step 1)."""

    @model_validator(mode="after")
    def _ring_is_open(self) -> Self:
        if self.r_max_px < self.r_min_px + 16.0:
            raise ValueError("r_max_px must exceed r_min_px by at least 16 pixels")
        return self


class Bus(Section):
    """Zenoh, with the door closed: no scouting, and only the end points named here."""

    endpoint: str = "tcp/127.0.0.1:7447"
    """Where the router listens and the services connect; unixsock-stream/PATH for a socket of the file system."""
    listen: tuple[str, ...] = ()
    """More end points for the router, such as tcp/192.168.1.5:7447 for monitors on other machines."""
    shared_memory: bool = True
    """Large messages between processes of one machine go through shared memory."""
    max_message_bytes: int = Field(64 * 2**20, ge=1024, le=2**30)


class Vision(Section):
    """Vertical lines, descriptor, matching, tracks (II-IV, IX-A). `mode = "paper"` takes the paper's values."""

    mode: Literal["default", "paper"] = "default"
    ring_search_px: float = Field(20.0, ge=1.0, le=500.0)
    """How far from the expected centre the ring is looked for first."""
    ring_min_quality: float = Field(0.25, ge=0.0, le=1.0)
    """Share of the rim that must be seen, else the frame's ring is lost."""
    edge_tolerance_deg: float = Field(20.0, gt=0.0, le=45.0)
    """Edges that point at the centre within this are kept. Paper: 5 deg (II, step 2)."""
    edge_min_magnitude: float = Field(40.0, ge=0.0, le=1000.0)
    """Sobel magnitude below which a pixel is no edge (grey steps x 8)."""
    sectors: int = Field(720, ge=90, le=7200)
    """Sectors of the histogram (II, step 4)."""
    min_length: float = Field(0.28, gt=0.0, le=1.0)
    """Votes that make a line, as a share of Rmax - Rmin. Paper: 0.5 (II, step 5)."""
    max_lines: int = Field(400, ge=1, le=5000)
    """The strongest lines that are kept of one frame."""
    areas: Literal[3, 5] = 3
    """Circular areas of the descriptor along the line (III); 5 overlap by half."""
    bins: Literal[8, 16, 32] = 32
    """Bins of each orientation histogram, N_b (III)."""
    clip: float = Field(0.1, gt=0.0, le=1.0)
    """Histogram values are clipped here and scaled to unit length again (III)."""
    f1: float = Field(1.05, gt=0.0, le=4.0)
    """A match needs minD < F1 (eq. 8)."""
    f2: float = Field(0.75, gt=0.0, le=4.0)
    """A match needs minD < F2 <D> (eq. 9)."""
    f3: float = Field(0.8, gt=0.0, le=4.0)
    """A match needs minD < F3 SminD (eq. 10)."""
    lookback_frames: int = Field(20, ge=1, le=1000)
    """A line without a match is looked for this many frames back (IX-A)."""
    bearing_std_deg: float = Field(0.15, gt=0.0, le=10.0)
    """Standard deviation claimed for a bearing [the paper is silent]."""

    @model_validator(mode="before")
    @classmethod
    def _paper_values(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "paper":
            return {"edge_tolerance_deg": 5.0, "min_length": 0.5, **given}
        return given


class Calibration(Section):
    """Odometry and bearings -> mount (VII-VIII)."""

    mode: Literal["default", "paper"] = "default"
    """paper: the filter as printed (state D, eq. 26, 5 K, started from `start_*`); default: global start, 1/D, arcs."""
    start_phi_rad: float = Field(0.0, ge=-3.15, le=3.15)
    """Measured by hand; used in paper mode only, as are the next two (IX-B)."""
    start_rho_m: float = Field(0.2, ge=0.0, le=5.0)
    start_psi_rad: float = Field(0.0, ge=-3.15, le=3.15)
    max_rho_m: float = Field(1.0, gt=0.0, le=10.0)
    """A camera farther than this from the robot's origin is no solution."""
    sigma_limit_deg: float = Field(2.0, gt=0.0, le=45.0)
    """phi and psi are calibrated when their sigma is below this."""
    sigma_limit_m: float = Field(0.010, gt=0.0, le=1.0)
    """rho is calibrated when its sigma is below this."""
    resume: bool = True
    """Take up the stored extrinsics at the start, when robot, camera and configuration match."""


class Timeline(Section):
    """Putting the streams into the order of their stamps."""

    lateness_s: float = Field(0.25, gt=0.0, le=60.0)
    """Live, how long a message waits for a stream that lags. On a playback every message is waited for."""
    max_jump_s: float = Field(60.0, gt=0.0, le=86400.0)
    """A stamp farther ahead than this of all others is refused."""
    max_held: int = Field(20000, ge=100, le=10_000_000)
    """Messages held back at most; beyond it the oldest go on."""


class Storage(Section):
    path: Path = Path("extrinsics.db")
    """The SQLite file; relative to the working directory."""


class Player(Section):
    frames_ahead: int = Field(4, ge=1, le=1000)
    """At full speed, frames that may be on their way before the player waits for a result."""


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

    def rig_digest(self) -> str:
        """Fingerprint of all that a stored mount depends on: geometry of drive, encoders, image and ring."""
        rig = {
            "robot": self.robot.model_dump(include={"id", "wheel_base_m"}),
            "encoder": self.encoder.model_dump(
                include={"wheel_diameter_m", "ticks_per_rev", "left_sign", "right_sign"}
            ),
            "camera": self.camera.model_dump(include={"id", "width_px", "height_px", "bearing_sign"}),
            "ring": self.ring.model_dump(include={"r_min_px", "r_max_px"}),
        }
        return hashlib.sha256(json.dumps(rig, sort_keys=True).encode()).hexdigest()[:16]


RIG = ("robot", "encoder", "camera", "ring")  # the tables that a recording carries


def load(path: Path) -> Config:
    """The settings in a TOML file, or in a JSON file of the same shape.

    raises  UseError naming file, key and the likely cure
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UseError(
            "OV201", f"cannot read the configuration {path}", str(error), "omnivert config > robot.toml"
        ) from error
    try:
        given = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:  # both parsers' errors are ValueErrors
        raise UseError("OV202", f"{path} cannot be parsed", str(error)) from error
    return parsed(given, str(path))


def parsed(given: dict[str, Any], where: str) -> Config:
    """The settings in a nested dict of a TOML file; `where` names it in errors."""
    try:
        return Config.model_validate(given)
    except ValidationError as error:
        raise _refusal(error, where) from error


def _refusal(error: ValidationError, where: str) -> UseError:
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return UseError("OV203", f"{where}: unknown key {place}", help=_nearest(first["loc"]))
    value = first["input"]
    given = f" = {value!r}" if isinstance(value, (int, float, str)) else ""
    return UseError(
        "OV204", f"{where}: {place}{given}", first["msg"].removeprefix("Value error, "), _unit(place, value)
    )


def _nearest(place: tuple[int | str, ...]) -> str:
    fields = set(Config.model_fields)
    if len(place) > 1 and place[0] in fields:
        section = Config.model_fields[str(place[0])].annotation
        fields = set(section.model_fields) if isinstance(section, type) and issubclass(section, Section) else set()
    near = difflib.get_close_matches(str(place[-1]), sorted(fields), n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"known keys: {', '.join(sorted(fields))}"


def _unit(place: str, value: object) -> str:
    """The value that was probably meant, where a length was given in millimetres or an angle in the other unit."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return ""
    if place.endswith("_m") and value > 1:
        return f"lengths are in metres; {value:g} mm would be {value / 1000:g}"
    if place.endswith("_rad"):
        return f"angles named _rad are in radians; {value:g} deg would be {value * 3.141592653589793 / 180:.4f}"
    return ""
