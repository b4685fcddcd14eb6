"""Checks of what is wired how, of what the wheels measure and when, and of the calibration itself."""

import numpy as np

from omnivert.calibration.solver.wiring import MIRRORED
from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, fine, stops, unchecked, worse
from omnivert.doctor.pushed import ENOUGH_RAD, Movement
from omnivert.doctor.turning import Turning, Wiring
from omnivert.messages import Correction, State
from omnivert.pictures.words import word

MOTION, TURN = "a straight metre and a turn of 30 deg", "a turn of 30 deg"
NO_WIRING = "no wiring explains the turns, see wheels"
STANDS_STILL = 0.02  # of the other wheel's way
MOVED_M = 0.1
OFF_SCALE, FAR_OFF_SCALE = 0.05, 0.3  # by so much do wheels and picture turn differently
SURE = 3.0  # sigmas
KNOWN_SCALE = 0.03
LATE_S = 0.1  # the calibration takes off what it finds; so much is a wrong setting
KNOWN_LATE_S = 0.05
RATIO = 0.02  # of the wheels' diameters


def wheels(evidence: Evidence) -> Finding:
    """Both wheels count, alike, and forward when the robot goes forward."""
    if evidence.pushed is not None:
        return _pushed_straight(evidence, evidence.pushed.straight)
    turning = evidence.seen.turning
    if turning is None:
        return _needs(MOTION, evidence)
    if (still := _still_wheel(turning)) and Wiring.AS_CONFIGURED not in turning.wirings:
        other = turning.driven_m[still == "right"]
        fact = f"the {still} wheel's counts stand still, the other one's went {other:.2f} m"
        return stops(fact, "its encoder, or the wire of it, is dead", f"look at the {still} encoder's plug")
    match turning.wirings:
        case ():
            reason = "neither a reversed wheel nor a mirrored picture explains it"
            help = "look at slipping wheels, at people around the robot, and at encoder.ticks_per_rev"
            return worse("wheels and picture do not turn together", reason, help)
        case (Wiring.LEFT_BACKWARDS,) | (Wiring.RIGHT_BACKWARDS,) as found:
            return _backwards(evidence, "left" if found[0] is Wiring.LEFT_BACKWARDS else "right")
        case (Wiring.LEFT_BACKWARDS, Wiring.RIGHT_BACKWARDS):
            reason = "the wheels tell a turn that the picture does not show"
            help = "omnivert doctor --push   # tells which one"
            return stops("one wheel counts backwards", reason, help)
        case found if set(found) <= {Wiring.AS_CONFIGURED, Wiring.MIRRORED}:
            right, left = turning.driven_m
            return fine(f"both wheels count the same way: right {right:.2f} m, left {left:.2f} m")
        case _:
            return _needs(MOTION, evidence)


def sense(evidence: Evidence) -> Finding:
    """The bearings run against the turn."""
    if evidence.pushed is not None:
        return _pushed_turn(evidence, evidence.pushed.turn)
    turning = evidence.seen.turning
    if turning is None:
        return _needs(TURN, evidence)
    if not turning.wirings:
        return unchecked(NO_WIRING)
    match turning.wirings:
        case (Wiring.AS_CONFIGURED,):
            compared = np.degrees(turning.wheels_rad)
            return fine(f"bearings run against the turn, as they should ({compared:.0f} deg compared)")
        case (Wiring.MIRRORED,):
            help = (
                f"camera.bearing_sign = {-evidence.config.camera.bearing_sign}; omnivert doctor --push tells for sure"
            )
            return stops("bearings run with the turn", MIRRORED, help)
        case _:
            return _needs(TURN, evidence)


def turns(evidence: Evidence) -> Finding:
    """Wheels and picture turn by the same angle."""
    turning, base = evidence.seen.turning, evidence.config.robot.wheel_base_m
    if turning is not None and not turning.wirings:
        return unchecked(NO_WIRING)
    if turning is None or turning.scale is None or turning.scale[1] > KNOWN_SCALE:
        return _needs(TURN, evidence)
    scale, std = turning.scale
    fact = f"where the wheels tell 90 deg the picture turns by {90.0 * scale:.1f} ± {90.0 * std:.1f} deg"
    if abs(scale - 1.0) <= OFF_SCALE + SURE * std:
        return fine(fact)
    reason = f"robot.wheel_base_m = {base:g} does not fit the wheels: {base / scale:.3f} would, or other counts a turn"
    help = "measure robot.wheel_base_m, encoder.wheel_diameter_m and encoder.ticks_per_rev again"
    return (stops if abs(np.log(max(scale, 1e-3))) > FAR_OFF_SCALE else worse)(fact, reason, help)


