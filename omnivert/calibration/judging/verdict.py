"""What may be claimed of each parameter, why not more, and what to drive next."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.manoeuvre import DRIVE, TURN, TURN_AND_DRIVE, Manoeuvre, within
from omnivert.calibration.judging.observability import Kind, Piece, Seen, Unseen
from omnivert.calibration.kalman.model import cartesian_from_polar
from omnivert.config import Calibration
from omnivert.messages import ParameterVerdict, State

Array = NDArray[np.float64]

ODOMETER_UNITS = "rho is in odometer units: bearings can not show whether both wheels are larger than configured"
FAINT = "the lines are too far away or too few for this way"
DOUBTED = (
    "because parts of the drive contradict each other, or clocks and wheels are far from what is configured: "
    "sigmas are widened by that; check the wheel base, the wheels' diameter and the clocks"
)


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What a verdict looks at."""

    frames: int
    lines: int  # in the newest frame that had any
    ticks: bool
    driven_m: float
    turned_rad: float
    centres: tuple[Piece, ...]  # clearly different centres of rotation
    covariance: Array | None  # (3, 3) phi, rho, psi, as may be claimed; None without a single clear solution
    rho_m: float
    disagreement: float  # of the halves of the drive, chi-square of 3 degrees of freedom
    sum_rad: float | None  # sigma of phi + psi
    contradicted: str  # why the data contradict the model; empty when they do not
    restored: bool  # the mount is a stored one: what this drive has shown says nothing against it
    filter_off: float = 0.0  # filter against smoother, in sigmas
    moved: str = ""  # what the watchdog has noticed; as long as the camera is not calibrated anew
    seen: Seen | None = None  # None: judged by the centres of rotation alone
    todo: Manoeuvre | None = None  # what would help most; None: not evaluated
    gap: float = np.inf  # -2 log likelihood to the next best, different solution
    inlier_share: float = 1.0
    steady: int = 10_000  # keyframes over which results have agreed with each other
    doubted: bool = False  # whether sigmas of this drive are no measure
    phi_rad: float | None = None  # with rho, where the camera is; None: only its distance is known


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    state: State
    phi: ParameterVerdict
    rho: ParameterVerdict
    psi: ParameterVerdict
    next_manoeuvre: str
    brings: str = ""  # what the next manoeuvre is foreseen to bring: "phi 3.8 -> 0.6 deg"
    notes: tuple[str, ...] = ()  # what a number means


class Condition(StrEnum):
    """What must hold beside a parameter's own sigma before it is claimed."""

    SOUND = "sound"  # the covariance is one
    NEAR = "near"  # rho is one that the robot has room for
    CENTRES = "centres"  # two clearly different centres of rotation
    OFF_CENTRE = "off_centre"  # the camera does not sit in a centre of rotation that the claim needs
    CLEAR = "clear"  # no different mount explains the drive about as well
    INLIERS = "inliers"  # nearly all bearings agree
    HALVES = "halves"  # so do the halves of the drive
    STEADY = "steady"  # and it has stood the drive that followed
    FILTER = "filter"  # so do filter and smoother
    TOGETHER = "together"  # phi, rho and psi lean on each other: none is claimed while another is beyond its limit


def unmet(shown: Shown, limits: Calibration, before: State = State.NOT_YET) -> dict[Condition, str]:
    """The conditions that do not hold, and why; of a stored mount only those that this drive can speak to."""
    found: dict[Condition, str] = {}
    sigma = _sigmas(shown.covariance)
    if sigma is None:
        found[Condition.SOUND] = "because its covariance is not one: the calibration starts anew"
        return found
    if not 0.0 <= shown.rho_m <= limits.max_rho_m:
        found[Condition.NEAR] = f"because rho = {shown.rho_m:.2f} m is not within 0 and {limits.max_rho_m:.2f} m"
    if not shown.filter_off <= limits.max_filter_off:
        found[Condition.FILTER] = f"because filter and smoother differ by {shown.filter_off:.1f} sigmas"
    if (sigma > limits.lean_limits * _hold(limits, before) * _limit(limits)).any():
        found[Condition.TOGETHER] = "because it depends on the others, which are not known well enough"
    if shown.restored:
        return found
    if len(shown.centres) < 2:
        found[Condition.CENTRES] = _poor(shown)[0]
    elif Condition.NEAR not in found and (trap := _trap(shown, limits)) is not None:
        found[Condition.OFF_CENTRE] = (
            f"because the camera seems to sit {_where(trap)}, where such a drive puts any camera"
        )
    if not shown.gap > limits.clear_gap:
        found[Condition.CLEAR] = "because another mount explains the drive about equally well"
    if not shown.inlier_share >= limits.clear_inliers:
        share = 100.0 * shown.inlier_share
        found[Condition.INLIERS] = f"because only {share:.0f} % of the bearings agree with it"
    if shown.steady < limits.steady_keyframes:
        found[Condition.STEADY] = "because it is new: it must hold over a little more of the drive"
    if not shown.disagreement <= limits.max_disagreement:
        found[Condition.HALVES] = "because the two halves of the drive do not agree about it"
    return found


