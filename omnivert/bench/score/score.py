"""All figures of one run against the truth, as an object for JSON and in words."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from omnivert.bench.score.detection import Detection, detection
from omnivert.bench.score.identity import Identity, identity
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.sharpness import Sharpness, sharpness
from omnivert.bench.score.truth import FrameTruth, Sighting


@dataclass(frozen=True, slots=True)
class Score:
    """How right the lines of a run are."""

    frames: int  # that the truth knows
    detection: Detection
    identity: Identity
    sharpness: Sharpness

    def json(self) -> dict[str, Any]:
        parts = (self.detection, self.identity, self.sharpness)
        return {"frames": self.frames, **{name: value for part in parts for name, value in asdict(part).items()}}

    def words(self) -> list[str]:
        """Three lines to read."""
        d, i, s = self.detection, self.identity, self.sharpness
        ring = "" if s.ring_rms_px is None else f" · ring {s.ring_rms_px:.3f} px"
        honest = "" if s.normalised_sigma is None else f", {s.normalised_sigma:.2f} of what it claims"
        return [
            f"found   {100 * d.recall:.1f} % of the strong lines · {100 * d.precision:.1f} % of what it found is there"
            f" (by chance {100 * d.precision_chance:.0f} %)",
            f"kept    {i.correct_percent:.2f} % of links right, {i.false_percent:.2f} % false,"
            f" {i.false_new_percent:.2f} % falsely new",
            f"lines   {d.correct_lines_per_frame:.1f} true ones a frame · bearings to {s.sigma_mrad:.2f} mrad"
            f"{honest}{ring}",
        ]


def score(
    sightings: Iterable[Sighting], truths: Sequence[FrameTruth | None], rules: Rules | None = None
) -> Score | None:
    """The sightings of frame after frame against the truth of the same frames; None when it knows none of them."""
    rules = Rules() if rules is None else rules
    pairs = [(s, t) for s, t in zip(sightings, truths, strict=False) if t is not None]
    if not pairs:
        return None
    return Score(len(pairs), detection(pairs, rules), identity(pairs, rules), sharpness(pairs, rules))
