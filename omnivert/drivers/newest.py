"""Room for one item, between the thread that captures and the one that publishes."""

from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class Newest(Generic[T]):
    """What comes displaces what nobody has taken yet, so that neither side waits for the other."""

    def __init__(self) -> None:
        self._changed = Condition()
        self._item: T | None = None
        self._closed = False
        self.displaced = 0

    def put(self, item: T, *, patient: bool = False) -> None:
        """patient: waits until the one before has been taken, for a source that can wait and would lose it."""
        with self._changed:
            if patient:
                self._changed.wait_for(lambda: self._item is None or self._closed)
            self.displaced += self._item is not None
            self._item = item
            self._changed.notify_all()

    def take(self, timeout_s: float) -> T | None:
        """The newest item, or None when none comes in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None, timeout_s)
            item, self._item = self._item, None
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Nobody takes any more: lets go who waits."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
