"""A TOML file -> settings, or a refusal with the nearest right key or the unit that was probably meant."""

import difflib
import json
import tomllib
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omnivert.config.settings import Config, Section
from omnivert.errors import UseError


def load(path: Path) -> Config:
    """The settings in a TOML file, or in a JSON file of the same shape.

    raises  UseError naming file, key and the likely cure
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UseError(
            "OV201", f"cannot read the configuration {path}", str(error), "omnivert config > robot.toml"
        ) from error
    try:
        given = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except ValueError as error:  # both parsers' errors are ValueErrors
        raise UseError("OV202", f"{path} cannot be parsed", str(error)) from error
    return parsed(given, str(path))


def parsed(given: dict[str, Any], where: str) -> Config:
    """The settings in a nested dict of a TOML file; `where` names it in errors."""
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
    place = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return UseError("OV203", f"{where}: unknown key {place}", help=_nearest(first["loc"]))
    value = first["input"]
    given = f" = {value!r}" if isinstance(value, (int, float, str)) else ""
    return UseError(
        "OV204", f"{where}: {place}{given}", first["msg"].removeprefix("Value error, "), _unit(place, value)
    )


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
