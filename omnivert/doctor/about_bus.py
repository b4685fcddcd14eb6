"""Checks of the bus: is there a router, who is alive, who speaks with two voices, who is too slow."""

from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, fine, stops, unchecked, worse
from omnivert.messages import Health
from omnivert.wire.channels import BEARINGS, FRAME, channel_from_key

HEALTH_WITHIN_S = 2.0  # each service says how it is once a second
LEAVES_OUT = 0.2  # of the frames, without harm
NEEDED = ("vision", "calibration")
KEEPER = "storage"
ONLY_ONE = ("bridge", "player", "vision", "calibration", "storage")


def router(evidence: Evidence) -> Finding:
    refusal, bus = evidence.bus.refusal, evidence.config.bus
    if refusal is not None:
        return stops(refusal.what, refusal.because, refusal.help)
    door = f"open at {', '.join(bus.listen)}" if bus.listen else "closed (no scouting, one end point)"
    return fine(f"{bus.endpoint} answers, door {door}")


def services(evidence: Evidence) -> Finding:
    """Each of them is there, and none is frozen."""
    bus = evidence.bus
    here = {service.name for service in bus.services if service.present}
    missing = [*([] if bus.of("bridge", "player") else ["bridge"]), *(name for name in NEEDED if name not in here)]
    help = "omnivert up --config robot.toml   # starts all, and starts again what dies"
    if missing:
        names = " and ".join(missing)
        alive = ", ".join(sorted(here & set(ONLY_ONE))) or "none of them"
        return stops(f"{names} not running", f"of a robot's services there is: {alive}", help)
    silent = [s.name for s in bus.services if s.present and s.name in ONLY_ONE and s.health is None]
    if silent and bus.seconds >= HEALTH_WITHIN_S:
        names = " and ".join(sorted(silent))
        return stops(f"{names} silent for {bus.seconds:.0f} s", "running, but frozen or far too busy", help)
    if KEEPER not in here:
        return worse(f"{KEEPER} not running", "what is calibrated is not kept", help)
    return fine(", ".join(name for name in ONLY_ONE if name in here))


def publishers(evidence: Evidence) -> Finding:
    """One voice for each stream. Cameras have streams of their own, so several of a service may be right."""
    bus = evidence.bus
    reason, help = (
        "two drives, or two results, are mixed into one",
        "end all but one: omnivert monitor shows who is there",
    )
    if twice := [name for name in ONLY_ONE if name in bus.twice]:
        return stops(f"more than one {' and '.join(twice)} run under one name", reason, help)
    if bus.of("bridge") and bus.of("player"):
        return stops("bridge and player both run", reason, "end the player, or omnivert up --play REC")
    for whose, count in bus.voices.items():
        if count > 1:
            return stops(f"{count} processes publish the {whose}'s stream", reason, help)
    return fine("each stream has one publisher")


def load(evidence: Evidence) -> Finding:
    """Whether the vision keeps pace."""
    vision = next(iter(evidence.bus.of("vision")), None)
    if vision is None or vision.health is None or vision.first is None or vision.first is vision.health:
        return unchecked("the vision has not told twice how it is")
    made, left_out = _done(vision.first, vision.health)
    if made + left_out == 0:
        return unchecked("no frame came")
    latency = vision.health.latency_p99_ms
    speed = "" if latency is None else f", a result within {latency:.0f} ms (99 of 100)"
    fact = f"the vision did {made} frames and left out {left_out}{speed}"
    if left_out > LEAVES_OUT * (made + left_out):
        reason = "this machine is too slow for the camera's rate: lines are lost between frames"
        return worse(fact, reason, "set camera.frame_rate_hz lower, or vision.max_lines")
    return fine(fact)


def _done(first: Health, newest: Health) -> tuple[int, int]:
    """Bearings made and frames left out between two of the vision's health messages."""
    keys = newest.published
    made = sum(keys[key] - first.published.get(key, 0) for key in keys if channel_from_key(key) is BEARINGS)
    gone = newest.dropped
    left_out = sum(gone[key] - first.dropped.get(key, 0) for key in gone if channel_from_key(key) is FRAME)
    return made, left_out
