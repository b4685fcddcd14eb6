"""`omnivert config`: the settings in force as a TOML file, each with its meaning."""

import json
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

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
    lines = ["# omnivert's settings. A line left out takes its default; those commented out follow the mode."]
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
        mode = "# " if name in table.PAPER and value == usual else ""
        told = [f"default: {_toml(usual)}" if value != usual else "", _range(field)]
        also = "; ".join(filter(None, told))
        row = f"{mode}{name} = {_toml(value)}"
        if len(row) + len(also) + 4 > say.COLUMNS:  # above it then
            rows += _comment(also)
            also = ""
        rows.append(row + (also and f"  # {also}"))
    return rows


def _range(field: FieldInfo) -> str:
    """Which values it takes; "" where its form says so."""
    if get_origin(field.annotation) is Literal:
        return ", ".join(map(_toml, get_args(field.annotation)))
    bounds = {
        name: _number(bound)
        for name in ("gt", "ge", "le")
        for of in field.metadata
        if (bound := getattr(of, name, None)) is not None
    }
    low = bounds.get("ge", f"above {bounds.get('gt', '')}")
    return f"{low} to {bounds['le']}" if "le" in bounds else ""


def _number(value: Any) -> str:
    return str(int(value)) if float(value).is_integer() else f"{value:g}"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in say.folded(" ".join(text.split()), columns=say.COLUMNS - 2)]


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
