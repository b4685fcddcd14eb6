"""Which mounts are told to a person at all, long before any verdict speaks for them."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import Seen, Unseen
from omnivert.calibration.kalman.model import cartesian_from_polar

Array = NDArray[np.float64]

PHI_RAD = 0.6  # a mount is told when phi is known to this,
HEADING_RAD = 0.1  # or phi + psi to this
PLACE_M = 0.05  # and the camera's place to this


def is_told(mount: Array, covariance: Array, seen: Seen | None, paper: bool = False) -> bool:
    """Near the axis phi says little, where the camera sits and looks may be known well all the same.

    What was fitted where the drive shows nothing is noise, whatever its sigmas.

    mount       (3,)    phi, rho, psi
    covariance  (3, 3)
    seen        what the drive shows; None where the mount is not the drive's, or no line was seen
    paper       the filter as printed tells every mount
    """
    if seen is not None and seen.unseen is Unseen.EVERYTHING:
        return False
    if paper or float(np.sqrt(covariance[0, 0])) < PHI_RAD:
        return True
    slope = cartesian_from_polar(mount)[1]
    heading, x, y = np.sqrt(np.diag(slope @ covariance @ slope.T)).tolist()
    return bool(heading < HEADING_RAD and max(x, y) < PLACE_M)
