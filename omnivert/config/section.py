"""What every table of settings has in common."""

from collections.abc import Mapping
from typing import ClassVar

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    model_config = ConfigDict(
        strict=True, frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False
    )

    PAPER: ClassVar[Mapping[str, float]] = {}
    """What settings that are not given take with `mode = "paper"`."""
