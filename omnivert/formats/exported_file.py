"""A file or folder that appears when it is whole, and not before."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from omnivert.errors import DataError, UseError


@contextmanager
def appearing(out: Path) -> Iterator[Path]:
    """A place of the same name to write to; at the end, when nothing went wrong, what is there becomes `out`.

    raises  UseError when `out` is there already, DataError when the system does not let it be written
    """
    if out.exists():
        raise UseError("OV208", f"{out} exists already", "an export overwrites nothing", "choose another name")
    begun = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        begun.mkdir()
        yield begun / out.name
        (begun / out.name).rename(out)
    except OSError as error:
        raise DataError("OV322", f"cannot write {out}", error.strerror or str(error), "choose another place") from error
    finally:
        shutil.rmtree(begun, ignore_errors=True)
