"""`omnivert config`: the settings in force as a TOML file, each with its meaning."""

import json
import textwrap
from typing import Any

from omnivert.cli import say
from omnivert.cli.settings import ConfigOption, JsonOption, settings
from omnivert.config import Config, Section


def config(path: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Print the settings in force, annotated: omnivert config > robot.toml"""
    chosen = settings(path)
    if as_json:
        say.json_result(chosen.model_dump(mode="json"))
    else:
        say.result(annotated(chosen))


def annotated(config: Config) -> str:
    """The settings as TOML, meaning and unit of each above it."""
    lines = ["# omnivert's settings. A line that is left out takes its default; those commented out follow the mode."]
    for name, field in type(config).model_fields.items():
        table = getattr(config, name)
        lines += ["", f"[{name}]"]
        lines += _comment((table.__doc__ or field.description or "").strip())
        lines += _rows(table)
    return "\n".join(lines)


def _rows(table: Section) -> list[str]:
    """A line for each setting; one that follows the mode is commented out, so that it follows a change of mode, too."""
    default, rows = type(table)(), []
    by_mode = type(table).model_validate({"mode": getattr(table, "mode", None)}) if table.PAPER else default
    for name, field in type(table).model_fields.items():
        value = getattr(table, name)
        rows += _comment(field.description or "")
        usual = getattr(by_mode if name in table.PAPER else default, name)
        if name in table.PAPER and value == usual:
            rows.append(f"# {name} = {_toml(value)}")
        else:
            rows.append(f"{name} = {_toml(value)}" + (f"  # default: {_toml(usual)}" if value != usual else ""))
    return rows


def _comment(text: str) -> list[str]:
    words = " ".join(text.split())
    return [f"# {line}" for line in textwrap.wrap(words, 110)]


def _toml(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case tuple() | list():
            return "[" + ", ".join(_toml(item) for item in value) + "]"
        case _:
            return json.dumps(str(value), ensure_ascii=False)  # a JSON string is a TOML string
