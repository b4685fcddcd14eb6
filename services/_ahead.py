"""Reading ahead in a thread, so that what is due next is there already."""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

T = TypeVar("T")


@contextmanager
def read_ahead(items: Iterator[T], size: Callable[[T], int], most: int) -> Iterator[Iterator[T]]:
    """The same items, of which a thread has up to `most` in `size` ready, one at least; it ends with the block.

    The block begins when so much is ready, or all there is: while a thread reads as fast as it can, nothing else in
    the process keeps its time. What reading raises is raised where the item would have come.
    """
    reader = _Reader(items, size, most)
    thread = threading.Thread(target=reader.read, name="read-ahead", daemon=True)
    thread.start()
    try:
        reader.await_ready()
        yield reader.taken()
    finally:
        reader.stop()
        thread.join()


class _Reader(Generic[T]):
    """The queue between the thread and whoever takes."""

    def __init__(self, items: Iterator[T], size: Callable[[T], int], most: int) -> None:
        self._items = items
        self._size = size
        self._most = most
        self._ready: deque[tuple[T, int]] = deque()
        self._sum = 0
        self._changed = threading.Condition()
        self._over = False
        self._error: Exception | None = None

    def read(self) -> None:
        """The thread."""
        try:
            for item in self._items:
                size = self._size(item)
                with self._changed:
                    self._changed.wait_for(lambda: self._over or self._sum < self._most or not self._ready)
                    if self._over:
                        return
                    self._ready.append((item, size))
                    self._sum += size
                    self._changed.notify_all()
        except Exception as error:  # noqa: BLE001 - whoever takes gets it
            self._error = error
        finally:
            self.stop()

    def await_ready(self) -> None:
        """Until as much is ready as may be, or nothing more comes."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or (self._ready and self._sum >= self._most))

    def taken(self) -> Iterator[T]:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ready or self._over)
                if not self._ready:
                    break
                item, size = self._ready.popleft()
                self._sum -= size
                self._changed.notify_all()
            yield item
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        with self._changed:
            self._over = True
            self._changed.notify_all()
