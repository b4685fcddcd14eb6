"""A calibration's result as rows of text and as JSON: the same for `calibrate`, `demo` and `extrinsics`."""

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnivert.errors import DataError
from omnivert.messages import Estimate, Mount
from omnivert.pictures.words import PARAMETERS, heading, quantities, word

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording

Truth = tuple[float, float, float]  # phi, rho, psi; rad, m, rad
TRUTH = "truth/extrinsics.json"


def truth_of(recording: "Recording") -> Truth | None:
    """The true mount, where the recording carries it."""
    if TRUTH not in recording.attachments:
        return None
    try:
        given = json.loads(recording.attachment(TRUTH))
        return float(given["phi_rad"]), float(given["rho_m"]), float(given["psi_rad"])
    except (DataError, ValueError, KeyError, TypeError):
        return None  # damaged, or somebody's own attachment of that name


def errors(mount: Mount, truth: Truth) -> tuple[float, float, float]:
    """Estimate minus truth; rad, m, rad, angles the short way round."""
    return (
        math.remainder(mount.phi_rad - truth[0], math.tau),
        mount.rho_m - truth[1],
        math.remainder(mount.psi_rad - truth[2], math.tau),
    )


def in_sigmas(mount: Mount, truth: Truth) -> tuple[float, float, float]:
    """The size of each error in units of its own claimed sigma."""
    sigma = np.sqrt(np.diag(mount.covariance))
    return tuple(
        abs(error) / float(s) if s > 0 else math.inf for error, s in zip(errors(mount, truth), sigma, strict=True)
    )  # type: ignore[return-value]


def rows(mount: Mount, words: tuple[str, str, str], truth: Truth | None) -> list[str]:
    """The three parameters as a table: estimate with sigma, truth and distance to it where known, and a word."""
    table = [("", "estimate", *(("truth", "off by") if truth is not None else ()), "")]
    off = in_sigmas(mount, truth) if truth is not None else (0.0, 0.0, 0.0)
    for index, part in enumerate(quantities(mount)):
        cells: tuple[str, ...] = (part.name, str(part))
        if truth is not None:
            target = truth[index] if part.unit == "m" else math.degrees(truth[index])
            cells += (f"{target:.{part.decimals}f} {part.unit}", f"{off[index]:.1f} sigma")
        table.append((*cells, words[index]))
    return aligned(table)


def aligned(table: Sequence[tuple[str, ...]], apart: int = 3) -> list[str]:
    """Rows of cells, first and last column flush left, the others flush right, so many spaces apart."""
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    last = len(widths) - 1
    return [
        (" " * apart)
        .join(
            cell.ljust(width) if column in (0, last) else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        .rstrip()
        for row in table
    ]


def together(mount: Mount) -> str:
    """What phi and psi are known to be together, where that is far more than each alone; else empty."""
    c = mount.covariance
    scale = math.sqrt(max(float(c[0, 0] * c[2, 2]), 0.0))
    correlation = float(c[0, 2]) / scale if scale > 0 else 0.0
    if correlation > -0.8:
        return ""
    return f"{heading(mount)}   (correlation of phi and psi {correlation:.2f}: their sum is known best)"


def mount_json(mount: Mount | None) -> dict[str, Any]:
    """phi, rho, psi, their covariance and sigmas; null without a solution."""
    if mount is None:
        return {"phi_rad": None, "rho_m": None, "psi_rad": None, "covariance": None, "sigma": None}
    sigma = np.sqrt(np.maximum(np.diag(mount.covariance), 0.0))
    return {
        "phi_rad": mount.phi_rad,
        "rho_m": mount.rho_m,
        "psi_rad": mount.psi_rad,
        "covariance": mount.covariance.tolist(),
        "sigma": {"phi_rad": float(sigma[0]), "rho_m": float(sigma[1]), "psi_rad": float(sigma[2])},
    }


def truth_json(mount: Mount | None, truth: Truth | None) -> dict[str, Any]:
    """Truth, and how far the estimate is off it, also in sigmas; empty where the truth is not known."""
    if truth is None:
        return {}
    names = ("phi_rad", "rho_m", "psi_rad")
    body: dict[str, Any] = {"truth": dict(zip(names, truth, strict=True))}
    if mount is not None:
        body["off"] = dict(zip(names, errors(mount, truth), strict=True))
        body["off_in_sigmas"] = dict(zip(PARAMETERS, in_sigmas(mount, truth), strict=True))
    return body


def state_words(estimate: Estimate) -> tuple[str, str, str]:
    """Verdict and reason of each parameter."""
    parts = (estimate.phi, estimate.rho, estimate.psi)
    phi, rho, psi = (f"{word(part.state)}: {part.reason}" if part.reason else word(part.state) for part in parts)
    return phi, rho, psi
