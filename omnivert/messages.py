"""Every message that crosses a process border.

A message is frozen, stamped by the sensor in nanoseconds of the bridge's monotonic clock, and in SI units; angles are
radians, counter-clockwise seen from above. Beside each field stands its form: shape of an array, range of a number.
`omnivert.wire.codec` holds every message that arrives to its form, so nobody else has to.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Array:
    """The form of an array field. A letter is a length that all fields of the message and of its parts share."""

    dtype: str
    shape: tuple[int | str, ...]
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class Within:
    """The range of a number, or the greatest length of a text or tuple; both ends belong to it."""

    low: float
    high: float


StampNs = Annotated[int, Within(0, 2**62)]
Count = Annotated[int, Within(0, 2**62)]
Name = Annotated[str, Within(1, 64)]
Text = Annotated[str, Within(0, 1000)]
Angle = Annotated[float, Within(-np.pi, np.pi)]
Covariance3 = Annotated[NDArray[np.float64], Array("float64", (3, 3))]


class State(StrEnum):
    """The one vocabulary for how good a result is, from nothing to trusted, then the two alarms."""

    WAITING = "waiting"  # no data yet
    NOT_YET = "not_yet"  # data, but this cannot be seen well enough
    USABLE = "usable"  # seen; sigma above the configured limit
    CALIBRATED = "calibrated"  # sigma below the limit, consistent
    MOVED = "moved"  # the camera no longer sits where it did
    INVALID = "invalid"  # the data contradict the model


class PixelFormat(StrEnum):
    GREY8 = "grey8"  # (height, width)
    BGR8 = "bgr8"  # (height, width, 3)
    JPEG = "jpeg"  # (bytes,) as the file holds them
    PNG = "png"


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One camera image, raw or as the compressed file that it came in."""

    stamp_ns: StampNs  # mid-exposure
    format: PixelFormat
    width_px: Annotated[int, Within(1, 16384)]
    height_px: Annotated[int, Within(1, 16384)]
    data: Annotated[NDArray[np.uint8], Array("uint8", ("B",))]  # row by row when raw


@dataclass(frozen=True, slots=True, eq=False)
class Ticks:
    """The wheel encoders' counts: cumulative, rollover undone, positive when the robot drives forward."""

    stamp_ns: StampNs
    left: Annotated[int, Within(-(2**53), 2**53)]
    right: Annotated[int, Within(-(2**53), 2**53)]


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What somebody wants the wheels to do; holds for half a second, then the robot stops."""

    stamp_ns: StampNs  # the sender's monotonic clock
    forward_m_s: Annotated[float, Within(-5.0, 5.0)]  # of the origin
    turn_rad_s: Annotated[float, Within(-10.0, 10.0)]


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One sweep of a planar laser; carried and recorded, not used by the calibration."""

    stamp_ns: StampNs
    angle_min_rad: Annotated[float, Within(-7.0, 7.0)]
    angle_increment_rad: Annotated[float, Within(-1.0, 1.0)]
    range_m: Annotated[NDArray[np.float32], Array("float32", ("N",), 0.0, 1e4)]  # 0: no echo


@dataclass(frozen=True, slots=True, eq=False)
class Ring:
    """The mirror's outer rim in one frame."""

    center_u_px: Annotated[float, Within(-1e5, 1e5)]  # pixel centres at integer coordinates
    center_v_px: Annotated[float, Within(-1e5, 1e5)]
    radius_px: Annotated[float, Within(0.0, 1e5)]
    quality: Annotated[float, Within(0.0, 1.0)]  # share of the rim that was seen
    std_px: Annotated[float, Within(0.0, 1e5)] = 0.0  # of the centre, each axis; 0: not told


@dataclass(frozen=True, slots=True, eq=False)
class MeetingPoint:
    """Where the vertical lines meet in the picture; on the ring's centre when the mirror's axis is vertical."""

    u_px: Annotated[float, Within(-1e5, 1e5)]
    v_px: Annotated[float, Within(-1e5, 1e5)]
    std_px: Annotated[float, Within(0.0, 1e5)]  # each axis
    used: bool  # bearings are taken about this point, not about the ring's centre


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """How each line looks in the picture, and what its track is worth."""

    polarity: Annotated[NDArray[np.int32], Array("int32", ("N",), -1, 1)]  # +1: brighter towards growing image angle
    inner_px: Annotated[NDArray[np.float32], Array("float32", ("N",), 0.0, 1e5)]  # nearest edge point to the centre
    outer_px: Annotated[NDArray[np.float32], Array("float32", ("N",), 0.0, 1e5)]  # farthest
    quality: Annotated[NDArray[np.float32], Array("float32", ("N",), 0.0, 1.0)]  # how sure the track's identity is
    moving: Annotated[NDArray[np.uint8], Array("uint8", ("N",), 0, 1)]  # 1: moves against the static world


