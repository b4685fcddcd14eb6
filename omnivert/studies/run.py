"""One seeded drive through the calibration, reduced to what a study needs of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.model import mount_difference
from omnivert.config import Config
from omnivert.messages import Correction, Estimate, Extrinsics, Mount, State
from omnivert.simulation.recording import Drive, recorded
from omnivert.studies.bound import CORRECTIONS, MOUNT, Bound, bound_of
from omnivert.studies.presets import Case

Array = NDArray[np.float64]
Oracle = Callable[[Drive, Config], tuple[Array, Array] | None]
"""The mount (3,) and covariance (3, 3) of an estimator that starts at the truth and knows the inliers."""

WRONG = np.array([np.deg2rad(10.0), 0.05, np.deg2rad(10.0)])
FALSE_SIGMAS = 6.0
UNSUPPORTED = 1.5  # times the configured limit that the bound without wheel noise may reach for a claim


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A published mount beside the truth."""

    error: Array  # (3,) phi, rho, psi; rad, m, rad
    covariance: Array  # (3, 3)

    @property
    def sigma(self) -> Array:
        return np.sqrt(np.diag(self.covariance))

    @property
    def nees(self) -> float:
        """e' P^-1 e, chi-square of 3 where the covariance is honest."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


@dataclass(frozen=True, slots=True)
class Corrected:
    """A correction beside the truth; the base as true / configured."""

    name: str
    error: float
    std: float
    bound: float


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What is kept of one drive."""

    case: str
    seed: int
    mount: Array  # (3,) the truth at the end
    filter: Solution | None
    smoother: Solution | None
    oracle: Solution | None
    bound: Array  # (3, 3) with the corrections unknown that the estimate has freed
    bound_held: Array  # (3, 3) with all of them known
    state: State  # at the end
    parameters: tuple[State, State, State]
    reasons: tuple[str, ...]  # of the three, at the end
    next_manoeuvre: str
    first_claim_s: float | None  # since the first frame
    claims: int  # extrinsics
    false_claims: tuple[str, ...]  # why; empty when none was false
    alarm_s: tuple[float, ...]  # when the state became `moved`
    corrections: tuple[Corrected, ...]  # those freed
    seconds: float  # that the calibration took


def run_of(case: Case, config: Config, seed: int, oracle: Oracle | None = None) -> Run:
    """Drive, calibrate, compare.

    A claim is any estimate or extrinsics in state calibrated, and any parameter in that state. It is **false** when

    * what it claims is off by more than 6 of its own sigmas, or by more than 10 deg or 5 cm, or
    * the drive did not support it: the bound up to that frame, without the wheels' noise as excitation, of a parameter
      that is claimed lies above one and a half times its configured limit. So every claim on a drive that is straight,
      a turn, an arc, standing, or among lines too far away is false, even where it happens to be right.
    """
    config = with_freedom(with_noise(config, case.noise_k_m), case.free)
    drive = recorded(case.scene, config, seed)
    calibrator = Calibrator(config)
    told: list[Estimate | Extrinsics] = []
    began = time.perf_counter()
    for message in drive.messages:
        told += calibrator.step(message)
    live = [message for message in told if isinstance(message, Estimate)]
    told += calibrator.close()
    seconds = time.perf_counter() - began
    estimates = [message for message in told if isinstance(message, Estimate)]
    last = estimates[-1]
    freed = tuple(part for part in last.corrections if part.freed and part.name in CORRECTIONS)
    truth = drive.mount_at[-1]
    bound = bound_of(drive, config, tuple(part.name for part in freed))
    held = bound if not freed else bound_of(drive, config)
    found = None if oracle is None else oracle(drive, config)
    claimed = [message for message in estimates if _claimed(message).any()]
    return Run(
        case=case.name,
        seed=seed,
        mount=truth,
        filter=_beside(live[-1].mount, truth) if live else None,
        smoother=_beside(last.smoother, truth),
        oracle=None if found is None else Solution(mount_difference(found[0], truth), found[1]),
        bound=bound.mount,
        bound_held=held.mount,
        state=last.state,
        parameters=(last.phi.state, last.rho.state, last.psi.state),
        reasons=(last.phi.reason, last.rho.reason, last.psi.reason),
        next_manoeuvre=last.next_manoeuvre,
        first_claim_s=_seconds(drive, claimed[0]) if claimed else None,
        claims=sum(isinstance(message, Extrinsics) for message in told),
        false_claims=false_claims(drive, config, told),
        alarm_s=tuple(
            _seconds(drive, now)
            for before, now in pairwise(estimates)
            if now.state is State.MOVED and before.state is not State.MOVED
        ),
        corrections=tuple(_corrected(part, drive, config, bound) for part in freed),
        seconds=seconds,
    )


