"""Where results go: checked before the work, so that none is lost after it and nothing that is read is overwritten."""

import os
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

from omnivert.errors import DataError, OmnivertError, UseError

Files = Mapping[str, Path | None]  # what it is -> file, where there is one


def check_outputs(inputs: Files, outputs: Files) -> None:
    """Before long work: whether its results will find their place.

    inputs   files that the command reads, by what they are
    outputs  files that it writes, by their options
    raises   UseError when one would overwrite an input or another output, or its place is none; DataError when the
             system does not let it be written
    """
    check_distinct(inputs, outputs)
    for path in outputs.values():
        if path is not None:
            _check_place(path)


def check_distinct(inputs: Files, outputs: Files) -> None:
    """raises UseError when an output is one of the inputs, or another output"""
    written = [(option, path) for option, path in outputs.items() if path is not None and not _is_device(path)]
    for what, source in inputs.items():
        for _, path in written:
            if source is not None and _are_one(source, path):
                because = "what a command reads is never overwritten"
                raise UseError("OV208", f"{path} is the {what} itself", because, "choose another name")
    for (first, path), (second, other) in combinations(written, 2):
        if _are_one(path, other):
            because = f"{first} and {second} would overwrite each other"
            raise UseError("OV208", f"{path} is named twice", because, "choose another name")


def check_new_recording(path: Path) -> None:
    """raises UseError or DataError when a recording cannot be begun at this place"""
    if path.is_dir():
        help = f"choose a name in it, such as {path / 'drive.mcap'}"
        raise UseError("OV208", f"{path} is a folder", "a recording is one file", help)
    if path.exists():
        raise UseError("OV208", f"{path} exists already", "a recording is never overwritten", "choose another name")
    _check_place(path)


def check_new_folder(path: Path) -> None:
    """raises UseError or DataError when a folder cannot be begun at this place; an empty one is as good as none"""
    if path.is_dir() and not any(path.iterdir()):
        return
    if path.exists():
        what, because = f"{path} exists already", "nothing in it is overwritten"
        raise UseError("OV208", what, because, "choose another name, or an empty folder")
    _check_place(path)


def made_folder(path: Path) -> Path:
    """The folder, there from now on.

    raises  UseError when a file stands in the way, DataError when the system does not let it be made
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _refusal(path, error) from error
    return path


def _check_place(path: Path) -> None:
    if path.is_dir():
        raise UseError("OV322", f"cannot write {path}", "it is a folder", f"choose a name in it: {path / 'NAME'}")
    try:
        new = not path.exists()
        if new or path.is_file():  # to open a pipe would be heard at its other end
            path.open("ab").close()
        if new:
            Path(os.path.realpath(path)).unlink()
    except OSError as error:
        raise _refusal(path, error) from error


def _refusal(path: Path, error: OSError) -> OmnivertError:
    """A place that does not exist is wrong use; a disk that is full or read-only is not."""
    match error:
        case FileNotFoundError():
            return UseError(
                "OV322", f"cannot write {path}", f"there is no folder {path.parent}", f"mkdir {path.parent}"
            )
        case NotADirectoryError() | FileExistsError():
            return UseError("OV322", f"cannot write {path}", "a file stands in its way", "choose another name")
        case _:
            return DataError("OV322", f"cannot write {path}", error.strerror or str(error), "choose another place")


def _are_one(a: Path, b: Path) -> bool:
    return (a.exists() and b.exists() and a.samefile(b)) or os.path.realpath(a) == os.path.realpath(b)


def _is_device(path: Path) -> bool:
    """/dev/null and the like: nothing there can be overwritten."""
    return path.exists() and not path.is_file() and not path.is_dir()
