"""Checks of this machine: installation, settings, devices, store, disk."""

from omnivert.config import Config
from omnivert.doctor.evidence import Device, Evidence
from omnivert.doctor.finding import Finding, fine, stops, unchecked, worse
from omnivert.doctor.host import SHOWN

NAMED = 4  # settings that differ from the default
FULL_BYTES = 10 * 2**20  # the store needs about this much room to work in
SCARCE_BYTES = 200 * 2**20
ANOTHER_MACHINE = "it is at another machine: omnivert doctor there"


def install(evidence: Evidence) -> Finding:
    host = evidence.host
    told = ", ".join(f"{name} {host.versions[name]}" for name in SHOWN if host.versions.get(name))
    if len(host.opencvs) > 1:
        others = " ".join(name for name in host.opencvs if name != "opencv-python-headless")
        fact = f"several OpenCVs are installed over each other: {', '.join(host.opencvs)}"
        help = f"pip uninstall -y {others} && pip install --force-reinstall opencv-python-headless"
        return worse(fact, "which of them answers to cv2 is chance", help)
    return fine(told)


def config(evidence: Evidence) -> Finding:
    if evidence.recording:
        return fine(f"{evidence.source} carries the rig of robot {evidence.config.robot.id}")
    if evidence.source:
        return fine(f"{evidence.source} is valid, {_differing(evidence.config)}")
    if evidence.bus.of("bridge", "player", "vision", "calibration"):
        return fine(f"no file was named; robot {evidence.config.robot.id} is on the bus, the rest are defaults")
    reason = "which camera, which port, how wide the robot is can not be guessed"
    help = "omnivert config > robot.toml, change it for your robot, then omnivert doctor --config robot.toml"
    return stops("no configuration was named, and no robot is on the bus", reason, help)


def encoder_device(evidence: Evidence) -> Finding:
    return _device(evidence.encoder)


def camera_device(evidence: Evidence) -> Finding:
    return _device(evidence.camera)


def store(evidence: Evidence) -> Finding:
    said = next((note for s in evidence.bus.of("storage") if s.health for note in s.health.notes), "")
    if said.startswith("storage: ") and "was damaged" not in said:
        help = f"mend it, or set storage.path, which is {evidence.config.storage.path}"
        return stops(said.removeprefix("storage: "), "results are not kept", help)
    kept = evidence.keeping
    if kept is None:
        return unchecked(ANOTHER_MACHINE)
    if evidence.bus.of("storage") and not evidence.config.storage.path.is_absolute():
        return fine(f"{evidence.config.storage.path} in the folder that the storage service was started in: no trouble")
    if kept.trouble is not None:
        return stops(kept.trouble.what, kept.trouble.because or "results are not kept", kept.trouble.help)
    return fine(kept.store)


def disk(evidence: Evidence) -> Finding:
    kept, camera = evidence.keeping, evidence.config.camera
    if kept is None:
        return unchecked(ANOTHER_MACHINE)
    if kept.free_bytes is None:
        return unchecked(f"there is no folder {evidence.config.storage.path.parent}")
    recording_s = kept.free_bytes / (camera.width_px * camera.height_px * camera.frame_rate_hz)
    fact = f"{_size(kept.free_bytes)} free, room for {_duration(recording_s)} of recording"
    help = f"make room on the disk of {evidence.config.storage.path.parent.absolute()}"
    if kept.free_bytes < FULL_BYTES:
        return stops(fact, "the disk is full: results can not be stored", help)
    if kept.free_bytes < SCARCE_BYTES:
        return worse(fact, "the disk is nearly full: recordings end early", help)
    return fine(fact)


def _device(device: Device | None) -> Finding:
    if device is None or not device.known:
        return unchecked("nobody looked at it" if device is None else device.fact)
    if device.trouble:
        return stops(device.trouble, device.reason, device.help)
    return fine(device.fact)


def _differing(config: Config) -> str:
    told, default = config.model_dump(mode="json"), Config().model_dump(mode="json")
    names = [f"{table}.{key}" for table, keys in told.items() for key in keys if keys[key] != default[table][key]]
    if not names:
        return "all values are the defaults"
    more = ", ..." if len(names) > NAMED else ""
    count = "1 value differs" if len(names) == 1 else f"{len(names)} values differ"
    return f"{count} from the default: {', '.join(names[:NAMED])}{more}"


def _size(count: int) -> str:
    return f"{count / 2**30:.1f} GB" if count >= 2**30 else f"{count / 2**20:.0f} MB"


def _duration(seconds: float) -> str:
    return f"{seconds / 3600.0:.1f} h" if seconds >= 3600.0 else f"{seconds / 60.0:.0f} min"
