"""What a drive's figures must reach, and which of them do not."""

from dataclasses import dataclass

from omnivert.bench.score.score import Score


@dataclass(frozen=True, slots=True)
class Limits:
    """The defaults are the targets."""

    recall: float = 0.92
    precision: float = 0.90
    correct_lines: float = 45.0  # a frame
    right_percent: float = 99.3  # of links
    false_percent: float = 0.2
    new_percent: float = 0.5  # falsely new
    repeatability: float = 0.97
    sigma_mrad: float = 0.6
    normalised: tuple[float, float] = (0.8, 1.2)
    ring_px: float = 0.02

    def misses(self, score: Score) -> list[str]:
        """In words, each figure that does not reach its limit; a figure that is not there does not."""
        d, i, s = score.detection, score.identity, score.sharpness
        low, high = self.normalised
        asked = (
            ("recall", d.recall, self.recall, None),
            ("precision", d.precision, self.precision, None),
            ("correct lines", d.correct_lines_per_frame, self.correct_lines, None),
            ("right links", i.correct_percent, self.right_percent, None),
            ("false links", i.false_percent, None, self.false_percent),
            ("falsely new", i.false_new_percent, None, self.new_percent),
            ("repeatability", i.repeatability, self.repeatability, None),
            ("sigma", s.sigma_mrad, None, self.sigma_mrad),
            ("normalised sigma", s.normalised_sigma, low, high),
            ("ring", s.ring_rms_px, None, self.ring_px),
        )
        return [
            f"{name} {'none' if value is None else f'{value:.4g}'}, not {'' if least is None else f'{least:g}'}"
            f"..{'' if most is None else f'{most:g}'}"
            for name, value, least, most in asked
            if value is None or not ((least is None or value >= least) and (most is None or value <= most))
        ]
