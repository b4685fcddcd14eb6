"""Loops over arrays as machine code: the only place that knows the compiler."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """The kernel, compiled when it is first called and kept on disk for the next process.

    A kernel takes arrays and numbers, calls compiled kernels alone, and means the same as plain Python: no reordering
    of sums, so that the same bytes come out everywhere on one machine. It lets go of the interpreter while it runs.
    """
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True, error_model="numpy")(kernel))
