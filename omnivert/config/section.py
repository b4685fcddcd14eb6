"""What every table of settings has in common."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, StringConstraints


def whole(value: object) -> object:
    """A validator: to Python, and so to a Literal, true and 1.0 are 1."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("a whole number is needed")
    return value


Id = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,31}$")]  # one chunk of a key
Sign = Annotated[Literal[1, -1], BeforeValidator(whole)]


class Section(BaseModel):
    model_config = ConfigDict(
        strict=True, frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False
    )

    PAPER: ClassVar[Mapping[str, float]] = {}
    """What settings that are not given take with `mode = "paper"`."""
