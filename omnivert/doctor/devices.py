"""Camera and encoder while no bridge runs: there, permitted, free, and saying something. A held device stays closed."""

import getpass
import grp
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread

import cv2

from omnivert.config import Camera, Config, Encoder
from omnivert.doctor.evidence import Device, Service
from omnivert.drivers.camera import Described, camera_events, can_wait
from omnivert.drivers.device import Finished, Lost, Refused
from omnivert.drivers.encoder import EncoderLine
from omnivert.drivers.serial_line import pieces
from omnivert.messages import Frame, Ticks
from omnivert.pictures.notes import is_harmless, todo

LISTEN_S = 2.5  # a board that starts anew when its port is opened takes two seconds
ENOUGH_TICKS = 20
ENOUGH_FRAMES = 10
FACTS = {"camera": "camera: stamped by", "encoder": "clock of the encoder"}  # how the bridge's notes of them begin
_PROCESSES = Path("/proc")


def tried(config: Config) -> tuple[Device, Device]:
    """Encoder and camera, both at once; what hangs in its driver is left behind."""
    found: dict[str, Device] = {}
    tests: dict[str, Callable[[], Device]] = {
        "encoder": lambda: encoder(config.encoder),
        "camera": lambda: camera(config.camera),
    }

    def run(name: str, test: Callable[[], Device]) -> None:
        found[name] = test()

    threads = [Thread(target=run, args=item, name=item[0], daemon=True) for item in tests.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LISTEN_S + 1.5)
    stuck = f"does not answer within {LISTEN_S + 1.5:.0f} s"
    places = {"encoder": config.encoder.port, "camera": config.camera.source}
    lost = {name: Device(place, f"{place} {stuck}", "its driver hangs", "unplug it") for name, place in places.items()}
    return found.get("encoder", lost["encoder"]), found.get("camera", lost["camera"])


def as_the_bridge_tells(what: str, place: str, bridge: Service) -> Device:
    """One of the devices that a running bridge holds.

    what  "camera" or "encoder", as its notes begin
    """
    health = bridge.health
    if health is None:
        return Device(f"{place} is the bridge's, which has not said anything yet", known=False)
    told = [note for note in health.notes if note.startswith(f"{what}: ") and not is_harmless(note)]
    if not told:
        facts = [note.removeprefix(f"{what}: ") for note in health.notes if note.startswith(FACTS[what])]
        return Device(f"{place}: {'; '.join(['the bridge reads it', *facts])}")
    trouble = told[0].removeprefix(f"{what}: ")
    refused = {reason: times for reason, times in health.refused.items() if reason.startswith(f"{what}: ")}
    reason = max(refused, key=lambda reason: refused[reason]).removeprefix(f"{what}: ") if refused else ""
    help = todo(told[0])
    if "ermission denied" in trouble and Path(place).exists():
        reason, help = _admission(Path(place))
    elif what == "encoder" and "No such file" in trouble and (others := _ports()):
        help = f'encoder.port = "{others[0]}"'
    return Device(place, trouble if place in trouble else f"{place}: {trouble}", reason, help)


def encoder(config: Encoder) -> Device:
    """The port by itself, and whether what it sends can be read."""
    port = config.port
    if "://" not in port and (wrong := _closed(Path(port), port, "encoder.port", _ports())):
        return wrong
    line, stop, readings = EncoderLine(config), Event(), list[Ticks]()
    until_s = time.monotonic() + LISTEN_S
    came = False
    for piece in pieces(config, stop, line):
        match piece:
            case Lost(reason):
                return Device(port, f"{port} {reason}", "", "omnivert monitor   # shows who else reads it")
            case bytes():
                came = came or bool(piece)
                readings += line.step(piece, time.monotonic_ns())
        if len(readings) >= ENOUGH_TICKS or time.monotonic() > until_s:
            stop.set()
    if readings:
        return Device(f"{port}: {_rate(readings)} readings a second")
    if not came:
        return Device(port, f"{port} is open and silent", "not a byte came", "switch the encoder board on")
    reasons = ", ".join(sorted(line.refused, key=lambda reason: -line.refused[reason])[:2])
    because = reasons or "what comes never ends a line"
    help = f"set encoder.protocol, which is {config.protocol}, and encoder.baud, which is {config.baud}"
    return Device(port, f"{port} sends what cannot be read", because, help)


