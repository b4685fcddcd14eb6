"""Settings changed in a person's own configuration file: their comments, order and other settings stay."""

import os
import shutil
from collections.abc import Mapping
from errno import EACCES
from pathlib import Path
from shlex import quote
from typing import Any

import tomlkit
import tomlkit.items
from tomlkit.exceptions import TOMLKitError

from omnivert.config import parsed
from omnivert.errors import DataError, UseError

Changes = Mapping[str, Mapping[str, Any]]  # table -> key -> value


def check_editable(path: Path) -> None:
    """raises UseError when it is a configuration of a kind that cannot be changed in place"""
    if path.suffix == ".json":
        raise UseError(
            "OV208",
            f"{path} is not changed",
            "only a TOML file is",
            f"omnivert config -c {quote(str(path))} > robot.toml",
        )


def edited(text: str, changes: Changes, where: str) -> str:
    """The text of a TOML file with these settings in it, held to their form as when it is loaded.

    What is added ends its lines as the file does.

    raises  UseError when the changed settings do not go together with the others
    """
    try:
        document = tomlkit.parse(text)
        for table, values in changes.items():
            if table not in document:
                document[table] = tomlkit.table()
            settings: Any = document[table]
            for key, value in values.items():
                _put(settings, key, value)
    except (TOMLKitError, TypeError) as error:
        raise UseError("OV202", f"{where} cannot be changed", str(error)) from error
    parsed(document.unwrap(), where)
    new = tomlkit.dumps(document)
    if 0 < text.count("\n") == text.count("\r\n"):
        new = new.replace("\r\n", "\n").replace("\n", "\r\n")
    return new


def _put(settings: Any, key: str, value: Any) -> None:
    """Of a list each item by itself, where there are as many: what stands between them is a person's."""
    if key in settings and isinstance(value, list):
        held = settings[key]
        if isinstance(held, tomlkit.items.Array) and len(held) == len(value):
            for place, item in enumerate(value):
                held[place] = item
            return
    settings[key] = value


def edit(path: Path, changes: Changes) -> None:
    """Change these settings in the file, all at once or not at all.

    raises  UseError when they do not go together with its others; DataError when it cannot be written
    """
    target = Path(os.path.realpath(path))
    beside = target.with_name(f".{target.name}.{os.getpid()}.new")
    try:
        if not target.stat().st_mode & 0o222:  # to put another in its place, the folder's permission would do
            raise PermissionError(EACCES, "it is write-protected")
        held = target.read_bytes()
        text = edited(held.decode("utf-8-sig"), changes, str(path))
        mark = b"\xef\xbb\xbf" if held.startswith(b"\xef\xbb\xbf") else b""
        beside.write_bytes(mark + text.encode())
        shutil.copymode(target, beside)
        beside.replace(target)
    except OSError as error:
        raise DataError(
            "OV322", f"cannot write {path}", error.strerror or str(error), "choose another place"
        ) from error
    finally:
        beside.unlink(missing_ok=True)
