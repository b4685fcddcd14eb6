"""Messages in by arrival, out by stamp: what everything after it may rely on.

A message goes on when every stream has passed its stamp, so the order does not depend on arrival. Live, a stream that
lags is waited for no longer than `lateness_s`, measured by the stamps themselves. A stamp that does not fit its stream
(repeated, reversed, far ahead) is refused, until several in a row agree with each other: then the clock has changed.
"""

from collections import Counter, deque

from omnivert.config import Timeline as Settings
from omnivert.messages import Message

_STARTING = 2  # messages that must agree before a stream has begun


class Timeline:
    """Puts streams into one order.

    streams   types of the messages; at equal stamps the earlier in this tuple goes first
    refused   messages that were dropped, by reason
    late      by stream: messages of others that went on without waiting for it any longer
    """

    def __init__(self, streams: tuple[type[Message], ...], settings: Settings) -> None:
        self.refused: Counter[str] = Counter()
        self.late: Counter[str] = Counter()
        self._streams = {stream: _Stream(stream.__name__, settings, self.refused) for stream in streams}
        self._lateness_ns = round(settings.lateness_s * 1e9)
        self._max_held = settings.max_held
        self._released_ns = -1
        self._replay = False

    def push(self, message: Message, replay: bool) -> list[Message]:
        """Takes a message and returns those that may go on now, in order.

        replay   every stream is waited for
        raises   ValueError for a message of no stream of this timeline
        """
        stream = self._streams.get(type(message))
        if stream is None:
            raise ValueError(f"{type(message).__name__} is not one of this timeline's streams")
        self._replay = replay
        accepted = stream.accepted(message, self._others_span(stream))
        out: list[Message] = []
        if stream.clock_changed:
            out = self.drain()
            self._begin_anew(stream)
        self._hold(stream, accepted)
        for other in self._streams.values():
            if other.newest_ns is None and accepted:
                self._hold(other, other.reconsidered(self._others_span(other)))
        return out + self._released()

    def drain(self) -> list[Message]:
        """All that is held, in order: for the end of a recording, when nothing comes any more."""
        for stream in self._streams.values():
            self._hold(stream, stream.last_chance())
        return self._released(all_of_them=True)

    def _others_span(self, stream: "_Stream") -> tuple[int, int] | None:
        """The stamps that the other streams have shown on this clock; None before they have."""
        others = [other for other in self._streams.values() if other is not stream and other.newest_ns is not None]
        if not others:
            return None
        return min(other.first_ns for other in others), max(other.newest_ns or 0 for other in others)

    def _begin_anew(self, stream: "_Stream") -> None:
        """The clock has changed: what the other streams have shown says nothing about the new one."""
        self._released_ns = -1
        for other in self._streams.values():
            if other is not stream:
                other.newest_ns = None
        stream.clock_changed = False

    def _hold(self, stream: "_Stream", accepted: list[Message]) -> None:
        for message in accepted:
            if message.stamp_ns < self._released_ns:
                self.refused[f"{stream.name}: came too late"] += 1
            else:
                stream.held.append(message)

    def _released(self, all_of_them: bool = False) -> list[Message]:
        out: list[Message] = []
        streams = tuple(self._streams.values())
        while True:
            heads = [stream for stream in streams if stream.held]
            if not heads:
                return out
            first = min(heads, key=lambda stream: stream.held[0].stamp_ns)  # the earlier one at equal stamps
            stamp = first.held[0].stamp_ns
            lagging = [
                stream
                for stream in streams
                if not stream.held and (stream.newest_ns is None or stream.newest_ns < stamp) and stream is not first
            ]
            if lagging and not all_of_them:
                if not self._patience_is_over(stamp):
                    return out
                for stream in lagging:
                    self.late[stream.name] += 1
            self._released_ns = stamp
            out.append(first.held.popleft())

    def _patience_is_over(self, stamp: int) -> bool:
        if sum(len(stream.held) for stream in self._streams.values()) > self._max_held:
            return True
        newest = max(stream.newest_ns for stream in self._streams.values() if stream.newest_ns is not None)
        return not self._replay and newest - stamp > self._lateness_ns


class LoneStream:
    """A stream that waits for no other: what fits goes on at once, also the first message, which nothing contradicts.

    refused   messages that were dropped, by reason
    """

    def __init__(self, stream: type[Message], settings: Settings) -> None:
        self.refused: Counter[str] = Counter()
        self._stream = _Stream(stream.__name__, settings, self.refused, starting=1)

    def push(self, message: Message) -> list[Message]:
        """Takes a message and returns those that may go on now, in rising order of stamp."""
        return self._stream.accepted(message, others=None)


class _Stream:
    """One stream: which of its stamps are believed.

    starting   messages that must agree before it has begun
    """

    def __init__(self, name: str, settings: Settings, refused: Counter[str], starting: int = _STARTING) -> None:
        self.name = name
        self.held: deque[Message] = deque()
        self.first_ns = 0  # on this clock
        self.newest_ns: int | None = None  # None: has not begun on this clock
        self.clock_changed = False
        self._refused = refused
        self._max_jump_ns = round(settings.max_jump_s * 1e9)
        self._confirmations = settings.confirmations
        self._starting = starting
        self._doubted: list[Message] = []  # do not fit, but fit each other

    def accepted(self, message: Message, others: tuple[int, int] | None) -> list[Message]:
        """The messages that are believed now that this one has come, in rising order of stamp."""
        stamp = message.stamp_ns
        if self.newest_ns is not None and self.newest_ns < stamp <= self.newest_ns + self._max_jump_ns:
            self._refuse_doubted()
            self.newest_ns = stamp
            return [message]
        if stamp == self.newest_ns or (self._doubted and stamp == self._doubted[-1].stamp_ns):
            self._refused[f"{self.name}: repeated stamp"] += 1
            return []
        if self._doubted and not 0 < stamp - self._doubted[-1].stamp_ns <= self._max_jump_ns:
            self._refuse_doubted()
        self._doubted.append(message)
        return self.reconsidered(others)

    def reconsidered(self, others: tuple[int, int] | None) -> list[Message]:
        """The doubted messages, when there are enough of them to be believed."""
        if not self._doubted:
            return []
        first, last = self._doubted[0].stamp_ns, self._doubted[-1].stamp_ns
        near = others is None or others[0] - self._max_jump_ns <= first <= others[1] + self._max_jump_ns
        starting = self.newest_ns is None and near
        if len(self._doubted) < (self._starting if starting else self._confirmations):
            return []
        self.clock_changed = not starting and (self.newest_ns is None or first <= self.newest_ns)
        if starting or self.clock_changed:
            self.first_ns = first
        self.newest_ns = last
        believed, self._doubted = self._doubted, []
        return believed

    def last_chance(self) -> list[Message]:
        """A single message that had no second one to agree with."""
        believed = self._doubted if self.newest_ns is None else []
        if believed:
            self.first_ns, self.newest_ns = believed[0].stamp_ns, believed[-1].stamp_ns
            self._doubted = []
        return believed

    def _refuse_doubted(self) -> None:
        for message in self._doubted:
            if self.newest_ns is None:
                reason = "contradicts the next stamp"
            else:
                reason = "reversed stamp" if message.stamp_ns < self.newest_ns else "stamp far ahead"
            self._refused[f"{self.name}: {reason}"] += 1
        self._doubted.clear()
