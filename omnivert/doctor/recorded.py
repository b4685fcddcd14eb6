"""Evidence from a recording: the vision over all of it, one solution over all of that, no process and no bus."""

from collections.abc import Callable

import numpy as np

from omnivert.calibration.sighting import clean_sighting
from omnivert.calibration.solver.batch import Batch
from omnivert.calibration.solver.result import Outcome
from omnivert.calibration.solver.stretch import Keyed
from omnivert.calibration.way import Way
from omnivert.config import Calibration, Config
from omnivert.doctor.evidence import Evidence, Seen, Told
from omnivert.doctor.host import this_host
from omnivert.doctor.stream import Stream
from omnivert.doctor.turning import Wiring
from omnivert.messages import Bearings, Frame, State, Ticks
from omnivert.odometry import SECOND
from omnivert.offline import tracked
from omnivert.wire.channels import FRAME
from omnivert.wire.recording import Recording


def recorded(recording: Recording, config: Config, source: str, moved: Callable[[], None] = lambda: None) -> Evidence:
    """
    config  with the recording's own rig in it
    moved   called for each frame that is done
    """
    stamps: list[int] = []
    ticks: list[Ticks] = []
    bearings: list[Bearings] = []
    images = FRAME.key(config) in recording.counts
    for _, message in recording.messages(types=(Frame if images else Bearings, Ticks)):
        match message:
            case Frame():
                stamps.append(message.stamp_ns)
            case Ticks():
                ticks.append(message)
            case Bearings():
                stamps.append(message.stamp_ns)
                bearings.append(message)
    for frame in tracked(recording, config) if images else ():
        bearings.append(frame)
        moved()
    wheels = Stream.recorded([t.stamp_ns for t in ticks])
    seen = Seen.of(config, Stream.recorded(stamps), (wheels, ticks), bearings, images)
    return Evidence(config, source, True, True, this_host(), seen, told(config, seen, ticks))


def told(config: Config, seen: Seen, ticks: list[Ticks]) -> Told | None:
    """What the calibration can make of the drive; None where it has nothing to work on, or a wrong wiring is known."""
    turning = seen.turning
    wrong = turning is not None and turning.wirings and Wiring.AS_CONFIGURED not in turning.wirings
    if wrong or not ticks or not seen.bearings:
        return None
    outcome = solved(config, seen.bearings, ticks)
    return judged(outcome, config.calibration)


def solved(config: Config, bearings: tuple[Bearings, ...], ticks: list[Ticks]) -> Outcome:
    """The keyframes of a whole drive, solved together; a long drive a window at a time."""
    way, batch = Way(config), Batch(config)
    for message in ticks:
        way.push(message)
    floor = np.deg2rad(config.calibration.bearing_floor_deg)
    for frame in bearings:
        motion, _ = way.step(frame.stamp_ns)
        if motion is None or not way.is_at_keyframe:
            continue
        sighting, _ = clean_sighting(frame, floor)
        batch.append(Keyed(frame.stamp_ns / SECOND, way.take_key(), sighting.track, sighting.beta, sighting.std))
        if batch.size >= config.calibration.window_keyframes:
            batch.solve()
    return batch.solve()


def judged(outcome: Outcome, limits: Calibration) -> Told:
    """One state for the whole drive; when results hold over a drive that goes on, only `omnivert calibrate` says."""
    result = outcome.result
    if outcome.wrong:
        return Told(State.INVALID, f"the drive only makes sense if {outcome.wrong}", "")
    if result is None:
        if len(outcome.centres) < 2:
            kinds = outcome.centres[0].kind.value if outcome.centres else "hardly any"
            why = f"the drive shows one kind of motion only ({kinds}), and the mount needs two"
            return Told(State.NOT_YET, why, "Turn by 90 deg on the spot, then drive 0.7 m straight.")
        if outcome.share < limits.invalid_inliers:
            share = f"{100.0 * outcome.share:.0f} %"
            return Told(State.INVALID, f"no mount explains more than {share} of the bearings", "")
        return Told(State.NOT_YET, "several mounts explain the drive about equally well", "Drive on, and turn more.")
    sigma = np.sqrt(np.diag(result.honest_covariance))
    limit = np.array([np.deg2rad(limits.sigma_limit_deg), limits.sigma_limit_m, np.deg2rad(limits.sigma_limit_deg)])
    sizes = f"sigmas {np.degrees(sigma[0]):.2g} deg, {1e3 * sigma[1]:.2g} mm, {np.degrees(sigma[2]):.2g} deg"
    if (sigma <= limit).all():
        return Told(State.CALIBRATED, sizes, "", result.told)
    seen = State.USABLE if (sigma <= limits.usable_limits * limit).all() else State.NOT_YET
    return Told(
        seen,
        f"{sizes}; the limits are {limits.sigma_limit_deg:g} deg, {1e3 * limits.sigma_limit_m:g} mm",
        result.todo.text,
        result.told,
    )
