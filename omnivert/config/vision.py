"""From a frame to tracked bearings."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from omnivert.config.section import Section, whole

Dissimilarity = Literal["l1", "l2", "linf", "jeffrey", "chi-square", "bhattacharyya", "quadratic", "ssd", "zncc"]


class Vision(Section):
    """Vertical lines, descriptor, matching, tracks (II-IV, IX-A). `mode = "paper"` takes the paper's values."""

    PAPER: ClassVar[Mapping[str, float]] = {
        "edge_tolerance_deg": 5.0,
        "min_length": 0.5,
        "bearing_std_deg": 0.04,
        "edge_min_magnitude": 30.0,
    }

    mode: Literal["default", "paper"] = "default"
    """paper: extraction and matching as printed; default: what measured better."""
    ring_search_px: float = Field(20.0, ge=1.0, le=500.0)
    """How far from the expected centre the ring is looked for first."""
    ring_min_quality: float = Field(0.30, ge=0.0, le=1.0)
    """Share of the rim that must be seen, else the frame's ring is lost."""
    edge_tolerance_deg: float = Field(15.0, gt=0.0, le=45.0)
    """Edges that point at the centre within this are kept. Paper: 5 deg (II, step 2)."""
    edge_min_magnitude: float = Field(32.0, ge=0.0, le=1000.0)
    """Sobel magnitude below which a pixel is no edge (grey steps x 8; by default of the picture in full light)."""
    sectors: int = Field(720, ge=90, le=7200)
    """Sectors of the histogram (II, step 4)."""
    min_length: float = Field(0.26, gt=0.0, le=1.0)
    """Votes that make a line, as a share of Rmax - Rmin. Paper: 0.5 (II, step 5)."""
    min_length_continued: float = Field(0.18, gt=0.0, le=1.0)
    """Shorter lines down to this may continue a track, never begin one. Not in the paper, unused in its mode."""
    max_lines: int = Field(200, ge=1, le=2000)
    """The strongest lines that are kept of one frame."""
    areas: Annotated[Literal[3, 5], BeforeValidator(whole)] = 3
    """Circular areas of the descriptor along the line (III); 5 overlap by half."""
    bins: Annotated[Literal[8, 16, 32], BeforeValidator(whole)] = 32
    """Bins of each orientation histogram, N_b (III)."""
    clip: float = Field(0.1, gt=0.0, le=1.0)
    """Histogram values are clipped here and scaled to unit length again (III)."""
    dissimilarity: Dissimilarity = "l2"
    """How unlike two lines are: by descriptors, or by patches of the panorama: ssd, zncc (IV, V). Paper: l2."""
    f1: float = Field(1.05, gt=0.0, le=4.0)
    """A match needs minD < F1 (eq. 8). Every dissimilarity is brought to the size of l2 first."""
    f2: float = Field(0.75, gt=0.0, le=4.0)
    """A match needs minD < F2 <D> (eq. 9)."""
    f3: float = Field(0.8, gt=0.0, le=4.0)
    """A match needs minD < F3 SminD (eq. 10)."""
    mutual: bool = False
    """The A_i nearest to B_j must be the one that B_j is nearest to. Not in the paper; only its mode goes by rules."""
    lookback_frames: int = Field(20, ge=1, le=1000)
    """A line without a match is looked for this many frames back (IX-A)."""
    bearing_std_deg: float = Field(0.018, gt=0.0, le=10.0)
    """What a bearing's sigma never falls below, however many points its line has [the paper is silent]."""

    @model_validator(mode="before")
    @classmethod
    def _paper_values(cls, given: Any) -> Any:
        if isinstance(given, dict) and given.get("mode") == "paper":
            return {**cls.PAPER, **given}
        return given
