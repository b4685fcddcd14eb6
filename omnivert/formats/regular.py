"""Reading files that somebody else has put there: a pipe or a device in place of one must not hold the import up."""

import os
import stat
from pathlib import Path


def content(path: Path) -> bytes:
    """The bytes of a regular file.

    raises  OSError, also when it is no regular file
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # to open a pipe would wait for its other end
    with open(handle, "rb") as file:  # noqa: PTH123 - what is open already has no path
        mode = os.fstat(file.fileno()).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(None, "Is a directory", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(None, "is no regular file", str(path))
        return file.read()