@dataclass(frozen=True, slots=True, eq=False)
class Bearings:
    """The vertical lines tracked in one frame; published for every frame, with reasons when it is bad."""

    stamp_ns: StampNs  # of the frame
    track_id: Annotated[NDArray[np.int64], Array("int64", ("N",), 0)]  # stable while the line stays tracked, unique
    bearing_rad: Annotated[NDArray[np.float64], Array("float64", ("N",), -np.pi, np.pi)]  # camera frame
    std_rad: Annotated[NDArray[np.float64], Array("float64", ("N",), 1e-6, np.pi)]
    age_frames: Annotated[NDArray[np.int32], Array("int32", ("N",), 0)]  # frames since the track began; 0 = new
    strength: Annotated[NDArray[np.float32], Array("float32", ("N",), 0.0, 1.0)]  # share of Rmax - Rmin with an edge
    ring: Ring | None = None  # None: no camera (any bearing sensor), or no frame that could be read
    reasons: Annotated[tuple[Text, ...], Within(0, 16)] = ()  # empty when the frame was good
    meeting: MeetingPoint | None = None  # None: not known (yet), or no camera
    looks: Looks | None = None  # None: no camera


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Where the camera sits on the robot (Fig. 19): at (rho cos phi, rho sin phi), heading phi + psi."""

    phi_rad: Angle
    rho_m: Annotated[float, Within(0.0, 100.0)]
    psi_rad: Angle
    covariance: Covariance3  # order phi, rho, psi; rad, m, rad


@dataclass(frozen=True, slots=True, eq=False)
class ParameterVerdict:
    """How well one parameter is known, and why not better."""

    state: State
    reason: Text = ""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """What the drive shows of the clocks and the wheels, beside the mount."""

    name: Name  # time_offset, wheel_ratio, wheel_base, noise_k, bearing_noise
    value: Annotated[float, Within(-1e6, 1e6)]  # s (camera stamps late: > 0); right / left; m; m; multiple of std_rad
    std: Annotated[float, Within(0.0, 1e6)]
    freed: bool  # estimated from this drive; else held at what is configured
    reason: Text = ""  # why it is held


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What the calibration knows after one frame; published for every frame, also when it is nothing yet."""

    stamp_ns: StampNs  # of the frame
    frame: Count  # frames so far
    mount: Mount | None  # None until there is a single clear solution
    state: State
    phi: ParameterVerdict
    rho: ParameterVerdict
    psi: ParameterVerdict
    next_manoeuvre: Text  # what to drive next; empty when nothing is missing
    driven_m: Annotated[float, Within(0.0, 1e9)]  # way of the robot's origin, forward or backward
    turned_rad: Annotated[float, Within(0.0, 1e9)]  # sum of |heading change|
    lines_used: Count
    lines_new: Count  # seen, position not known yet
    lines_rejected: Count  # contradicting the others
    reasons: Annotated[tuple[Text, ...], Within(0, 16)] = ()
    smoother: Mount | None = None  # the batch solution over the drive; `mount` is the filter's
    disagreement: Annotated[float, Within(0.0, 1e6)] = 0.0  # of filter and smoother, in sigmas
    bound_std: Annotated[NDArray[np.float64], Array("float64", (3,), 0.0)] | None = None  # Cramér-Rao, phi, rho, psi
    corrections: Annotated[tuple[Correction, ...], Within(0, 8)] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Extrinsics:
    """A converged mount, for whoever needs it and for the store."""

    stamp_ns: StampNs  # of the frame at which it was claimed
    robot: Name
    camera: Name
    mount: Mount
    state: State
    frames: Count
    reasons: Annotated[tuple[Text, ...], Within(0, 16)]
    software: Name  # "omnivert 0.1.0"
    rig_digest: Name  # of the configuration it holds for: `Config.rig_digest`


@dataclass(frozen=True, slots=True, eq=False)
class Receipt:
    """Storage says: these extrinsics would survive a power loss now."""

    stamp_ns: StampNs  # of the extrinsics
    robot: Name
    camera: Name
    entry: Count  # number in the store


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """How far the player is."""

    stamp_ns: StampNs  # of the newest message played
    played: Count  # messages
    total: Count  # of one round; a loop plays on beyond it
    finished: bool
    frame_ns: StampNs = 0  # of the newest frame played
    ticks_ns: StampNs = 0  # of the newest ticks played
    lost: Count = 0  # frames played for which no result came


@dataclass(frozen=True, slots=True, eq=False)
class Health:
    """What a service has counted since it started; once a second, also when nothing else moves."""

    stamp_ns: StampNs  # this host's monotonic clock, when it was sent
    service: Name
    instance: Name
    uptime_s: Annotated[float, Within(0.0, 1e9)]
    received: dict[Name, Count] = field(default_factory=dict)  # by key
    published: dict[Name, Count] = field(default_factory=dict)  # by key
    dropped: dict[Name, Count] = field(default_factory=dict)  # by key: displaced here because a newer one had come
    gaps: dict[Name, Count] = field(default_factory=dict)  # by key: missing by sequence number
    reordered: dict[Name, Count] = field(default_factory=dict)  # by key: came after a later one, or twice
    restarts: dict[Name, Count] = field(default_factory=dict)  # by key: another process publishes than before
    refused: dict[Text, Count] = field(default_factory=dict)  # by reason
    latency_p50_ms: Annotated[float, Within(0.0, 1e9)] | None = None  # publication there to result here
    latency_p99_ms: Annotated[float, Within(0.0, 1e9)] | None = None
    notes: Annotated[tuple[Text, ...], Within(0, 16)] = ()  # what a person should know now


Message = Frame | Ticks | Drive | Scan | Bearings | Estimate | Extrinsics | Receipt | Playback | Health
