"""What counts as a line, as found and as the same: one set of numbers for everybody who is judged."""

from dataclasses import dataclass, field

import numpy as np

from omnivert.bench.score.truth import FrameTruth, Mask


def _deg(value: float) -> float:
    return field(default=float(np.deg2rad(value)))


@dataclass(frozen=True, slots=True)
class Rules:
    """The defaults are those of the project's figures; two scores compare only under the same rules."""

    tolerance_rad: float = _deg(0.7)  # a detection this near to a true edge is a detection of it
    cluster_rad: float = _deg(0.7)  # true edges within this of the first of them are one line in the picture
    same_edge_rad: float = _deg(0.3)  # for purity, a detection is of the nearest edge and those this little farther off
    isolated_rad: float = _deg(1.2)  # a line is isolated when no other true edge is nearer
    strong_fraction: float = 0.5  # of the ring's radial extent: at least this must be visible of a strong line
    strong_contrast: float = 12.0  # grey steps, at least
    visible_fraction: float = 0.15  # more than this can be seen at all
    visible_contrast: float = 5.0
    lookback_frames: int = 20  # how long ago an edge may have been seen to be known again (IX-A)

    def strong(self, truth: FrameTruth) -> Mask:
        """(E,) edges that a person would point at."""
        return (truth.visible_fraction >= self.strong_fraction) & (truth.contrast >= self.strong_contrast)

    def visible(self, truth: FrameTruth) -> Mask:
        """(E,) edges that a detection may rightly be of."""
        return (truth.visible_fraction > self.visible_fraction) & (truth.contrast > self.visible_contrast)
