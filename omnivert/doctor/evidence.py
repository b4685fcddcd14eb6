"""All that the checks look at, gathered once; the checks themselves ask nobody."""

from dataclasses import dataclass, field

import numpy as np

from omnivert.config import Config
from omnivert.doctor.pushed import Pushed
from omnivert.doctor.stream import NOTHING, Stream
from omnivert.doctor.turning import Turning, WheelWay, turning, turns_seen
from omnivert.errors import OmnivertError
from omnivert.messages import Bearings, Correction, Health, State, Ticks

TURNED_M = 0.01  # a wheel that went farther between two counts has turned


@dataclass(frozen=True, slots=True)
class Host:
    """This machine and what is installed on it.

    versions     by distribution; "" when it is not installed
    opencvs      distributions that bring the module cv2
    """

    python: str
    system: str
    versions: dict[str, str]
    opencvs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Device:
    """Camera or encoder, tried by itself or as the bridge tells of it.

    trouble  what is wrong with it; "" when it is right
    known    False: nobody could look at it, `fact` says why
    """

    fact: str
    trouble: str = ""
    reason: str = ""
    help: str = ""
    known: bool = True


@dataclass(frozen=True, slots=True)
class Keeping:
    """Store and disk of this machine.

    store          what is in the store, in words
    trouble        why nothing can be stored; None when it can
    free_bytes     on its disk; None when not known
    """

    store: str
    trouble: OmnivertError | None
    free_bytes: int | None


@dataclass(frozen=True, slots=True, eq=False)
class Service:
    """Who is on the bus, or was heard."""

    name: str
    instance: str
    present: bool
    first: Health | None = None  # first and newest health message that was heard
    health: Health | None = None


@dataclass(frozen=True, slots=True, eq=False)
class OnBus:
    """What the bus brought.

    refusal    why there is no bus; None when there is
    twice      services of which more than one process runs under one name
    voices     processes that publish at the same time, by whose stream it is
    seconds    listened for
    is_here    the services run on this machine
    playing    a recording plays in place of a robot
    is_over    that recording has been played to its end
    """

    refusal: OmnivertError | None = None
    services: tuple[Service, ...] = ()
    twice: tuple[str, ...] = ()
    voices: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    is_here: bool = True
    playing: bool = False
    is_over: bool = False

    def of(self, *names: str) -> list[Service]:
        """Those of these names that are present."""
        return [service for service in self.services if service.name in names and service.present]


@dataclass(frozen=True, slots=True)
class Told:
    """What the calibration makes of it, where it has been asked.

    why   for what the state says; may be empty
    todo  what to drive next; empty when nothing is missing
    """

    state: State
    why: str
    todo: str
    corrections: tuple[Correction, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What the sensors told, and what the vision made of it.

    images   the lines come from a camera; else from another sensor of bearings, which tells when it sees something
    blind_s  the longest silence of the wheel counts in which the wheels turned
    """

    frames: Stream = NOTHING
    ticks: Stream = NOTHING
    bearings: tuple[Bearings, ...] = ()
    images: bool = True
    turning: Turning | None = None
    blind_s: float = 0.0

    @classmethod
    def of(
        cls,
        config: Config,
        frames: Stream,
        ticks: tuple[Stream, list[Ticks]],
        bearings: list[Bearings],
        images: bool = True,
    ) -> "Seen":
        lines = sorted(bearings, key=lambda frame: frame.stamp_ns)
        way = wheel_way(ticks[1], config.encoder.metres_per_tick)
        found = turning(turns_seen(lines), way, config.robot.wheel_base_m, config.encoder.noise_k_m)
        return cls(frames, ticks[0], tuple(lines), images, found, _blind(way))


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """
    source      file of the settings, or the recording
    configured  the settings are this robot's: a file was given, or the recording carries them
    recording   it is one; else a robot
    """

    config: Config
    source: str
    configured: bool
    recording: bool
    host: Host
    seen: Seen = field(default_factory=Seen)
    told: Told | None = None
    bus: OnBus = field(default_factory=OnBus)
    encoder: Device | None = None
    camera: Device | None = None
    keeping: Keeping | None = None  # None: of another machine
    pushed: Pushed | None = None


def _blind(way: WheelWay) -> float:
    turned = (np.abs(np.diff(way.right_m)) > TURNED_M) | (np.abs(np.diff(way.left_m)) > TURNED_M)
    return float(np.diff(way.time_s)[turned].max(initial=0.0))


def wheel_way(ticks: list[Ticks], metres_per_tick: float) -> WheelWay:
    """The counts as ways, by rising stamp."""
    rows = np.array([(t.stamp_ns, t.right, t.left) for t in ticks], dtype=np.int64).reshape(-1, 3)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    scales = np.array([1e-9, metres_per_tick, metres_per_tick])
    time_s, right_m, left_m = (scales * rows).T
    return WheelWay(time_s, right_m, left_m)
