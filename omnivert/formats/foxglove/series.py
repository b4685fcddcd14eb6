"""Results as named numbers that can be plotted, with a JSON schema for each kind."""

import math
from collections.abc import Mapping
from typing import Any

from omnivert.config import Encoder
from omnivert.messages import Bearings, Estimate, Mount, Ticks

Values = dict[str, Any]

_NUMBER, _TEXT, _WHOLE = {"type": ["number", "null"]}, {"type": "string"}, {"type": "integer"}
_TEXTS = {"type": "array", "items": _TEXT}
_PARAMETERS = (("phi", "deg"), ("rho", "m"), ("psi", "deg"))
_MOUNT = {
    f"{name}{part}_{unit}": _NUMBER for name, unit in _PARAMETERS for part in ("", "_sigma", "_low", "_high")
}  # low and high are one sigma away


def _schema(title: str, **properties: Mapping[str, Any]) -> Mapping[str, Any]:
    return {"title": f"omnivert.{title}", "type": "object", "properties": properties}


ESTIMATE = _schema(
    "Estimate",
    state=_TEXT,
    **{f"{name}_state": _TEXT for name, _ in _PARAMETERS},
    **_MOUNT,
    smoother={"type": ["object", "null"], "properties": _MOUNT},
    **{f"{name}_best_{unit}": _NUMBER for name, unit in _PARAMETERS},
    disagreement_sigmas=_NUMBER,
    frames=_WHOLE,
    driven_m=_NUMBER,
    turned_deg=_NUMBER,
    lines_used=_WHOLE,
    lines_new=_WHOLE,
    lines_rejected=_WHOLE,
    next_manoeuvre=_TEXT,
    reasons=_TEXTS,
)
_TRACK = {"id": _WHOLE, "bearing_deg": _NUMBER, "std_deg": _NUMBER, "age_frames": _WHOLE, "moving": {"type": "boolean"}}
BEARINGS = _schema(
    "Bearings",
    lines=_WHOLE,
    moving=_WHOLE,
    ring_quality=_NUMBER,
    tracks={"type": "array", "items": {"type": "object", "properties": _TRACK}},
    reasons=_TEXTS,
)
TICKS = _schema("Ticks", left=_WHOLE, right=_WHOLE, left_m=_NUMBER, right_m=_NUMBER)


def of_estimate(estimate: Estimate) -> Values:
    """Values by the names of ESTIMATE; null what is not known."""
    parts = zip(_PARAMETERS, (estimate.phi, estimate.rho, estimate.psi), strict=True)
    bound = estimate.bound_std.tolist() if estimate.bound_std is not None else (None, None, None)
    return {
        "state": estimate.state.value,
        **{f"{name}_state": verdict.state.value for (name, _), verdict in parts},
        **_of_mount(estimate.mount),
        "smoother": None if estimate.smoother is None else _of_mount(estimate.smoother),
        **{
            f"{name}_best_{unit}": None if sigma is None else _shown(sigma, unit)
            for (name, unit), sigma in zip(_PARAMETERS, bound, strict=True)
        },
        "disagreement_sigmas": estimate.disagreement,
        "frames": estimate.frame,
        "driven_m": estimate.driven_m,
        "turned_deg": math.degrees(estimate.turned_rad),
        "lines_used": estimate.lines_used,
        "lines_new": estimate.lines_new,
        "lines_rejected": estimate.lines_rejected,
        "next_manoeuvre": estimate.next_manoeuvre,
        "reasons": list(estimate.reasons),
    }


def of_bearings(bearings: Bearings) -> Values:
    """Values by the names of BEARINGS."""
    looks = bearings.looks
    moving = [bool(flag) for flag in looks.moving] if looks is not None else [False] * len(bearings.track_id)
    rows = zip(bearings.track_id, bearings.bearing_rad, bearings.std_rad, bearings.age_frames, moving, strict=True)
    return {
        "lines": len(moving),
        "moving": sum(moving),
        "ring_quality": None if bearings.ring is None else bearings.ring.quality,
        "tracks": [
            {
                "id": int(track),
                "bearing_deg": math.degrees(beta),
                "std_deg": math.degrees(std),
                "age_frames": int(age),
                "moving": moves,
            }
            for track, beta, std, age, moves in rows
        ],
        "reasons": list(bearings.reasons),
    }


def of_ticks(ticks: Ticks, encoder: Encoder) -> Values:
    """Values by the names of TICKS."""
    scale = encoder.metres_per_tick
    return {"left": ticks.left, "right": ticks.right, "left_m": scale * ticks.left, "right_m": scale * ticks.right}


def _of_mount(mount: Mount | None) -> Values:
    if mount is None:
        return dict.fromkeys(_MOUNT)
    values: Values = {}
    for k, (name, unit) in enumerate(_PARAMETERS):
        value = _shown((mount.phi_rad, mount.rho_m, mount.psi_rad)[k], unit)
        sigma = _shown(math.sqrt(max(float(mount.covariance[k, k]), 0.0)), unit)
        for part, number in (("", value), ("_sigma", sigma), ("_low", value - sigma), ("_high", value + sigma)):
            values[f"{name}{part}_{unit}"] = number if math.isfinite(number) else None
    return values


def _shown(value: float, unit: str) -> float:
    return math.degrees(value) if unit == "deg" else value
