"""What every contender in the vision's comparison is judged by: its times and its sightings."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnivert.bench.score.score import Score, score
from omnivert.bench.score.truth import FrameTruth, Sighting
from omnivert.bench.spread import Spread

WARM_UP = 3  # frames that fill caches and compile kernels, not counted


@dataclass(frozen=True, slots=True, eq=False)
class Contender:
    """One way through all frames, on one thread, a picture in grey in memory at its start."""

    sobel_pair: Spread  # the yardstick, on the same frames and in the same process
    step: Spread  # all of it for a frame
    stages: Mapping[str, Spread]  # its parts, in order
    sightings: Sequence[Sighting]  # of each frame

    @classmethod
    def of_seconds(
        cls,
        sobel: Sequence[float],
        step: Sequence[float],
        stages: Mapping[str, Sequence[float]],
        sightings: Sequence[Sighting],
    ) -> "Contender":
        return cls(_spread(sobel), _spread(step), {name: _spread(took) for name, took in stages.items()}, sightings)

    @property
    def ratio_to_sobel(self) -> float:
        return self.step.median_ms / self.sobel_pair.median_ms

    @property
    def lines_per_frame(self) -> float:
        return sum(s.track_id.size for s in self.sightings) / max(len(self.sightings), 1)

    def score(self, truths: Sequence[FrameTruth | None] | None) -> Score | None:
        """Against the truth of the same frames, where there is one."""
        return None if truths is None else score(self.sightings, truths)

    def json(self, truths: Sequence[FrameTruth | None] | None) -> dict[str, Any]:
        judged = self.score(truths)
        return {
            "vision_ms": self.step.median_ms,
            "vision_p99_ms": self.step.p99_ms,
            "sobel_pair_ms": self.sobel_pair.median_ms,
            "ratio_to_sobel": self.ratio_to_sobel,
            "lines_per_frame": self.lines_per_frame,
            "stages": {name: spread.json(self.sobel_pair) for name, spread in self.stages.items()},
            "score": None if judged is None else judged.json(),
        }


def _spread(seconds: Sequence[float]) -> Spread:
    return Spread.of_seconds(seconds[WARM_UP:] or seconds) if seconds else Spread(math.nan, math.nan, 0)