def offset(evidence: Evidence) -> Finding:
    """How late the camera's stamps are against the wheels'."""
    found = _correction(evidence, "time_offset")
    turning = evidence.seen.turning
    if found is not None and found.std <= KNOWN_LATE_S and found.freed:
        late, std = found.value, found.std
    elif turning is not None and turning.late_s is not None and turning.late_s[1] <= KNOWN_LATE_S:
        late, std = turning.late_s
    else:
        return _needs("a turn that begins or ends", evidence)
    fact = f"the camera's stamps are {1e3 * late:+.0f} ± {1e3 * std:.0f} ms late against the wheels'"
    if abs(late) <= LATE_S + SURE * std:
        return fine(fact)
    delay = evidence.config.camera.stamp_delay_s + late
    if delay < 0.0:
        return worse(
            fact, "the wheel counts come late", "look at the encoder board's clock: deploy/encoder-protocol.md"
        )
    reason = "it is found and taken off, but from one start to the next it may change"
    return worse(fact, reason, f"camera.stamp_delay_s = {delay:.3f}")


def calibration(evidence: Evidence) -> Finding:
    """What the calibration itself makes of it."""
    told = evidence.told
    if told is None:
        if evidence.recording or evidence.bus.is_over or not evidence.seen.frames.count:
            return unchecked("nothing to calibrate from")
        return stops(
            f"no estimate for {evidence.bus.seconds:.0f} s", "the calibration says nothing", "omnivert monitor"
        )
    ratio = _correction(evidence, "wheel_ratio")
    why = f": {told.why}" if told.why else ""
    match told.state:
        case State.INVALID:
            return stops(f"the data contradict the model{why}", "no mount explains them", "omnivert explain OV106")
        case State.MOVED:
            return worse(f"the camera was knocked{why}", "it is calibrated anew", told.todo or "omnivert explain OV107")
        case State.NOT_YET | State.WAITING if evidence.recording:
            reason = told.why or "the drive does not show the mount"
            return stops("this drive does not show the mount", reason, told.todo)
        case _ if ratio is not None and ratio.freed and abs(ratio.value - 1.0) > RATIO + SURE * ratio.std:
            fact = f"the right wheel is {100.0 * (ratio.value - 1.0):+.1f} % larger than the left one"
            return worse(fact, "it is found and allowed for", "look at the tyres: one may be flat or worn")
        case _:
            next_ = f"; next: {told.todo}" if told.todo else ""
            return fine(f"{word(told.state)}{why}{next_}")


def _needs(motion: str, evidence: Evidence) -> Finding:
    """The robot has not moved so that this can be told."""
    if evidence.recording:
        return unchecked(f"needs {motion}, which this recording does not show")
    return unchecked(f"needs {motion}: drive meanwhile, or omnivert doctor --push")


def _pushed_straight(evidence: Evidence, way: Movement) -> Finding:
    told = f"right {way.right_m:+.2f} m, left {way.left_m:+.2f} m while pushed forward"
    ways = {"right": way.right_m, "left": way.left_m}
    for name, other in (("left", "right"), ("right", "left")):
        if abs(ways[name]) < STANDS_STILL * abs(ways[other]):
            help = f"look at the {name} encoder's plug"
            return stops(told, f"the {name} wheel's counts stand still: its encoder, or the wire of it, is dead", help)
    wrong = [name for name, metres in ways.items() if metres < 0.0]
    if not wrong:
        return fine(told)
    encoder = evidence.config.encoder
    lines = " and ".join(f"encoder.{name}_sign = {-getattr(encoder, f'{name}_sign')}" for name in wrong)
    which = "both wheels count" if len(wrong) == 2 else f"the {wrong[0]} wheel counts"
    return stops(told, f"{which} backwards", lines)


def _pushed_turn(evidence: Evidence, turn: Movement | None) -> Finding:
    """After a straight push that was right: to the left, as asked for."""
    if turn is None:
        return unchecked("the turn did not come: push straight, let it stand, then turn it left")
    wheels_rad = (turn.right_m - turn.left_m) / evidence.config.robot.wheel_base_m
    picture_rad = turn.picture_rad
    told = f"wheels {np.degrees(wheels_rad):+.0f} deg, picture {np.degrees(picture_rad):+.0f} deg while turned left"
    if abs(wheels_rad) < ENOUGH_RAD or abs(picture_rad) < 0.5 * ENOUGH_RAD:
        return unchecked(f"{told}: too little")
    if (wheels_rad > 0.0) == (picture_rad > 0.0):
        return fine(told if wheels_rad > 0.0 else told.replace("turned left", "turned right"))
    if wheels_rad < 0.0:
        return stops(told, "the wheels' sides are swapped", "swap the encoders' plugs, left for right")
    help = f"camera.bearing_sign = {-evidence.config.camera.bearing_sign}"
    return stops(told, "the bearings run with the turn: the picture is a mirror image", help)


def _backwards(evidence: Evidence, wheel: str) -> Finding:
    sign = -getattr(evidence.config.encoder, f"{wheel}_sign")
    reason = "the picture turns when the wheels tell a straight way, and the other way round"
    return stops(f"the {wheel} wheel counts backwards", reason, f"encoder.{wheel}_sign = {sign}")


def _still_wheel(turning: Turning) -> str:
    right, left = turning.driven_m
    if max(right, left) < MOVED_M:
        return ""
    return "right" if right < STANDS_STILL * left else "left" if left < STANDS_STILL * right else ""


def _correction(evidence: Evidence, name: str) -> Correction | None:
    told = evidence.told
    return None if told is None else next((c for c in told.corrections if c.name == name), None)
