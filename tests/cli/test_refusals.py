"""Every refusal is explained, and every command that a help names exists."""

import ast
import re
from pathlib import Path
from typing import Any

import pytest

from omnivert.cli.explain.explanations import EXPLANATIONS

PROJECT = Path(__file__).resolve().parents[2]
SOURCES = sorted(path for top in ("omnivert", "services") for path in (PROJECT / top).rglob("*.py"))
GROUPS = {
    "import": {"frames", "bearings", "rosbag"},
    "extrinsics": {"list", "show", "history", "export"},
    "bench": {"pipeline", "vision", "ticks"},
    "rec": {"info", "cut", "merge", "export"},
    "setup": {"ring"},
}
SINGLE = {"demo", "up", "monitor", "drive", "record", "play"}
SINGLE |= {"calibrate", "track", "doctor", "simulate", "config", "explain"}


def texts(node: ast.AST) -> list[str]:
    return [part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and isinstance(part.value, str)]


def helps() -> list[str]:
    """The help of every error that is made in the sources, and every cure."""
    found = [explanation.cure for explanation in EXPLANATIONS.values()]
    for path in SOURCES:
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "").endswith("Error"):
                given = [*call.args[3:4], *(keyword.value for keyword in call.keywords if keyword.arg == "help")]
                found += [text for node in given for text in texts(node)]
    return found


COMMAND = re.compile(r"\bomnivert ([a-z]+)(?: ([a-z]+))?((?:(?!\bomnivert\b)[^,;\n])*)")
NAMED = sorted({match for text in helps() for match in COMMAND.findall(text)})


def test_every_code_in_use_is_explained_and_no_other() -> None:
    used = {
        code
        for path in SOURCES
        if not path.name.startswith("explanations")
        for code in re.findall(r'"(OV\d{3})"', path.read_text(encoding="utf-8"))
    }
    assert used == set(EXPLANATIONS)


def test_there_are_helps_with_commands() -> None:
    assert len(NAMED) > 15


@pytest.mark.parametrize(("first", "second", "tail"), NAMED)
def test_a_command_that_a_help_names_exists_with_its_options(omnivert: Any, first: str, second: str, tail: str) -> None:
    assert first in SINGLE | set(GROUPS)
    command = [first]
    if first in GROUPS:
        assert second in GROUPS[first]
        command.append(second)
    shown = omnivert(*command, "--help").out
    for option in re.findall(r"(?<=\s)--?[a-z][a-z-]*", tail):
        assert option in shown


@pytest.mark.parametrize("code", sorted(EXPLANATIONS))
def test_a_code_is_explained_by_meaning_and_cure(omnivert: Any, code: str) -> None:
    ran = omnivert("explain", code.lower())
    assert ran.code == 0
    assert ran.out.startswith(code)
    assert len(EXPLANATIONS[code].meaning) > 40
    assert EXPLANATIONS[code].cure


def test_all_codes_can_be_listed(omnivert: Any) -> None:
    assert set(omnivert("explain", "--json").json) == set(EXPLANATIONS)
    assert len(omnivert("explain").out.splitlines()) == len(EXPLANATIONS)
