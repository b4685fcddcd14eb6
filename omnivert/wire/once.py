"""No message is taken twice: a copy carries its original's envelope, and says something else perhaps."""

from collections import OrderedDict, deque

from omnivert.wire.envelope import Envelope

_MAX_SPEAKERS = 100
_MAX_NUMBERS = 1000  # of a speaker's messages, the last ones


class Once:
    """The sequence numbers of what has been taken, by key and publisher.

    They need not grow: a number that is out of all reason, from an envelope with a wrong bit, shuts nobody out.
    """

    def __init__(self) -> None:
        self._speakers: OrderedDict[tuple[str, bytes], tuple[deque[int], set[int]]] = OrderedDict()

    def has_taken(self, key: str, envelope: Envelope) -> bool:
        """Whether a message of this key, publisher and number has been taken."""
        _, known = self._speakers.get((key, envelope.incarnation), ((), frozenset[int]()))
        return envelope.sequence in known

    def take(self, key: str, envelope: Envelope) -> None:
        """It is a message, and it is taken now."""
        last, known = self._speakers.setdefault((key, envelope.incarnation), (deque(), set()))
        last.append(envelope.sequence)
        known.add(envelope.sequence)
        if len(last) > _MAX_NUMBERS:
            known.discard(last.popleft())
        if len(self._speakers) > _MAX_SPEAKERS:
            self._speakers.popitem(last=False)
