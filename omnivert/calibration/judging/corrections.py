"""Clock offset, wheel ratio and wheel base: each freed only when the drive shows it, else held as configured."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.solver.problem import GLOBALS, Prior
from omnivert.config import Config
from omnivert.messages import Correction

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NAMES = ("time_offset", "wheel_ratio", "wheel_base")
PRIOR_STD = np.array([0.2, 0.1, 0.1])  # s, 1, 1: how far off a configuration may be
SIGNIFICANT = 3.0  # sigmas from the configured value that free a correction, however badly it is seen
STILL_SO = 2.0  # the same for one that is free
FAR = 0.75  # of what a configuration may be off by: such wheels err in other ways, too, and sigmas are no measure
KEPT = 1.5  # what was freed stays so until its sigma is above the limit by this factor


def first_prior() -> Prior:
    """Before the drive: of the mount nothing is known, corrections are those that are configured."""
    information = np.zeros((GLOBALS, GLOBALS))
    information[3:, 3:] = np.diag(1.0 / PRIOR_STD**2)
    free = np.array([True, True, True, False, False, False])
    return Prior(np.zeros(GLOBALS), information, free, np.zeros(3))


def are_far(at: Array) -> bool:
    """Whether some of the corrections (3,) make another rig of the one that is configured."""
    return bool((np.abs(at) > FAR * PRIOR_STD).any())


def freed_at_first(config: Config) -> Flags:
    """Which corrections are estimated from the beginning (3,)."""
    c = config.calibration
    return np.array([mode == "free" for mode in (c.time_offset, c.wheel_ratio, c.wheel_base)])


def may_be_free(config: Config) -> Flags:
    """Which corrections are not held by the configuration (3,)."""
    c = config.calibration
    return np.array([mode != "held" for mode in (c.time_offset, c.wheel_ratio, c.wheel_base)])


def freed(config: Config, before: Flags, information: Array, step: Array, at: Array) -> Flags:
    """Which corrections are to be estimated (3,).

    before       (3,)    those that were
    information  (6, 6)  on mount and corrections, nothing held
    step         (6,)    that the data ask for, were nothing held
    at           (3,)    corrections now
    """
    sigma = stds(information)
    value = at + step[3:]
    settings = config.calibration
    limits = np.array([settings.free_time_s, settings.free_ratio, settings.free_base])
    modes = (settings.time_offset, settings.wheel_ratio, settings.wheel_base)
    odd = np.abs(value) > np.where(before, STILL_SO, SIGNIFICANT) * sigma
    found = odd | (sigma <= limits * np.where(before, KEPT, 1.0))
    return np.array([{"free": True, "held": False, "auto": bool(f)}[m] for m, f in zip(modes, found, strict=True)])


def stds(information: Array) -> Array:
    """Sigmas of the corrections (3,), nothing held."""
    covariance = np.linalg.inv(information + 1e-6 * np.eye(GLOBALS))
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance)[3:], 0.0)))


def told(config: Config, free: Flags, at: Array, sigma: Array) -> tuple[Correction, ...]:
    """For people: what each correction is, how sure, and why it is held.

    at, sigma  (3,)  time offset (s), wheel ratio - 1, base / configured - 1; sigma were nothing held
    """
    base = config.robot.wheel_base_m
    settings = config.calibration
    modes = (settings.time_offset, settings.wheel_ratio, settings.wheel_base)
    limits = (settings.free_time_s, settings.free_ratio, settings.free_base)
    values = (float(at[0]), 1.0 + float(at[1]), base * (1.0 + float(at[2])))
    scales = (1.0, 1.0, base)
    texts = ("{:.0f} ms", "{:.2g} %", "{:.2g} %")
    units = (1e3, 1e2, 1e2)
    out = []
    for k, name in enumerate(NAMES):
        reason = ""
        if not free[k]:
            seen, limit = (texts[k].format(units[k] * float(v)) for v in (sigma[k], limits[k]))
            held = f"held: this drive shows it to {seen}, it is freed from {limit} on"
            reason = f"held: calibration.{name} is set so" if modes[k] == "held" else held
        out.append(Correction(name, values[k], min(float(sigma[k]) * scales[k], 1e6), bool(free[k]), reason))
    return tuple(out)
