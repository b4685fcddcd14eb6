"""What may be claimed of each parameter, why not more, and what to drive next."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.observability import Piece
from omnivert.config import Calibration
from omnivert.messages import ParameterVerdict, State

Array = NDArray[np.float64]

TURN_AND_DRIVE = "turn about 90 deg on the spot, then drive 0.7 m straight"
DRIVE = "drive 0.7 m straight"
TURN = "turn about 90 deg on the spot"


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


@dataclass(frozen=True, slots=True)
class Verdict:
    state: State
    phi: ParameterVerdict
    rho: ParameterVerdict
    psi: ParameterVerdict
    next_manoeuvre: str


def verdict(shown: Shown, limits: Calibration, before: State) -> Verdict:
    """Each parameter's state; a claim once made holds until sigma is a quarter above its limit."""
    if not shown.restored and (shown.frames == 0 or not shown.ticks or (shown.covariance is None and shown.lines == 0)):
        return _all(State.WAITING, _missing(shown), DRIVE)
    if shown.contradicted:
        return _all(State.INVALID, shown.contradicted, TURN_AND_DRIVE)
    sum_known = "" if shown.sum_rad is None or shown.sum_rad > 0.1 else f" (known to {_degrees(shown.sum_rad)})"
    poor, manoeuvre = ("", "") if shown.restored else _one_motion(shown)
    if shown.covariance is None:
        reason = poor or "because several mounts explain the drive so far about equally well"
        return _all(State.NOT_YET, reason, manoeuvre or TURN_AND_DRIVE)
    hold = 1.25 if before is State.CALIBRATED else 1.0
    sigma = np.sqrt(np.diag(shown.covariance))
    limit = np.array([np.deg2rad(limits.sigma_limit_deg), limits.sigma_limit_m, np.deg2rad(limits.sigma_limit_deg)])
    states = [_state(float(s), float(b) * hold, bool(poor)) for s, b in zip(sigma, limit, strict=True)]
    # phi, rho and psi lean on each other: none is claimed while another is far from its limit.
    if (sigma > 2.5 * hold * limit).any():
        states = [State.USABLE if s is State.CALIBRATED else s for s in states]
    split = shown.disagreement > limits.max_disagreement
    if split:
        states = [State.USABLE if s is State.CALIBRATED else s for s in states]
    # Of a camera on the axis, phi has no meaning: what is not apart from zero is not claimed.
    if shown.rho_m < 3.0 * sigma[1] and State.CALIBRATED in (states[0], states[2]):
        states[0] = states[2] = State.USABLE
    parameters = []
    for k, state in enumerate(states):
        reason = "" if state is State.CALIBRATED else poor or _why(k, shown, sigma, limit, split, sum_known)
        parameters.append(ParameterVerdict(state, reason))
    order = (State.NOT_YET, State.USABLE, State.CALIBRATED)
    overall = min(states, key=order.index)
    todo = "" if overall is State.CALIBRATED else manoeuvre or TURN_AND_DRIVE
    return Verdict(overall, parameters[0], parameters[1], parameters[2], todo)


def paper_verdict() -> Verdict:
    """The filter as printed is shown, never claimed: its sigmas hold only where D of every line is known to 10 %."""
    reason = (
        "because the filter as printed (mode paper) needs each line's distance to about 10 % for its sigmas to hold"
    )
    return _all(State.NOT_YET, reason, "")


def _state(sigma: float, limit: float, one_motion: bool) -> State:
    if one_motion or sigma > 5.0 * limit:
        return State.NOT_YET
    return State.CALIBRATED if sigma <= limit else State.USABLE


def _one_motion(shown: Shown) -> tuple[str, str]:
    """Why motion about a single centre of rotation, or none, is not enough; empty when there was more."""
    if shown.driven_m < 0.2 and shown.turned_rad < np.deg2rad(20.0):
        turned = np.degrees(shown.turned_rad)
        return f"because the robot has only moved {shown.driven_m:.2f} m and turned {turned:.0f} deg", TURN_AND_DRIVE
    if len(shown.centres) >= 2:
        return "", ""
    if not shown.centres:
        return "because the robot has hardly moved", TURN_AND_DRIVE
    piece = shown.centres[0]
    slant = abs(piece.slant)
    if slant < 0.17:
        return (
            f"because you drove straight for {shown.driven_m:.1f} m, phi and psi are seen only as a sum",
            TURN,
        )
    if slant > np.pi / 2.0 - 0.17:
        degrees = np.degrees(shown.turned_rad)
        return f"because you only turned on the spot, by {degrees:.0f} deg, nothing gives the lines' distances", DRIVE
    radius = piece.way_m / max(piece.turned_rad, 1e-9)
    return (
        f"because you drove one circle of {radius:.2f} m radius, a camera nearer to its centre looks the same",
        DRIVE,
    )


def _why(k: int, shown: Shown, sigma: Array, limit: Array, split: bool, sum_known: str) -> str:
    """Why parameter k is seen, but not claimed."""
    if split:
        return "because the two halves of the drive do not agree about it"
    if sigma[k] <= limit[k]:
        return "because it depends on the others, which are not known well enough"
    is_text = f"{1e3 * sigma[k]:.2g} mm" if k == 1 else _degrees(float(sigma[k]))
    limit_text = f"{1e3 * limit[k]:.3g} mm" if k == 1 else f"{np.degrees(limit[k]):.3g} deg"
    return f"sigma {is_text} is above the limit of {limit_text}{_with(k, shown.covariance, sum_known)}"


def _with(parameter: int, covariance: Array | None, sum_known: str) -> str:
    if parameter == 1 or covariance is None:
        return ""
    correlation = covariance[0, 2] / np.sqrt(covariance[0, 0] * covariance[2, 2])
    return f"; the sum of phi and psi is seen better{sum_known}" if correlation < -0.9 else ""


def _missing(shown: Shown) -> str:
    if shown.frames == 0:
        return "no frame yet"
    if not shown.ticks:
        return "no wheel counts at the frames yet"
    return "no vertical line is seen"


def _all(state: State, reason: str, manoeuvre: str) -> Verdict:
    each = ParameterVerdict(state, reason)
    return Verdict(state, each, each, each, manoeuvre)


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.2g} deg"
