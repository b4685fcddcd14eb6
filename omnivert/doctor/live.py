"""Evidence from a robot: what is heard on its bus for a few seconds; nothing is changed there."""

import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from omnivert.config import Config
from omnivert.doctor import devices, host
from omnivert.doctor.evidence import Device, Evidence, OnBus, Seen, Service, Told
from omnivert.doctor.pushed import Push, Stage
from omnivert.doctor.stream import Stream
from omnivert.errors import DataError
from omnivert.messages import Bearings, Estimate, Frame, Health, Message, Playback, Ticks
from omnivert.pictures.words import cause, reasons_of
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import BEARINGS, ESTIMATE, FRAME, HEALTH, PLAYBACK, TICKS

PATIENCE_S = 1.0  # for a router
NO_COUNTS_S = 5.0  # without counts of the wheels nobody's push is waited for
TURN_S = 0.1
VOICES: dict[type[Message], str] = {Frame: "camera", Ticks: "encoder", Bearings: "vision", Estimate: "calibration"}

Moved = Callable[[Stage | None, float], None]


class Interrupted(Exception):  # noqa: N818 - no fault
    """The bus was stopped by a signal while it was listened to."""


@dataclass(slots=True)
class _Arrivals:
    """One stream as it comes."""

    stamps: list[int] = field(default_factory=list)
    sent: list[int] = field(default_factory=list)
    sequences: dict[bytes, list[int]] = field(default_factory=dict)  # by publisher
    spans: dict[bytes, tuple[int, int]] = field(default_factory=dict)  # its first and last among all arrivals

    def add(self, received: Received) -> None:
        now = len(self.stamps)
        self.spans[received.publisher] = (self.spans.get(received.publisher, (now, now))[0], now)
        self.stamps.append(received.message.stamp_ns)
        self.sent.append(received.sent_ns)
        self.sequences.setdefault(received.publisher, []).append(received.sequence)

    def stream(self) -> Stream:
        lost = sum(max(found) - min(found) + 1 - len(set(found)) for found in self.sequences.values())
        stamps, sent = np.array(self.stamps, dtype=np.int64), np.array(self.sent, dtype=np.int64)
        return Stream(stamps, sent, lost)

    def at_once(self) -> int:
        """Publishers that spoke at the same time; one that comes after another has been started anew."""
        spans = sorted(self.spans.values())
        return max((sum(begin <= other <= end for begin, end in spans) for other, _ in spans), default=1)


class Ears:
    """A stepper: takes what the bus brings and remembers of it what the checks ask for."""

    def __init__(self) -> None:
        self.bearings: list[Bearings] = []
        self.ticks: list[Ticks] = []
        self.estimate: Estimate | None = None
        self.playback: Playback | None = None
        self.is_here = True
        self.replayed = False
        self._of = {name: _Arrivals() for name in VOICES.values()}
        self._health: dict[tuple[str, str], list[Health]] = {}

    def step(self, received: Received) -> None:
        self.is_here &= received.same_clock
        if (whose := VOICES.get(type(received.message))) is not None:
            self._of[whose].add(received)
        match received.message:
            case Frame():
                self.replayed |= received.replay
            case Ticks() as ticks:
                self.ticks.append(ticks)
                self.replayed |= received.replay
            case Bearings() as bearings:
                self.bearings.append(bearings)
            case Estimate() as estimate:
                self.estimate = estimate
            case Playback() as playback:
                self.playback = playback
            case Health() as health:
                self._health.setdefault((health.service, health.instance), []).append(health)

    def seen(self, config: Config) -> Seen:
        ticks = (self._of["encoder"].stream(), self.ticks)
        return Seen.of(config, self._of["camera"].stream(), ticks, self.bearings)

    def voices(self) -> dict[str, int]:
        return {name: arrivals.at_once() for name, arrivals in self._of.items()}

    def services(self, present: frozenset[tuple[str, str]]) -> tuple[Service, ...]:
        found = []
        for name, instance in sorted(present | self._health.keys()):
            said = self._health.get((name, instance), [])
            first, newest = (said[0], said[-1]) if said else (None, None)
            found.append(Service(name, instance, (name, instance) in present, first, newest))
        return tuple(found)

    def told(self) -> Told | None:
        last = self.estimate
        if last is None:
            return None
        return Told(last.state, cause(reasons_of(last)[:2]), last.next_manoeuvre, last.corrections)