def camera(config: Camera) -> Device:
    """The source by itself, and what its frames are like."""
    source = config.source
    place = Path(f"/dev/video{source}") if source.isdecimal() else Path(source)
    is_file = can_wait(config) or source.isdecimal() or source.startswith("/dev/")
    if is_file and (wrong := _closed(place, str(place), "camera.source", sorted(Path("/dev").glob("video*")))):
        return wrong
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what is wrong is said below
    frames: deque[Frame] = deque(maxlen=ENOUGH_FRAMES)
    said, refused, stop, until_s = "", "", Event(), time.monotonic() + LISTEN_S
    for event in camera_events(config, stop):
        match event:
            case Frame():
                frames.append(event)
            case Lost(reason):
                return Device(str(place), f"{place} {reason}", "", "set camera.source to a camera that is there")
            case Described(facts):
                said = str(facts)
            case Refused(reason):
                refused = reason
            case Finished():
                break
        if len(frames) >= ENOUGH_FRAMES or time.monotonic() > until_s:
            stop.set()
    if not frames:
        reason = refused or "it opened, but not a picture came"
        return Device(str(place), f"{place} gives no picture", reason, "unplug the camera and plug it in again")
    return _looks(str(place), frames, said, config)


def _looks(place: str, frames: deque[Frame], said: str, config: Camera) -> Device:
    newest = frames[-1]
    size = f"{newest.width_px} x {newest.height_px}"
    fact = f"{place}: {size} px {newest.format.value}, {_rate(list(frames))} frames a second{said and f', {said}'}"
    if (newest.width_px, newest.height_px) == (config.width_px, config.height_px):
        return Device(fact)
    said = f"{config.width_px} x {config.height_px}"
    help = f"camera.width_px = {newest.width_px}, camera.height_px = {newest.height_px}; then measure [ring] again"
    return Device(fact, f"{place} gives {size} px, the configuration says {said}", "the ring is told in pixels", help)


def _rate(messages: list[Frame] | list[Ticks]) -> str:
    lasted_s = 1e-9 * (messages[-1].stamp_ns - messages[0].stamp_ns)
    return f"{(len(messages) - 1) / lasted_s:.1f}" if lasted_s > 0.0 else "?"


def _closed(place: Path, name: str, setting: str, others: list[Path]) -> Device | None:
    """Why it is not to be opened; None when it may be."""
    if not place.exists():
        there = ", ".join(map(str, others[:3]))
        reason = f"there are {there}" if there else "nothing of its kind is plugged in"
        help = f'{setting} = "{others[0]}"' if others else f"plug it in, or set {setting}"
        return Device(name, f"{name} is not there", reason, help)
    if not os.access(place, os.R_OK | (os.W_OK if place.is_char_device() else 0)):
        return Device(name, f"{name}: permission denied", *_admission(place))
    holder = next(_holders(place), "") if place.is_char_device() else ""
    if holder:
        return Device(name, f"{name} is held by {holder}", "two readers would each get a part", f"end {holder}")
    return None


def _admission(place: Path) -> tuple[str, str]:
    """Why it is forbidden, and how to be let in."""
    user, group = getpass.getuser(), _group(place)
    if group in ("", "root"):
        return f"it belongs to root, and you are {user}", f"sudo chmod a+rw {place}"
    return f"you are not in the group {group}", f"sudo usermod -aG {group} {user}, then log in again"


def _group(place: Path) -> str:
    try:
        return grp.getgrgid(place.stat().st_gid).gr_name
    except (KeyError, OSError):
        return ""


def _holders(place: Path) -> Iterator[str]:
    """Other processes that have it open, as far as this user may see: NAME (process NUMBER)."""
    device = place.resolve()
    for process in _PROCESSES.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        try:
            held = any(handle.readlink() == device for handle in (process / "fd").iterdir())
            name = (process / "comm").read_text().strip() if held else ""
        except OSError:
            continue
        if name:
            yield f"{name} (process {process.name})"


def _ports() -> list[Path]:
    """Serial ports that are plugged in; names that stay the same first."""
    found = [*Path("/dev/serial/by-id").glob("*"), *Path("/dev").glob("ttyUSB*"), *Path("/dev").glob("ttyACM*")]
    return sorted(found, key=lambda path: ("by-id" not in str(path), str(path)))
