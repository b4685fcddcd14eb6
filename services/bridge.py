"""Camera and encoder onto the bus, each on its own: neither waits for the other, and each may be away."""

import argparse
import logging
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable

import cv2

from omnivert.config import Config
from omnivert.drivers.camera import Described, camera_events, can_wait, stored_facts
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.encoder import EncoderLine
from omnivert.drivers.newest import Newest
from omnivert.drivers.serial_line import pieces
from omnivert.messages import Frame
from omnivert.wire.bus import Bus
from omnivert.wire.channels import FRAME, TICKS
from services import _start

_log = logging.getLogger("omnivert.bridge")
TURN_S = 0.1  # how often the loop looks at the rest while no frame comes
TELL_NS = 10**9  # how often health hears of the encoder's clock
JOIN_S = 1.0  # a thread that is stuck in a driver is left behind


def run(bus: Bus, config: Config, exit_when_done: bool = False) -> None:
    """Publishes until the bus stops, or, if asked to, until a folder or file has ended.

    raises  UseError beside a player that stays, or a bridge or simulator of this camera; whatever broke a reader
    """
    bus.refuse_beside("player", namesakes=("bridge",))
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what is wrong with a camera stands in health
    stop, finished, frames = threading.Event(), threading.Event(), Newest[Frame]()
    broken: list[Exception] = []
    silence = Silence(bus, "camera", config.camera.source, config.camera.silent_after_s)
    readers = [
        _reader("encoder", lambda: read_encoder(bus, config, stop), bus, broken),
        _reader("camera", lambda: read_camera(bus, config, stop, frames, finished, silence), bus, broken),
    ]
    displaced = 0
    while not bus.stopped:
        done = finished.is_set()
        frame = frames.take(TURN_S)
        if frame is not None:
            bus.publish(FRAME, frame)
            note_size(bus, config, frame)
        elif done and exit_when_done:
            break
        silence.step(heard=frame is not None, expected=not done)
        if frames.displaced > displaced:
            bus.refuse("camera: frame displaced by a newer one", frames.displaced - displaced)
            displaced = frames.displaced
    stop.set()
    frames.close()
    for reader in readers:
        reader.join(JOIN_S)
    if broken:
        raise broken[0]


def read_encoder(bus: Bus, config: Config, stop: threading.Event) -> None:
    """The serial line onto the bus."""
    line = EncoderLine(config.encoder)
    silence = Silence(bus, "encoder", config.encoder.port, config.encoder.silent_after_s)
    counted: Counter[str] = Counter()
    told_ns = 0
    for piece in pieces(config.encoder, stop, line):
        arrival_ns = time.monotonic_ns()
        match piece:
            case Opened():
                line.reopened()
                silence.device(None)
            case Lost(reason):
                silence.device(reason)
            case bytes():
                readings = line.step(piece, arrival_ns)
                for ticks in readings:
                    bus.publish(TICKS, ticks)
                silence.step(heard=bool(readings))
        refused = Counter(line.refused)
        for reason, times in (refused - counted).items():
            bus.refuse(f"encoder: {reason}", times)
        counted = refused
        if arrival_ns - told_ns > TELL_NS:
            told_ns = arrival_ns
            bus.note(f"clock of the encoder: {line.clock}" if line.clock else None, "encoder clock")


def read_camera(
    bus: Bus,
    config: Config,
    stop: threading.Event,
    frames: Newest[Frame],
    finished: threading.Event,
    silence: "Silence",
) -> None:
    """The camera's frames into `frames`, what happens to it into health."""
    patient = can_wait(config.camera)
    for event in camera_events(config.camera, stop):
        match event:
            case Frame():
                frames.put(event, patient=patient)
            case Opened():
                silence.device(None)
                bus.note(f"camera: {stored_facts(config.camera)}" if patient else None, "camera facts")
            case Described(facts):
                bus.note(f"camera: {facts}", "camera facts")
            case Lost(reason):
                silence.device(reason)
                bus.note(None, "camera facts")
            case Refused(reason):
                bus.refuse(f"camera: {reason}")
            case Finished():
                bus.note("camera: source finished", "camera end")
                finished.set()


class Silence:
    """Tells health that a device is away, or there but silent; and who reads along, once, why, and when it is back.

    Back is who gives something usable: one that only opens and goes, twice a second, would fill the screen.
    """

    def __init__(self, bus: Bus, device: str, place: str, after_s: float) -> None:
        self._bus = bus
        self._device = device
        self._place = place
        self._after_s = after_s
        self._heard_s = time.monotonic()
        self._away = False
        self._how = "has not answered"  # some senders keep who connects waiting
        self._said: str | None = None

    def device(self, lost: str | None) -> None:
        """The device is lost for this reason, or there again."""
        self._away = lost is not None
        if not self._away:
            self._how = "is open and has given nothing usable"
        self._heard_s = time.monotonic()
        self._bus.note(f"{self._device}: {self._place} {lost}" if lost else None, self._device)
        if lost is not None:
            self._say(lost)

    def step(self, heard: bool, expected: bool = True) -> None:
        """Something usable has come, or has not, although something is expected."""
        now_s = time.monotonic()
        if heard:
            self._heard_s = now_s
            if not self._away:  # else it was sent before
                self._say(None)
        silent = expected and not self._away and now_s - self._heard_s > self._after_s
        self._bus.note(
            f"{self._device}: {self._place} {self._how} for {now_s - self._heard_s:.0f} s" if silent else None,
            f"{self._device} silence",
        )

    def _say(self, lost: str | None) -> None:
        if lost != self._said:
            _log.warning("%s: %s %s", self._device, self._place, lost if lost is not None else "is there again")
            self._said = lost


def note_size(bus: Bus, config: Config, frame: Frame) -> None:
    """A frame of another size is published as it is; a person should know."""
    camera = config.camera
    differs = (frame.width_px, frame.height_px) != (camera.width_px, camera.height_px)
    given, said = f"{frame.width_px} x {frame.height_px}", f"{camera.width_px} x {camera.height_px}"
    bus.note(f"camera: frames have {given} pixels, the configuration says {said}" if differs else None, "camera size")


def _reader(name: str, read: Callable[[], None], bus: Bus, broken: list[Exception]) -> threading.Thread:
    """A thread whose failure ends the service, so that the supervisor begins it anew."""

    def guarded() -> None:
        try:
            read()
        except Exception as error:  # noqa: BLE001 - raised again by the main thread
            broken.append(error)
            bus.stop()

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--exit-when-done", action="store_true", help="end when a folder of images or a video has ended"
    )


def main() -> int:
    return _start.start("bridge", lambda bus, config, given: run(bus, config, given.exit_when_done), _arguments)


if __name__ == "__main__":
    sys.exit(main())
