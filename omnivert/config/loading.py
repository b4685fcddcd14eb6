"""A TOML file -> settings, or a refusal with the nearest right key or the unit that was probably meant."""

import difflib
import json
import tomllib
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omnivert.config.section import Section
from omnivert.config.settings import Config
from omnivert.errors import UseError

_LONGEST = 60  # characters of a value in a message


def load(path: Path) -> Config:
    """The settings in a TOML file, or in a JSON file of the same shape.

    raises  UseError naming file, key and the likely cure
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # some editors begin a file with a mark of its encoding
    except (OSError, UnicodeDecodeError) as error:
        raise UseError(
            "OV201", f"cannot read the configuration {path}", str(error), "omnivert config > robot.toml"
        ) from error
    try:
        given = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:  # both parsers' errors are ValueErrors
        raise UseError("OV202", f"{path} cannot be parsed", str(error)) from error
    except RecursionError as error:
        raise UseError("OV202", f"{path} cannot be parsed", "it is nested too deeply", "omnivert config") from error
    return parsed(given, str(path))


def parsed(given: object, where: str) -> Config:
    """The settings in what a TOML or JSON file holds, a dict of dicts; `where` names it in errors."""
    try:
        return Config.model_validate(given)
    except ValidationError as error:
        raise _refusal(error, where) from error


def with_rig(base: Config, rig: Mapping[str, Mapping[str, Any]], where: str) -> Config:
    """`base` with the values of a rig (`Config.rig`) in it; `where` names it in errors."""
    tables = base.model_dump(mode="json")
    for table, values in rig.items():
        tables[table] = {**tables.get(table, {}), **values}
    return parsed(tables, where)


def _refusal(error: ValidationError, where: str) -> UseError:
    first = error.errors()[0]
    place = ".".join(_printable(str(part)) for part in first["loc"])
    value = first["input"]
    if first["type"] == "extra_forbidden":
        return UseError("OV203", f"{where}: unknown key {place}", help=_nearest(first["loc"]))
    what = f"{where}: {place}" if place else where
    if not isinstance(value, dict):
        what += f" = {_said(value)}" if place else f": {_said(value)}"
    if first["type"] in _TYPES:
        return UseError("OV204", what, *_TYPES[first["type"]])
    return UseError("OV204", what, first["msg"].removeprefix("Value error, "), _unit(place, value))


_TYPES = {  # what pydantic calls a wrong type -> what is needed, and how it is written
    "model_type": ("a table is needed", "[robot], with lines NAME = VALUE below it"),
    "float_type": ("a number is needed", "a plain number, without quotes; its unit is in its name"),
    "int_type": ("a whole number is needed", "a plain number, without quotes and point; its unit is in its name"),
    "bool_type": ("true or false is needed", "without quotes"),
    "string_type": ("a text is needed", 'in quotes, such as "front"'),
    "path_type": ("a path is needed", 'in quotes, such as "extrinsics.db"'),
    "tuple_type": ("a list is needed", "in brackets, such as [321.5, 239.0]"),
    "missing": ("two numbers are needed", "in brackets, such as [321.5, 239.0]"),
    "too_long": ("two numbers are needed", "in brackets, such as [321.5, 239.0]"),
}


def _said(value: object) -> str:
    """A value in one short line, as JSON writes it where it can."""
    try:
        text = json.dumps(value)
    except (TypeError, ValueError, RecursionError):  # such as a date of TOML, or a number of thousands of digits
        text = str(type(value).__name__)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _printable(text: str) -> str:
    return text if text.isprintable() else json.dumps(text)


def _nearest(place: tuple[int | str, ...]) -> str:
    fields = set(Config.model_fields)
    if len(place) > 1 and place[0] in fields:
        section = Config.model_fields[str(place[0])].annotation
        fields = set(section.model_fields) if isinstance(section, type) and issubclass(section, Section) else set()
    near = difflib.get_close_matches(str(place[-1]), sorted(fields), n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"known keys: {', '.join(sorted(fields))}"


def _unit(place: str, value: object) -> str:
    """The value that was probably meant, where a length was given in millimetres or an angle in the other unit."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return ""
    if place.endswith("_m") and value > 1:
        return f"lengths are in metres; {value:g} mm would be {value / 1000:g}"
    if place.endswith("_rad"):
        return f"angles named _rad are in radians; {value:g} deg would be {radians(value):.4f}"
    return ""
