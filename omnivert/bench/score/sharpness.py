"""How near are the bearings to the truth, are their sigmas true, and where was the ring?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnivert.angles import wrap
from omnivert.bench.score.circle import apart
from omnivert.bench.score.detection import Pair, ratio
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.truth import Float


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Figures over the isolated strong lines that were found, each by its nearest detection; nan without any.

    An isolated line is a strong edge with no other visible edge, silhouette or moving thing within 1.2 deg.

    residuals         how many there are
    sigma_mrad        their robust sigma: 1.4826 times the median distance from their median
    bias_mrad         that median
    normalised_sigma  the same of residual over claimed sigma; None where no sigma is claimed
    ring_rms_px       root mean square distance of the ring's centre from its true one; None where it was not looked for
    """

    residuals: int
    sigma_mrad: float
    bias_mrad: float
    normalised_sigma: float | None
    ring_rms_px: float | None


def sharpness(pairs: Sequence[Pair], rules: Rules) -> Sharpness:
    """The figures over all frames."""
    residual, std = _residuals(pairs, rules)
    off = [
        (s.center_px[0] - t.center_px[0]) ** 2 + (s.center_px[1] - t.center_px[1]) ** 2
        for s, t in pairs
        if s.center_px is not None and t.center_px is not None
    ]
    return Sharpness(
        residuals=residual.size,
        sigma_mrad=1e3 * robust_sigma(residual),
        bias_mrad=1e3 * float(np.median(residual)) if residual.size else float("nan"),
        normalised_sigma=None if std is None else robust_sigma(residual / std),
        ring_rms_px=float(np.sqrt(ratio(sum(off), len(off)))) if off else None,
    )


def robust_sigma(values: Float) -> float:
    """1.4826 MAD: the sigma of a normal distribution, whatever a minority does."""
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if values.size else float("nan")


def _residuals(pairs: Sequence[Pair], rules: Rules) -> tuple[Float, Float | None]:
    """Found less true bearing, and the claimed sigma; None when there is a frame without."""
    residuals, stds, claimed = [np.empty(0)], [np.empty(0)], True
    for sighting, truth in pairs:
        claimed &= sighting.std_rad is not None
        if sighting.bearing_rad.size == 0:
            continue
        visible = rules.visible(truth)
        others = np.concatenate((truth.bearing_rad[visible], truth.neither_rad))
        strong = truth.bearing_rad[rules.strong(truth) & visible]
        alone = strong[np.sum(apart(strong, others) < rules.isolated_rad, axis=1) == 1]  # the edge itself
        if alone.size == 0:
            continue
        nearest = np.argmin(apart(alone, sighting.bearing_rad), axis=1)
        residual = wrap(sighting.bearing_rad[nearest] - alone)
        near = np.abs(residual) <= rules.tolerance_rad
        residuals.append(residual[near])
        if sighting.std_rad is not None:
            stds.append(sighting.std_rad[nearest][near])
    return np.concatenate(residuals), np.concatenate(stds) if claimed else None
