"""Checks of the pictures: ring, mirror, faults, and the lines in them."""

from collections import Counter

import numpy as np

from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Finding, fine, nothing, stops, unchecked, worse
from omnivert.messages import Bearings, Ring
from omnivert.vision.account import Account

SEARCHING = 20  # first frames of a recording, in which the vision may still look for the ring
FOUND = 0.5  # share of the frames
ROUND = 0.6  # share of the rim that lies on the circle
OFTEN = 0.2  # of the frames, that say the same
FEW_LINES, FEWEST_LINES = 6, 3
ONE_SIDE_DEG = 180.0
OTHERWISE_TOLD = ("ring not in the picture", "no lines")  # by other checks
HARMLESS = "the strongest"  # of many lines are kept

CURES = (  # how a reason begins or what it holds, what helps
    ("is black", "uncover the camera, or set a longer exposure"),
    ("is white", "set a shorter exposure, or turn from the sun: lines against windows are being lost"),
    ("breaks off", "look at the camera's cable: its pictures are cut off"),
    ("hardly an edge", "step back from the robot, and keep hands off the mirror"),
    ("far fewer edges", "set a shorter exposure, turn more slowly, or wipe the mirror"),
    ("", "omnivert track REC --draw DIR   # shows what is seen in a recording"),
)


def ring(evidence: Evidence) -> Finding:
    if not evidence.seen.images:
        return unchecked("the lines come from a sensor that is no camera")
    bearings, told = evidence.seen.bearings, evidence.config.ring
    if not bearings:
        return _no_bearings(evidence)
    watched = bearings[SEARCHING:] if evidence.recording and len(bearings) > 2 * SEARCHING else bearings
    rings = [frame.ring for frame in watched if _has_ring(frame, evidence)]
    found = [ring for ring in rings if ring is not None]
    if len(found) < FOUND * len(watched):
        u, v = told.center_px
        common = _reasons(watched)
        dark = next((reason for reason in common if "is black" in reason or "is white" in reason), "")
        said = f"[ring] has centre ({u:g}, {v:g}), r_max_px {told.r_max_px:g}"
        find = (
            f"omnivert setup ring {evidence.source}"
            if evidence.recording
            else "omnivert setup ring, without the bridge"
        )
        help = _cure(dark) if dark else f"{find}: finds centre and radii"
        return stops(f"ring found in {len(found)} of {len(watched)} frames", dark or said, help)
    u, v, radius = (
        _median(ring, name) for ring, name in ((found, n) for n in ("center_u_px", "center_v_px", "radius_px"))
    )
    note = Account.of(evidence.config, watched).notes().get("ring")
    if note:
        cure = f"center_px = [{u:.1f}, {v:.1f}] and r_max_px = {radius:.1f} under [ring], with r_min_px measured again"
        return worse(note, "it was found all the same, and what was found is used", cure)
    return fine(f"ring found: centre ({u:.0f}, {v:.0f}), radius {told.r_min_px:.0f} to {radius:.0f} px")


def mirror(evidence: Evidence) -> Finding:
    """How round the rim is, and whether the mirror stands upright."""
    if not evidence.seen.images:
        return unchecked("no camera")
    found = [frame.ring for frame in evidence.seen.bearings if frame.ring is not None and _has_ring(frame, evidence)]
    quality = _median(found, "quality")
    rim = f"{100.0 * quality:.0f} % of the rim lies on a circle"
    if quality < ROUND:
        help = "wipe the mirror, take away what covers its rim, and measure [ring] again"
        return worse(rim, "not round, covered, or not the rim at all", help)
    note = Account.of(evidence.config, evidence.seen.bearings).notes().get("mirror")
    if note:
        return worse(note, rim, "level the mirror and the camera above each other, if you can")
    return fine(f"{rim}, and the lines meet in its centre")


def picture(evidence: Evidence) -> Finding:
    bearings = evidence.seen.bearings
    if not evidence.seen.images:
        return unchecked("no camera")
    counts = {
        reason: times
        for reason, times in _reasons(bearings).items()
        if not reason.startswith(OTHERWISE_TOLD) and HARMLESS not in reason
    }
    most = max(counts, key=lambda reason: counts[reason], default="")
    if not most:
        return fine(f"no fault in {len(bearings)} frames")
    fact = f"{most} ({counts[most]} of {len(bearings)} frames)"
    return worse(fact, "lines are being lost", _cure(most)) if counts[most] > OFTEN * len(bearings) else fine(fact)


def lines(evidence: Evidence) -> Finding:
    bearings = evidence.seen.bearings
    if not bearings:
        return _no_bearings(evidence)
    counts = np.array([_still(frame).size for frame in bearings])
    low, middle, high = (int(value) for value in np.percentile(counts, (10, 50, 90)))
    fact = f"{middle} lines a frame (mostly {low} to {high})"
    if not evidence.seen.images:
        tracks = np.unique(np.concatenate([frame.track_id for frame in bearings])).size
        return fine(f"{tracks} lines in all, {counts.mean():.1f} at a time")
    help = "drive where there are doors, shelves, corners: vertical edges within a few metres, on all sides"
    if middle < FEWEST_LINES:
        return stops(fact, "fewer than three lines say nothing of the camera's place", help)
    if middle < FEW_LINES:
        return worse(fact, "the more lines, the sooner the place is known", help)
    return fine(fact)


def spread(evidence: Evidence) -> Finding:
    if not evidence.seen.images:
        return unchecked("no camera: not all lines are told at one time")
    gaps = [_widest_gap(_still(frame)) for frame in evidence.seen.bearings]
    gap = float(np.degrees(np.median(gaps)))
    fact = f"the widest direction without a line is {gap:.0f} deg"
    if gap >= ONE_SIDE_DEG:
        reason = "all lines are on one side: a way and a turn look alike there"
        help = "turn the robot between walls, or take away what covers half of the mirror"
        return worse(fact, reason, help)
    return fine(fact)


def _no_bearings(evidence: Evidence) -> Finding:
    if evidence.recording:
        return nothing("no frame could be used")
    if evidence.bus.is_over:
        return nothing("the recording has been played to its end")
    return stops(f"no bearings for {evidence.bus.seconds:.0f} s", "the vision says nothing", "omnivert monitor")


def _has_ring(frame: Bearings, evidence: Evidence) -> bool:
    return frame.ring is not None and frame.ring.quality >= evidence.config.vision.ring_min_quality


def _reasons(bearings: tuple[Bearings, ...]) -> dict[str, int]:
    """Frames with each reason, the most frequent first; numbers in them are told as in the last one."""
    kinds: Counter[str] = Counter()
    text: dict[str, str] = {}
    for frame in bearings:
        found = {"".join(c for c in reason if not c.isdecimal()): reason for reason in frame.reasons}
        kinds.update(found.keys())
        text.update(found)
    return {text[kind]: times for kind, times in kinds.most_common()}


def _cure(reason: str) -> str:
    return next(cure for sign, cure in CURES if sign in reason)


def _still(frame: Bearings) -> np.ndarray:
    """Bearings of the lines that do not move (N,)."""
    return frame.bearing_rad if frame.looks is None else frame.bearing_rad[frame.looks.moving == 0]


def _widest_gap(bearing: np.ndarray) -> float:
    """Between neighbouring bearings, around; rad."""
    if bearing.size < 2:
        return float(2.0 * np.pi)
    around = np.sort(bearing)
    return float(max(np.diff(around).max(), 2.0 * np.pi - (around[-1] - around[0])))


def _median(rings: list[Ring], name: str) -> float:
    return float(np.median([getattr(ring, name) for ring in rings]))