def false_claims(drive: Drive, config: Config, told: list[Estimate | Extrinsics]) -> tuple[str, ...]:
    """Why claims were false, each reason once, in their order."""
    limits = config.calibration
    angle = np.deg2rad(limits.sigma_limit_deg)
    most = UNSUPPORTED * np.array([angle, limits.sigma_limit_m, angle])
    found: dict[str, None] = {}
    supported = np.zeros(3, dtype=np.bool_)
    for message in told:
        claimed = _claimed(message)
        if not claimed.any():
            continue
        if message.mount is None:
            found["claimed without a mount"] = None
            continue
        at = _seconds(drive, message)
        frame = int(np.searchsorted(drive.time_s, at + 1e-6)) - 1
        part = _solution(message.mount, drive.mount_at[max(frame, 0)])
        off = np.abs(part.error)
        for name, bad in zip(MOUNT, claimed & ((off > FALSE_SIGMAS * part.sigma) | (off > WRONG)), strict=True):
            if bad:
                found[f"{name} is off"] = None
        new = claimed & ~supported  # what a drive has shown once, it has shown
        if new.any():
            bound = bound_of(drive, config, nominal=True, until_s=at + 1e-6)
            shown = np.sqrt(np.diag(bound.mount)) <= most
            supported |= new & shown
            for name, bad in zip(MOUNT, new & ~shown, strict=True):
                if bad:
                    found[f"{name} is not shown by the drive"] = None
            if (new & ~shown).any():
                break  # one such claim is enough, and every frame would need a bound of its own
    return tuple(found)


def with_noise(config: Config, noise_k_m: float | None) -> Config:
    """The configuration with this K."""
    if noise_k_m is None:
        return config
    given = config.model_dump(exclude_unset=True)
    return Config.model_validate({**given, "encoder": {**given.get("encoder", {}), "noise_k_m": noise_k_m}})


def with_freedom(config: Config, free: bool) -> Config:
    """The configuration with all corrections estimated from the beginning."""
    if not free:
        return config
    given = config.model_dump(exclude_unset=True)
    every = {"time_offset": "free", "wheel_ratio": "free", "wheel_base": "free"}
    return Config.model_validate({**given, "calibration": {**given.get("calibration", {}), **every}})


def _claimed(message: Estimate | Extrinsics) -> NDArray[np.bool_]:
    """(3,) which parameters it claims."""
    if message.state is State.CALIBRATED:
        return np.ones(3, dtype=np.bool_)
    if isinstance(message, Extrinsics):
        return np.zeros(3, dtype=np.bool_)
    return np.array([part.state is State.CALIBRATED for part in (message.phi, message.rho, message.psi)])


def _seconds(drive: Drive, message: Estimate | Extrinsics) -> float:
    """When the picture was taken."""
    return 1e-9 * message.stamp_ns - drive.scene.time_offset_s


def _beside(mount: Mount | None, truth: Array) -> Solution | None:
    return None if mount is None else _solution(mount, truth)


def _solution(mount: Mount, truth: Array) -> Solution:
    return Solution(mount_difference(np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]), truth), mount.covariance)


def _corrected(part: Correction, drive: Drive, config: Config, bound: Bound) -> Corrected:
    unit = config.robot.wheel_base_m if part.name == "wheel_base" else 1.0
    scene = drive.scene
    truth = {"time_offset": scene.time_offset_s, "wheel_ratio": scene.wheel_ratio, "wheel_base": scene.base_factor}
    return Corrected(part.name, part.value / unit - truth[part.name], part.std / unit, bound.std(part.name))
