"""The checks in the order in which the data flow, so that the first that fails is the cause of what follows."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

from omnivert.doctor import about_bus, about_machine, about_picture, about_signs, about_streams
from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, unchecked


@dataclass(frozen=True, slots=True)
class Check:
    """
    group    the heading that it stands under
    needs    checks without which it says nothing: where one of them fails, this one is not asked
    of       where it makes sense
    """

    name: str
    group: str
    judge: Callable[[Evidence], Finding]
    needs: tuple[str, ...] = ()
    of: tuple[str, ...] = ("robot", "recording")


@dataclass(frozen=True, slots=True)
class Checked:
    name: str
    group: str
    finding: Finding


ROBOT = ("robot",)
CHECKS = (
    Check("install", "install", about_machine.install),
    Check("config", "config", about_machine.config),
    Check("encoder-device", "devices", about_machine.encoder_device, ("config",), ROBOT),
    Check("camera-device", "devices", about_machine.camera_device, ("config",), ROBOT),
    Check("router", "bus", about_bus.router, ("config",), ROBOT),
    Check("services", "bus", about_bus.services, ("router",), ROBOT),
    Check("publishers", "bus", about_bus.publishers, ("router",), ROBOT),
    Check("frames", "streams", about_streams.frames, ("router", "camera-device", "publishers")),
    Check("ticks", "streams", about_streams.ticks, ("router", "encoder-device", "publishers")),
    Check("clock", "streams", about_streams.clock, ("frames", "ticks")),
    Check("ring", "picture", about_picture.ring, ("services", "frames")),
    Check("mirror", "picture", about_picture.mirror, ("ring",)),
    Check("picture", "picture", about_picture.picture, ("ring",)),
    Check("lines", "picture", about_picture.lines, ("services", "frames", "ring")),
    Check("spread", "picture", about_picture.spread, ("lines",)),
    Check("wheels", "signs", about_signs.wheels, ("clock", "lines")),
    Check("sense", "signs", about_signs.sense, ("wheels",)),
    Check("turns", "signs", about_signs.turns, ("wheels", "sense")),
    Check("offset", "signs", about_signs.offset, ("clock", "lines", "wheels", "sense")),
    Check("calibration", "result", about_signs.calibration, ("services", "clock", "lines", "wheels", "sense", "turns")),
    Check("load", "load", about_bus.load, ("services", "frames"), ROBOT),
    Check("store", "storage", about_machine.store, ("config",), ROBOT),
    Check("disk", "storage", about_machine.disk, ("config",), ROBOT),
)
NAMES = tuple(dict.fromkeys([check.group for check in CHECKS] + [check.name for check in CHECKS]))


def checked(evidence: Evidence, only: Collection[str] = ()) -> list[Checked]:
    """Every check that makes sense here; with `only`, those of these names or groups."""
    where = "recording" if evidence.recording else "robot"
    done: list[Checked] = []
    failed: dict[str, str] = {}  # check -> the one that is the cause
    for check in CHECKS:
        if where not in check.of:
            continue
        cause = next((failed[name] for name in check.needs if name in failed), "")
        finding = unchecked(f"see {cause}") if cause else check.judge(evidence)
        if cause or finding.blocks:
            failed[check.name] = cause or check.name
        if not only or {check.name, check.group} & set(only):
            done.append(Checked(check.name, check.group, finding))
    return done
