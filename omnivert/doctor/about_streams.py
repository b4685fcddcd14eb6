"""Checks of what the sensors send: how often, how evenly, and by which clock."""

from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, fine, nothing, stops, worse
from omnivert.doctor.losses import Losses
from omnivert.doctor.stream import Stream

FAR_TOO_SLOW = 0.7  # of the rate that was asked for
SLOWEST_HZ = 1.0  # below it lines are hardly followed
REPEATED = 0.2  # of the stamps
MISSING = 0.1
APART_S = 1.0  # ages of two sensors' stamps, of one clock
AHEAD_S = 0.01
TOGETHER_S = 5.0  # pauses of two streams that are one


def frames(evidence: Evidence) -> Finding:
    stream, camera = evidence.seen.frames, evidence.config.camera
    what = "frames" if evidence.seen.images else "frames of bearings"
    if stream.count < 2:
        return _silence(evidence, what, "camera", f"camera.source, which is {camera.source}")
    if stream.repeated > REPEATED * stream.count:
        fact = f"{stream.repeated} of {stream.count} stamps are not after the one before"
        reason = "the camera's stamps stand still: such frames are refused"
        return stops(
            fact, reason, "plug the camera in again; another driver, or another camera.source, may stamp right"
        )
    expected = camera.frame_rate_hz if evidence.configured and evidence.seen.images else None
    rate = f"{stream.rate_hz:.1f} Hz" + (f" of {expected:.1f} expected" if expected else "")
    fact = f"{what}: {rate}, longest gap {1e3 * stream.longest_gap_s:.0f} ms, {_lost(stream)}"
    due = expected * stream.seconds - stream.count if expected else 0.0
    cause = Losses.of("camera", stream, evidence).cause(max(stream.lacking, due))
    if evidence.seen.images and stream.rate_hz < SLOWEST_HZ:
        help = f"set camera.frame_rate_hz, which is {camera.frame_rate_hz:g}, and lower the exposure"
        return stops(fact, "lines are not followed from frame to frame", help)
    if expected and stream.rate_hz < FAR_TOO_SLOW * expected:
        slow = "too few" if cause else "dim light makes cameras slower, and so does a crowded USB bus"
        return _blamed(fact, slow, cause, "give more light, or set camera.frame_rate_hz to what the camera does")
    if evidence.seen.images and stream.missing > MISSING:
        share = f"{100.0 * stream.missing:.0f} % of them are missing between the others"
        return _blamed(fact, share, cause, "look at the cable, and at what else the USB bus carries")
    return fine(fact)


def ticks(evidence: Evidence) -> Finding:
    stream, encoder = evidence.seen.ticks, evidence.config.encoder
    if stream.count < 2:
        return _silence(evidence, "wheel counts", "encoder", f"encoder.port, which is {encoder.port}")
    fact = f"wheel counts: {stream.rate_hz:.1f} Hz, longest gap {1e3 * stream.longest_gap_s:.0f} ms, {_lost(stream)}"
    if stream.repeated > REPEATED * stream.count:
        reason = f"{stream.repeated} of {stream.count} stamps are not after the one before"
        return stops(fact, reason, "look at the time that the encoder board sends: deploy/encoder-protocol.md")
    due = evidence.seen.frames.count - stream.count
    cause = Losses.of("encoder", stream, evidence).cause(max(stream.lacking, due))
    if evidence.seen.blind_s > encoder.max_gap_s:
        gap = f"the wheels turned in a gap above encoder.max_gap_s = {encoder.max_gap_s:g} s: its way is unknown"
        return _blamed(fact, gap, cause, "let the encoder board send every 20 ms, and look at its cable")
    if stream.rate_hz < evidence.seen.frames.rate_hz:
        few = "there are fewer of them than frames: the way between is guessed"
        return _blamed(fact, few, cause, "let the encoder board send every 20 ms")
    return fine(fact)


