"""Worlds and paths that a person writes, and those that come with omnivert, by their names."""

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from omnivert.config.section import Section
from omnivert.errors import UseError

S = TypeVar("S", bound=Section)


def names(kind: str) -> list[str]:
    """Of the worlds or paths (`kind`) that come with omnivert."""
    return sorted(file.name.removesuffix(".toml") for file in _folder(kind).iterdir() if file.name.endswith(".toml"))


def loaded(name: str, kind: str, form: type[S]) -> S:
    """What a file says, or the one of this name that comes with omnivert.

    raises  UseError naming file and key
    """
    text = text_of(name, kind)
    try:
        return form.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise UseError("OV212", f"{name} cannot be parsed", str(error)) from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        because = first["msg"].removeprefix("Value error, ").lower()
        raise UseError("OV212", f"{name}: {place}" if place else name, because, "omnivert explain OV212") from error


def text_of(name: str, kind: str) -> str:
    """What the file of a person, or the one of this name that comes with omnivert, says.

    raises  UseError when there is none, or it cannot be read
    """
    known = names(kind)
    if name in known:
        return (_folder(kind) / f"{name}.toml").read_text(encoding="utf-8")
    if name.endswith(".toml"):
        try:
            return Path(name).read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise UseError("OV212", f"cannot read {name}", str(error), f"one of: {', '.join(known)}") from error
    near = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
    help = f"did you mean {' or '.join(near)}?" if near else f"one of: {', '.join(known)}; or a file, my.toml"
    raise UseError("OV212", f"there is no {kind.removesuffix('s')} {name}", help=help)


def _folder(kind: str) -> "resources.abc.Traversable":
    return resources.files("omnivert").joinpath("simulation", kind)
