"""What may be stored for a robot, and what of it may be taken up again."""

import numpy as np

from omnivert import __version__
from omnivert.config import Config
from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Entry


def restorable(entry: Entry, config: Config) -> tuple[bool, str]:
    """Whether a stored mount holds for this configuration; if not, why, in words that end in a reason."""
    stored, mount = entry.extrinsics, entry.extrinsics.mount
    if (stored.robot, stored.camera) != (config.robot.id, config.camera.id):
        return False, f"stored for {stored.robot}/{stored.camera}, this is {config.robot.id}/{config.camera.id}"
    if changes := config.rig_changes(stored.rig_digest):
        return False, f"stored for another rig: what differs is {'; '.join(changes)}"
    if _major(stored.software) != _major(f"omnivert {__version__}"):
        return False, f"stored by {stored.software}, this is omnivert {__version__}"
    if stored.state != State.CALIBRATED:
        return False, f"stored as {stored.state.value.replace('_', ' ')}, not as calibrated"
    numbers = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad])
    if not (np.isfinite(numbers).all() and mount.rho_m >= 0.0 and _is_covariance(mount)):
        return False, "stored with numbers that cannot be: not finite, or a covariance that is not positive definite"
    return True, ""


def storable(extrinsics: Extrinsics, config: Config) -> str:
    """Why these can be no result of this robot's calibration, in one of a few texts; "" when they can."""
    mount = extrinsics.mount
    if (extrinsics.robot, extrinsics.camera) != (config.robot.id, config.camera.id):
        return "extrinsics of another robot or camera"
    if extrinsics.rig_digest != config.rig_digest():
        return "extrinsics of another rig: its digest is not the configuration's"
    if not np.isfinite([mount.phi_rad, mount.rho_m, mount.psi_rad, *mount.covariance.ravel()]).all():
        return "extrinsics with numbers that are not finite"
    if not 0.0 <= mount.rho_m <= config.calibration.max_rho_m:
        return "extrinsics out of range: rho_m is above calibration.max_rho_m"
    return ""


def _major(software: str) -> str:
    return software.rpartition(" ")[2].partition(".")[0]


def _is_covariance(mount: Mount) -> bool:
    covariance = mount.covariance
    if covariance.shape != (3, 3) or not np.isfinite(covariance).all():
        return False
    scale = np.sqrt(np.abs(np.diag(covariance)))
    if not (scale > 0.0).all():
        return False
    correlation = covariance / np.outer(scale, scale)  # of like size, whatever the units
    return bool(np.allclose(correlation, correlation.T, atol=1e-9) and np.linalg.eigvalsh(correlation)[0] > 1e-12)