def clock(evidence: Evidence) -> Finding:
    """Both streams are stamped by one clock, and nobody has set it."""
    one, other = evidence.seen.frames, evidence.seen.ticks
    help = "stamp both with one monotonic clock, as the bridge does; then record or import again"
    if one.age_s is not None and other.age_s is not None:
        return _live_clock(evidence, one, other, one.age_s, other.age_s)
    (first, last), (begin, end) = one.span_ns, other.span_ns
    inside = int(((one.stamp_ns >= begin) & (one.stamp_ns <= end)).sum())
    if inside < 0.5 * one.count:
        spans = (
            f"frames {1e-9 * first:.1f} to {1e-9 * last:.1f} s, wheel counts {1e-9 * begin:.1f} to {1e-9 * end:.1f} s"
        )
        return stops(f"{inside} of {one.count} frames lie between wheel counts", f"two clocks: {spans}", help)
    jumps, others = one.jumps() if evidence.seen.images else [], other.jumps()
    alone = [(*jump, "the camera's stamps") for jump in jumps if _is_alone(jump, others)]
    alone += [(*jump, "the wheel counts' stamps") for jump in others if _is_alone(jump, jumps)]
    start = min(first, begin)
    if alone and evidence.seen.images:
        at, size, whose = alone[0]
        fact = f"{whose} jump by {size:.0f} s at {1e-9 * (at - start):.1f} s, the other sensor's do not"
        if abs(last - end) < 1e9 * TOGETHER_S:
            return worse(fact, "one sensor was away for so long", "look at its cable")
        return stops(fact, "one clock was set, or one sensor ended early", help)
    if jumps:
        at, size = jumps[0]
        fact = f"all stamps jump by {size:.0f} s at {1e-9 * (at - start):.1f} s"
        return worse(fact, "the clock was set, or the recording paused: all lines begin anew there", help)
    return fine(f"one clock: {inside} of {one.count} frames lie between wheel counts, no jump")


def _live_clock(evidence: Evidence, one: Stream, other: Stream, age_s: float, other_age_s: float) -> Finding:
    help = "let the bridge stamp both, and the camera's driver not; a recording: import it again"
    apart = age_s - other_age_s
    if abs(apart) > APART_S:
        fact = f"frames are stamped {apart:+.1f} s against the wheel counts of the same moment"
        return stops(fact, "two clocks", help)
    if evidence.bus.playing:
        return fine("one clock: frames and wheel counts of one moment come together")
    if not -AHEAD_S <= age_s <= APART_S or not -AHEAD_S <= other_age_s <= APART_S:
        fact = f"frames are {age_s:.2f} s old when they are published, wheel counts {other_age_s:.2f} s"
        return stops(fact, "these are stamps of another clock than the bridge's", help)
    steps = [*one.clock_steps(), *other.clock_steps()]
    if steps:
        return worse(f"stamps jump by {steps[0]:+.1f} s", "a clock is being set while the robot drives", help)
    return fine(f"one clock; frames are {1e3 * age_s:.0f} ms old, wheel counts {1e3 * other_age_s:.0f} ms")


def _is_alone(jump: tuple[int, float], others: list[tuple[int, float]]) -> bool:
    return not any(abs(jump[0] - other[0]) < 1e9 * TOGETHER_S for other in others)


def _blamed(fact: str, what: str, cause: tuple[str, str] | None, otherwise: str) -> Finding:
    """
    cause      reason and help where the device is not to blame
    otherwise  help where it is
    """
    if cause is None:
        return worse(fact, what, otherwise)
    return worse(fact, f"{what}; {cause[0]}", cause[1])


def _lost(stream: Stream) -> str:
    return f"{stream.lost} lost" if stream.sent_ns.size else f"{100.0 * stream.missing:.0f} % missing"


def _silence(evidence: Evidence, what: str, device: str, setting: str) -> Finding:
    """Why nothing comes."""
    bus = evidence.bus
    if evidence.recording:
        help = f"omnivert record drive.mcap, with the {device} running"
        return stops(f"no {what} in this recording", "the calibration needs both sensors", help)
    if not bus.of("bridge", "player"):
        return nothing("no bridge runs that could publish them")
    if bus.is_over:
        return nothing("the recording has been played to its end")
    if bus.playing and not (bus.of("vision") and bus.of("calibration")):
        return nothing("the playback waits for the services that are missing")
    return stops(
        f"no {what} for {bus.seconds:.0f} s", f"the {device} is silent", f"look at its cable, and at {setting}"
    )
