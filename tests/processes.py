"""Processes that a test starts and that do not outlive it."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import AnyStr


@contextmanager
def own(process: subprocess.Popen[AnyStr]) -> Iterator[subprocess.Popen[AnyStr]]:
    """As `with process`, but when the test fails inside it is killed; `Popen` alone would wait for its end for ever."""
    with process:
        try:
            yield process
        except BaseException:
            process.kill()
            raise