def verdict(shown: Shown, limits: Calibration, before: State) -> Verdict:
    """Each parameter's state; a claim once made holds until sigma is `hold_limits` times its limit."""
    longest = limits.longest_straight_m, limits.longest_turn_deg
    todo = shown.todo or within(TURN_AND_DRIVE, *longest)
    if shown.moved:
        return _all(State.MOVED, shown.moved, todo)
    if not shown.restored and (shown.frames == 0 or not shown.ticks or (shown.covariance is None and shown.lines == 0)):
        return _all(State.WAITING, _missing(shown), within(DRIVE, *longest))
    if shown.contradicted:
        return _all(State.INVALID, shown.contradicted, within(TURN_AND_DRIVE, *longest))
    poor, fallback = ("", TURN_AND_DRIVE) if shown.restored else _poor(shown)
    poor = poor or (DOUBTED if shown.doubted and not shown.restored else "")
    todo = shown.todo or within(fallback, *longest)
    faint = "" if poor or shown.restored else _faint(shown)
    sigma = _sigmas(shown.covariance)
    if shown.covariance is None or sigma is None:
        several = "because several mounts explain the drive so far about equally well"
        broken = unmet(shown, limits).get(Condition.SOUND, several) if shown.covariance is not None else several
        return _all(State.NOT_YET, poor or f"{broken}{faint}", todo)
    against = unmet(shown, limits, before)
    limit = _limit(limits)
    states = [
        _state(float(s), float(b), _hold(limits, before), limits, bool(poor)) for s, b in zip(sigma, limit, strict=True)
    ]
    reasons = ["", "", ""]
    # Of a camera on the axis, phi has no meaning: what is not apart from zero is not claimed.
    on_axis = shown.rho_m < limits.apart_sigmas * float(sigma[1])
    for k, state in enumerate(states):
        if state is State.CALIBRATED and (against or (on_axis and k != 1)):
            states[k] = State.USABLE
        if states[k] is not State.CALIBRATED:
            reasons[k] = poor or f"{_why(k, shown, sigma, limit, against)}{faint}"
    order = (State.NOT_YET, State.USABLE, State.CALIBRATED)
    overall = min(states, key=order.index)
    parts = [ParameterVerdict(state, reason) for state, reason in zip(states, reasons, strict=True)]
    notes = () if states[1] is State.NOT_YET else (ODOMETER_UNITS,)
    if overall is State.CALIBRATED:
        return Verdict(overall, parts[0], parts[1], parts[2], "", "", notes)
    return Verdict(overall, parts[0], parts[1], parts[2], todo.text, todo.brings, notes)


def paper_verdict() -> Verdict:
    """The filter as printed is shown, never claimed: its sigmas hold only where D of every line is known to 10 %."""
    reason = (
        "because the filter as printed (mode paper) needs each line's distance to about 10 % for its sigmas to hold"
    )
    return _all(State.NOT_YET, reason, None)


def _limit(limits: Calibration) -> Array:
    return np.array([np.deg2rad(limits.sigma_limit_deg), limits.sigma_limit_m, np.deg2rad(limits.sigma_limit_deg)])


def _hold(limits: Calibration, before: State) -> float:
    return limits.hold_limits if before is State.CALIBRATED else 1.0


def _sigmas(covariance: Array | None) -> Array | None:
    """(3,) None when it is no covariance."""
    if covariance is None or not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0.0:
        return None
    return np.asarray(np.sqrt(np.diag(covariance)), dtype=np.float64)


def _state(sigma: float, limit: float, hold: float, limits: Calibration, poor: bool) -> State:
    if poor or sigma > limits.usable_limits * limit:
        return State.NOT_YET
    return State.CALIBRATED if sigma <= hold * limit else State.USABLE


