"""One frame's bearings, cleaned."""

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.messages import Bearings, StampNs

Array = NDArray[np.float64]

_RANGE = get_args(StampNs)[1]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Finite bearings of different tracks, in the order of the tracks."""

    stamp_ns: int
    track: NDArray[np.int64]
    beta: Array  # rad
    std: Array  # rad
    reasons: tuple[str, ...]


def is_stamp(stamp_ns: int) -> bool:
    """Whether an estimate for it could be told."""
    return bool(_RANGE.low <= stamp_ns <= _RANGE.high)


def clean_sighting(bearings: Bearings, floor: float) -> tuple[Sighting, int]:
    """The usable bearings of a frame, none believed better than `floor` (rad); and how many were none.

    Lines that the vision has seen move against the world are left out, and not counted.
    """
    track, beta, std = bearings.track_id, bearings.bearing_rad, bearings.std_rad
    names, count = np.unique(track, return_counts=True)
    good = np.isfinite(beta) & np.isfinite(std) & (std > 0.0) & ~np.isin(track, names[count > 1])
    still = good if bearings.looks is None else good & (bearings.looks.moving == 0)
    order = np.flatnonzero(still)
    order = order[np.argsort(track[order], kind="stable")]
    return (
        Sighting(
            bearings.stamp_ns,
            track[order],
            wrap(beta[order]),
            np.maximum(std[order], floor),
            tuple(bearings.reasons[:12]),
        ),
        int((~good).sum()),
    )
