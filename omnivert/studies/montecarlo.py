"""Many drives in parallel processes."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from multiprocessing.connection import wait as wait_for
from typing import Any, TypeVar

from omnivert.config import Config
from omnivert.studies.presets import Case
from omnivert.studies.run import Oracle, Run, run_of
from omnivert.threads import one_thread

R = TypeVar("R")


def runs_of(
    cases: Sequence[Case],
    config: Config,
    runs: int,
    seed: int = 1,
    jobs: int = 1,
    oracle: Oracle | None = None,
) -> Generator[Run, None, None]:
    """Each case with the seeds from `seed` on, as they are done.

    jobs    processes; with 1 it all happens in this one
    oracle  a function of a module, so that another process finds it
    """
    todo = ((case, config, seed + k, oracle) for k in range(runs) for case in cases)
    yield from worked(run_of, todo, jobs)


def worked(work: Callable[..., R], todo: Iterator[tuple[Any, ...]], jobs: int) -> Generator[R, None, None]:
    """What the work makes of each tuple of arguments, as it is done.

    work  a function of a module, so that another process finds it
    jobs  processes; with 1 it all happens in this one
    """
    if jobs == 1:
        for job in todo:
            yield work(*job)
        return
    with _workers(jobs) as pool:
        # A few in hand alone: so an interruption is not held up by thousands that are told already.
        waiting: set[Future[R]] = {pool.submit(work, *job) for job in islice(todo, 2 * jobs)}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            waiting |= {pool.submit(work, *job) for job in islice(todo, len(done))}
            for future in done:
                yield future.result()


@contextmanager
def _workers(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with this block, however it is left, and with this process, however that ends."""
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin)
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


def _begin() -> None:
    """In a worker: ctrl-c is for the one who began it, and when that one is gone, so is the worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    one_thread()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait_for([sentinel])
    os._exit(1)