def _trap(shown: Shown, limits: Calibration) -> Piece | None:
    """The centre of rotation that the camera can not be told from, when fewer than two others are left.

    A fit slides along the valley of one centre into it, and there takes noise for certainty. What the motion about a
    centre says is worth nothing to a camera that sits in it; two other centres do without.
    """
    if shown.covariance is None or len(shown.centres) > 2:
        return None
    if shown.phi_rad is None:  # at most the axis can be compared with
        near = shown.rho_m < limits.apart_sigmas * float(np.sqrt(shown.covariance[1, 1]))
        return next((p for p in shown.centres if p.kind is Kind.TURN and near), None)
    rho = max(shown.rho_m, 1e-6)
    mount, slope = cartesian_from_polar(np.array([shown.phi_rad, rho, 0.0]))
    spread = (slope @ shown.covariance @ slope.T)[1:, 1:] + 1e-12 * np.eye(2)
    for piece in shown.centres:
        if piece.kind is Kind.STRAIGHT:
            continue
        off = mount[1:] - piece.centre_m
        if float(off @ np.linalg.solve(spread, off)) < limits.apart_sigmas**2:
            return piece
    return None


def _where(piece: Piece) -> str:
    if piece.kind is Kind.TURN:
        return "on the axis that the robot turned about"
    return f"in the centre of the circle of {abs(float(piece.centre_m[1])):.2f} m radius"


def _poor(shown: Shown) -> tuple[str, Manoeuvre]:
    """Which combination this drive can not show, and what would; empty when there is none."""
    if shown.driven_m < 0.2 and shown.turned_rad < np.deg2rad(20.0):
        turned = np.degrees(shown.turned_rad)
        return f"because the robot has only moved {shown.driven_m:.2f} m and turned {turned:.0f} deg", TURN_AND_DRIVE
    if not shown.centres:
        return "because the robot has hardly moved, nothing is seen", TURN_AND_DRIVE
    nothing = shown.seen is not None and shown.seen.is_nothing
    if len(shown.centres) >= 2:
        return (f"because {FAINT}, nothing is seen" if nothing else "", TURN_AND_DRIVE)
    piece = shown.centres[0]
    known = "" if shown.seen is None and shown.sum_rad is None else _known(shown, piece)
    match piece.kind:
        case Kind.STRAIGHT:
            way, only, cure = f"drove straight for {shown.driven_m:.1f} m", "phi and psi are seen only as a sum", TURN
        case Kind.TURN:
            way = f"only turned on the spot, by {np.degrees(shown.turned_rad):.0f} deg"
            only, cure = "only psi is seen", DRIVE
        case Kind.CIRCLE:
            way = f"drove one circle of {abs(float(piece.centre_m[1])):.2f} m radius"
            only, cure = "only the camera's heading relative to the direction from its centre is seen", DRIVE
    if nothing:
        return f"because you {way}, among lines too far away or too few, nothing is seen", cure
    return f"because you {way}, {only}{known}", cure


def _faint(shown: Shown) -> str:
    """What is behind any reason where the place is seen roughly, but no direction to its limit."""
    faint = shown.seen is not None and shown.seen.unseen is Unseen.EVERYTHING
    return f"; {FAINT}" if faint else ""


def _known(shown: Shown, piece: Piece) -> str:
    sigma = shown.sum_rad if shown.seen is None and piece.kind is Kind.STRAIGHT else None
    if shown.seen is not None:
        sigma = shown.seen.to_centre_rad
    return "" if sigma is None or sigma > 0.1 else f" (known to {_degrees(sigma)})"


def _why(k: int, shown: Shown, sigma: Array, limit: Array, against: dict[Condition, str]) -> str:
    """Why parameter k is seen, but not claimed."""
    for condition, reason in against.items():
        if condition is not Condition.TOGETHER:
            return reason
    if sigma[k] <= limit[k]:
        return against.get(Condition.TOGETHER, "because the camera can not be told from one on the robot's axis")
    is_text = f"{1e3 * sigma[k]:.2g} mm" if k == 1 else _degrees(float(sigma[k]))
    limit_text = f"{1e3 * limit[k]:.3g} mm" if k == 1 else f"{np.degrees(limit[k]):.3g} deg"
    sum_known = "" if shown.sum_rad is None or shown.sum_rad > 0.1 else f" (known to {_degrees(shown.sum_rad)})"
    return f"sigma {is_text} is above the limit of {limit_text}{_with(k, shown.covariance, sum_known)}"


def _with(parameter: int, covariance: Array | None, sum_known: str) -> str:
    if parameter == 1 or covariance is None:
        return ""
    correlation = covariance[0, 2] / np.sqrt(covariance[0, 0]) / np.sqrt(covariance[2, 2])
    return f"; the sum of phi and psi is seen better{sum_known}" if correlation < -0.9 else ""


def _missing(shown: Shown) -> str:
    if shown.frames == 0:
        return "no frame yet"
    if not shown.ticks:
        return "no wheel counts at the frames yet"
    return "no vertical line is seen"


def _all(state: State, reason: str, todo: Manoeuvre | None) -> Verdict:
    each = ParameterVerdict(state, reason)
    return Verdict(state, each, each, each, todo.text if todo else "", todo.brings if todo else "")


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.2g} deg"
