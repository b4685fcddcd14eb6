"""Which mounts are told to a person at all, long before any verdict speaks for them."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import Seen

Array = NDArray[np.float64]

PHI_RAD = 0.6  # a mount is told when phi is known to this,
HEADING_RAD = 0.1  # or phi + psi to this,
RHO_M = 0.1  # and rho to this, in a doubted drive


def is_told(covariance: Array, seen: Seen | None, doubted: bool) -> bool:
    """What was fitted where the drive shows nothing is noise, whatever its sigmas.

    Of a doubted drive phi is left open; how far the camera is and where it looks may be told all the same.

    covariance  (3, 3)  of phi, rho, psi
    seen        what the drive shows; None where the mount is not the drive's, or no line was seen
    """
    if seen is not None and seen.is_nothing:
        return False
    if float(np.sqrt(covariance[0, 0])) < PHI_RAD:
        return True
    both = np.array([1.0, 0.0, 1.0])
    return bool(doubted and both @ covariance @ both < HEADING_RAD**2 and covariance[1, 1] < RHO_M**2)
