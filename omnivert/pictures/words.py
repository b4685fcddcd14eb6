"""Numbers with their sigma and states in words: the same in terminal, picture and file."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from omnivert.messages import Correction, Estimate, Mount, State

PARAMETERS = ("phi", "rho", "psi")  # the order of a mount's covariance
HUGE = 1e5  # a sigma that says nothing
MANY = 9999


@dataclass(frozen=True, slots=True)
class Quantity:
    """One parameter of the mount, in the unit that people read."""

    name: str
    value: float
    sigma: float
    unit: str  # "deg" or "m"

    @property
    def decimals(self) -> int:
        """Digits after the point: two digits of sigma."""
        return decimals_of(self.sigma)

    @property
    def value_text(self) -> str:
        return f"{self.value:.{self.decimals}f}"

    @property
    def sigma_text(self) -> str:
        return f"{self.sigma:.{self.decimals}f}" if not self.sigma >= HUGE else f"{self.sigma:.0e}"

    def __str__(self) -> str:
        return f"{self.value_text} ± {self.sigma_text} {self.unit}"


def decimals_of(sigma: float) -> int:
    """Digits after the point that show two digits of sigma; 0 to 6."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return 4
    # 0.0996 rounds to 0.100, so the exponent is that of the rounded number.
    exponent = int(f"{sigma:.1e}".partition("e")[2])
    return min(max(1 - exponent, 0), 6)


def quantities(mount: Mount) -> tuple[Quantity, Quantity, Quantity]:
    """phi and psi in degrees, rho in metres, each with its sigma."""
    phi, rho, psi = np.sqrt(np.maximum(np.diag(mount.covariance), 0.0))
    return (
        Quantity("phi", math.degrees(mount.phi_rad), math.degrees(phi), "deg"),
        Quantity("rho", mount.rho_m, float(rho), "m"),
        Quantity("psi", math.degrees(mount.psi_rad), math.degrees(psi), "deg"),
    )


def heading(mount: Mount) -> Quantity:
    """phi + psi, the camera's heading: often known long before its parts."""
    c = mount.covariance
    variance = max(float(c[0, 0] + c[2, 2] + 2.0 * c[0, 2]), 0.0)
    total = math.degrees(math.remainder(mount.phi_rad + mount.psi_rad, math.tau))
    return Quantity("phi + psi", total, math.degrees(math.sqrt(variance)), "deg")


def bounds(estimate: Estimate) -> tuple[str, str, str]:
    """The smallest sigmas that this drive allows (Cramér-Rao), in the units that people read; "–" where not known."""
    if estimate.bound_std is None:
        return "–", "–", "–"
    phi, rho, psi = estimate.bound_std.tolist()
    best = (math.degrees(phi), rho, math.degrees(psi))
    return tuple(f"{value:.{decimals_of(value)}f}" for value in best)  # type: ignore[return-value]


def corrected(correction: Correction) -> str:
    """A correction in words: what it is, how sure, or why it is held."""
    match correction.name:
        case "time_offset":
            name, unit, scale, zero = "time offset", "ms", 1e3, 0.0
        case "wheel_ratio":
            name, unit, scale, zero = "right wheel larger by", "%", 100.0, 1.0
        case "wheel_base":
            name, unit, scale, zero = "wheel base", "m", 1.0, 0.0
        case "noise_k":
            name, unit, scale, zero = "wheel noise K", "mm", 1e3, 0.0
        case "bearing_noise":
            name, unit, scale, zero = "bearing noise", "times as told", 1.0, 0.0
        case _:
            name, unit, scale, zero = printable(correction.name), "", 1.0, 0.0
    value, sigma = scale * (correction.value - zero), scale * correction.std
    if not correction.freed:
        return f"{name}  {value:.4g} {unit}, {printable(correction.reason)}"
    digits = decimals_of(sigma)
    return f"{name}  {value:.{digits}f} ± {sigma:.{digits}f} {unit}"


def printable(text: str) -> str:
    """A text from the network as a terminal may get it: nothing in it that moves a cursor or changes a colour."""
    return "".join(character if character.isprintable() else " " for character in text)


def reasons_of(estimate: Estimate) -> list[str]:
    """Why each parameter is not known better, then what the estimate says of the whole."""
    parts = (part.reason for part in (estimate.phi, estimate.psi, estimate.rho))
    return [*filter(None, parts), *estimate.reasons]


def cause(reasons: Iterable[str]) -> str:
    """Reasons as the cause of something: each once, without its own "because"."""
    return "; ".join(dict.fromkeys(reason.removeprefix("because ") for reason in reasons))


def short(text: str, length: int) -> str:
    """The text, or its beginning."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def counted(number: float, decimals: int = 0) -> str:
    """A count or a rate in no more room than a column has."""
    return f"{number:.{decimals}f}" if number <= MANY else f">{MANY}"


def amounts(counts: Mapping[str, int]) -> str:
    """How many of each kind of message: "794 frames · 2646 ticks"."""
    return " · ".join(
        f"{number} {name.lower()}{'' if number == 1 or name.endswith('s') else 's'}" for name, number in counts.items()
    )


def word(state: State) -> str:
    """The state as people read it."""
    return state.value.replace("_", " ")


def mark(state: State) -> str:
    """One character that carries the state without colour."""
    match state:
        case State.CALIBRATED:
            return "✓"
        case State.USABLE | State.NOT_YET:
            return "!"
        case State.MOVED | State.INVALID:
            return "✗"
        case State.WAITING:
            return "–"


def colour(state: State) -> str:
    """A colour that repeats the state, readable on light and on dark; #rrggbb."""
    match state:
        case State.CALIBRATED:
            return "#2e8b57"
        case State.USABLE:
            return "#3d7ebd"
        case State.NOT_YET:
            return "#b8790b"
        case State.MOVED | State.INVALID:
            return "#c0392b"
        case State.WAITING:
            return "#808080"
