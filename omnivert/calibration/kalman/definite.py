"""Is a matrix a covariance? Its factor and its inverse where it is one, and no repair where it is none."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from omnivert.calibration.symmetric import mirrored

Array = NDArray[np.float64]


def factor(covariance: Array) -> Array | None:
    """The lower triangular L with L L' = covariance (N, N); None where it is not positive definite. Not a repair."""
    lower, failed = lapack.dpotrf(covariance, lower=1)
    # What is not a number anywhere has come to the diagonal.
    return None if failed or not np.isfinite(lower.trace()) else lower


def inverse(covariance: Array) -> Array | None:
    """The inverse (N, N), symmetric; None where the covariance is not positive definite."""
    lower = factor(covariance)
    if lower is None:
        return None
    half, failed = lapack.dpotri(lower, lower=1)
    return None if failed else mirrored(half.T)
