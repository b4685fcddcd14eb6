"""A message as plain values, for JSON."""

import dataclasses
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Dataclasses become dicts, tuples and arrays become lists; all else stays what it is."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    match value:
        case np.ndarray():
            return value.tolist()
        case tuple() | list():
            return [plain(item) for item in value]
        case dict():
            return {str(key): plain(item) for key, item in value.items()}
        case _:
            return value
