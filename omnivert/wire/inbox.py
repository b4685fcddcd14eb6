"""Where arrived messages wait, still as bytes, for the loop that takes them; bounded in number and size."""

import threading
from collections import deque
from dataclasses import dataclass

from omnivert.wire.channels import Channel, Delivery
from omnivert.wire.envelope import Envelope


@dataclass(frozen=True, slots=True)
class Parcel:
    """A message as it arrived."""

    channel: Channel
    key: str
    envelope: Envelope
    data: bytes


@dataclass(slots=True)
class _Slot:
    parcel: Parcel


class Inbox:
    """A queue. Of a LATEST channel only the newest live message waits, at the place of the one that it displaced.

    every  all of them wait, for whoever must miss none, and those that have come are given after it was closed, too
    """

    def __init__(self, max_messages: int, max_bytes: int, every: bool = False) -> None:
        self._every = every
        self._max_messages = max_messages
        self._max_bytes = max_bytes
        self._bytes = 0
        self._queue: deque[_Slot] = deque()
        self._latest: dict[str, _Slot] = {}
        self._changed = threading.Condition()
        self._closed = False

    def put(self, parcel: Parcel) -> list[Parcel]:
        """Adds a message and returns those that it displaced."""
        displaced: list[Parcel] = []
        with self._changed:
            if self._closed:
                return displaced
            self._bytes += len(parcel.data)
            displaces = parcel.channel.delivery is Delivery.LATEST and not parcel.envelope.replay and not self._every
            if displaces and (slot := self._latest.get(parcel.key)) is not None:
                displaced.append(slot.parcel)
                slot.parcel = parcel
            else:
                slot = _Slot(parcel)
                self._queue.append(slot)
                if displaces:
                    self._latest[parcel.key] = slot
            self._bytes -= sum(len(gone.data) for gone in displaced)
            while len(self._queue) > 1 and (len(self._queue) > self._max_messages or self._bytes > self._max_bytes):
                displaced.append(self._popped())
            self._changed.notify()
        return displaced

    def take(self, timeout_s: float) -> Parcel | None:
        """The oldest message; None after the timeout, or when the inbox is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed, timeout_s)
            return self._popped() if self._queue and not self.closed else None

    def close(self) -> None:
        """Wakes up whoever waits, and takes nothing more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """Whether nothing is given any more."""
        return self._closed and not (self._every and self._queue)

    def __len__(self) -> int:
        return len(self._queue)

    def _popped(self) -> Parcel:
        parcel = self._queue.popleft().parcel
        self._bytes -= len(parcel.data)
        if (slot := self._latest.get(parcel.key)) is not None and slot.parcel is parcel:
            del self._latest[parcel.key]
        return parcel