@dataclass(frozen=True, slots=True)
class Robot:
    """Whom to look at.

    source    file of the settings; "" when nobody named one
    is_local  its bus is reached without a network, so that its devices and its store are probably here
    refusal   why there is no bus, where that is known already
    """

    config: Config
    source: str
    is_local: bool
    refusal: DataError | None = None


def live(robot: Robot, seconds: float, push: Push | None, moved: Moved) -> Evidence:
    """Listens for so long, or until a person has pushed the robot.

    push    waits for the two movements, for at most `seconds`, and while the wheels' counts come
    moved   called now and then with the stage of the push and the time that has gone; s
    raises  Interrupted when a signal came
    """
    config, refusal = robot.config, robot.refusal
    ears, present, twice = Ears(), frozenset[tuple[str, str]](), list[str]()
    began = time.monotonic()
    try:
        if refusal is not None:
            raise refusal
        with Bus(config, "doctor", f"d{os.getpid()}", PATIENCE_S) as bus:
            _listen(bus, ears, seconds, push, moved)
            present = bus.present()
            names = Counter(name for name, _ in present)
            twice = [name for name in sorted(names) if len(bus.incarnations(name)) > names[name]]
            if bus.stopped:
                raise Interrupted
    except DataError as error:
        refusal = error
    here = robot.is_local and ears.is_here
    playback = ears.playback
    on_bus = OnBus(
        refusal=refusal,
        services=ears.services(present),
        twice=tuple(twice),
        voices=ears.voices(),
        seconds=time.monotonic() - began,
        is_here=here,
        playing=ears.replayed or bool({"player"} & {name for name, _ in present}),
        is_over=playback is not None and playback.finished,
    )
    encoder, camera = _devices(config, bool(robot.source), on_bus)
    return Evidence(
        config=config,
        source=robot.source,
        configured=bool(robot.source),
        recording=False,
        host=host.this_host(),
        seen=ears.seen(config),
        told=ears.told(),
        bus=on_bus,
        encoder=encoder,
        camera=camera,
        keeping=host.keeping(config) if here else None,
        pushed=None if push is None else push.pushed,
    )


def _listen(bus: Bus, ears: Ears, seconds: float, push: Push | None, moved: Moved) -> None:
    began = counted = time.monotonic()
    for received in bus.listen(FRAME, TICKS, BEARINGS, ESTIMATE, PLAYBACK, HEALTH, period_s=TURN_S, every=True):
        now = time.monotonic()
        gone = now - began
        moved(None if push is None else push.stage, gone)
        if received is not None:
            ears.step(received)
            if isinstance(received.message, Ticks):
                counted = now
            if push is not None and isinstance(received.message, Ticks | Bearings):
                push.step(received.message)
        is_over = push is not None and (push.stage is Stage.DONE or now - counted > NO_COUNTS_S)
        if gone >= seconds or is_over:
            return


def _devices(config: Config, configured: bool, bus: OnBus) -> tuple[Device, Device]:
    """Encoder and camera: as the bridge tells; where none runs, tried."""
    names = (f"encoder {config.encoder.port}", f"camera {config.camera.source}")
    bridge = next(iter(bus.of("bridge")), None)
    if bridge is not None:
        port, source = (config.encoder.port, config.camera.source) if configured else ("encoder", "camera")
        return (
            devices.as_the_bridge_tells("encoder", port, bridge),
            devices.as_the_bridge_tells("camera", source, bridge),
        )
    if bus.playing:
        why = "a recording plays in place of the robot"
    elif not bus.is_here:
        why = "they are at another machine: omnivert doctor there"
    elif not configured:
        why = "which they are is not configured"
    else:
        return devices.tried(config)
    return Device(f"{names[0]}: {why}", known=False), Device(f"{names[1]}: {why}", known=False)
