"""The smoother beside the pulse: keyframes wait while it works, and its results are taken up at fixed keyframes."""

from collections.abc import Callable
from typing import TypeVar

from omnivert.calibration.solver.batch import Batch
from omnivert.calibration.solver.parts import Recent
from omnivert.calibration.solver.result import Outcome, Result
from omnivert.calibration.solver.stretch import Keyed

R = TypeVar("R")
Job = Callable[[], R]
Background = Callable[[Job[R]], Job[R]]  # starts a job; what it gives back waits for the result

FIRST = 12  # keyframes before the first solution
EVERY = 4  # keyframes from one to the next, at least
SHARE = 50  # and at least the keyframes that are solved together, divided by this


def at_once(job: Job[R]) -> Job[R]:
    """No background: the job is done before anything else."""
    result = job()
    return lambda: result


class Smoothing:
    """Feeds a batch and asks it to solve. `outcome` changes only when `finished` is called."""

    def __init__(self, batch: Batch, background: Background[Outcome]) -> None:
        self.outcome = Outcome(None, (), None, 1.0, "", 0)
        self._batch = batch
        self._background = background
        self._under_way: Job[Outcome] | None = None
        self._queue: list[Keyed] = []
        self.keyframes = 0
        self._size = 0
        self._next = FIRST
        self._recent: Recent | None = None

    @property
    def result(self) -> Result | None:
        return self.outcome.result

    def recent(self) -> Recent | None:
        """The mount as the last part of the drive alone has it; each is told once."""
        told, self._recent = self._recent, None
        return told

    @property
    def size(self) -> int:
        """Keyframes that are solved together now."""
        return self._size

    @property
    def is_due(self) -> bool:
        return self.keyframes >= self._next

    def append(self, key: Keyed) -> None:
        self._queue.append(key)
        self.keyframes += 1

    def finished(self) -> Outcome | None:
        """The outcome of the work that was begun last, waited for if need be; None when there was none."""
        if self._under_way is None:
            return None
        self.outcome = self._under_way()
        self._under_way = None
        self._recent = None if self.outcome.result is None else self.outcome.result.recent
        return self.outcome

    def begin(self) -> None:
        """Work on all keyframes that have come."""
        for key in self._queue:
            self._batch.append(key)
        self._queue = []
        self._size = self._batch.size
        self._next = self.keyframes + max(EVERY, self._size // SHARE)
        self._under_way = self._background(self._batch.solve)
