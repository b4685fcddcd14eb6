"""What a service has counted, and the health message made of it."""

import threading
from collections import Counter, OrderedDict, deque

import numpy as np

from omnivert.messages import Health
from omnivert.wire.envelope import Envelope, missing_between

_MAX_KEYS = 200  # distinct keys, and reasons, that are counted apart
_MAX_SPEAKERS = 1000  # publishers whose sequence numbers are remembered
_OTHERS = "others"
_LONGEST_NS = 3600 * 10**9  # a longer latency is a wrong time


class Meter:
    """Counts, from any thread."""

    def __init__(self, service: str, instance: str, started_ns: int) -> None:
        self._service = service
        self._instance = instance
        self._started_ns = started_ns
        self._lock = threading.Lock()
        self._received: Counter[str] = Counter()
        self._published: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._gaps: Counter[str] = Counter()
        self._reordered: Counter[str] = Counter()
        self._restarts: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._latencies_ns: deque[int] = deque(maxlen=1000)
        self._notes: dict[str, str] = {}
        self._last: OrderedDict[tuple[str, bytes], int] = OrderedDict()  # key, incarnation -> sequence number
        self._speaker: OrderedDict[str, bytes] = OrderedDict()  # key -> incarnation heard last

    def received(self, key: str, envelope: Envelope) -> None:
        """Counts a message, and from its sequence number what is missing before it."""
        with self._lock:
            _count(self._received, key)
            speaker = (key, envelope.incarnation)
            last = self._last.get(speaker)
            if last is None:
                if self._speaker.get(key) is not None:
                    _count(self._restarts, key)
                self._last[speaker] = envelope.sequence
            elif envelope.sequence > last:
                if (missing := missing_between(last, envelope.sequence)) is not None:
                    if missing:
                        _count(self._gaps, key, missing)
                    self._last[speaker] = envelope.sequence
            else:
                _count(self._reordered, key)
            self._speaker[key] = envelope.incarnation
            for remembered in (self._last, self._speaker):
                if len(remembered) > _MAX_SPEAKERS:
                    remembered.popitem(last=False)

    def published(self, key: str) -> None:
        with self._lock:
            _count(self._published, key)

    def dropped(self, key: str) -> None:
        with self._lock:
            _count(self._dropped, key)

    def refused(self, reason: str, times: int = 1) -> None:
        with self._lock:
            _count(self._refused, _sendable(reason), times)

    def latency(self, duration_ns: int) -> None:
        """Counts a duration that can be one: the envelope that it comes from may hold any time."""
        if 0 <= duration_ns <= _LONGEST_NS:
            with self._lock:
                self._latencies_ns.append(duration_ns)

    def note(self, text: str | None, about: str) -> None:
        with self._lock:
            if text is None:
                self._notes.pop(about, None)
            else:
                self._notes[about] = _sendable(text)

    def health(self, now_ns: int) -> Health:
        with self._lock:
            latencies_ms = np.asarray(self._latencies_ns, dtype=np.float64) * 1e-6
            return Health(
                stamp_ns=now_ns,
                service=self._service,
                instance=self._instance,
                uptime_s=(now_ns - self._started_ns) * 1e-9,
                received=dict(self._received),
                published=dict(self._published),
                dropped=dict(self._dropped),
                gaps=dict(self._gaps),
                reordered=dict(self._reordered),
                restarts=dict(self._restarts),
                refused=dict(self._refused),
                latency_p50_ms=float(np.percentile(latencies_ms, 50)) if latencies_ms.size else None,
                latency_p99_ms=float(np.percentile(latencies_ms, 99)) if latencies_ms.size else None,
                notes=tuple(self._notes.values())[:16],
            )


def _sendable(text: str) -> str:
    """The text as a health message can carry it: file names and paths may hold bytes that are no UTF-8."""
    return text.encode(errors="replace").decode()[:1000]


def _count(counter: Counter[str], name: str, times: int = 1) -> None:
    """Adds; beyond a bound of distinct names, or for one that no health message can carry, under `others`."""
    if name not in counter and (len(counter) >= _MAX_KEYS or not name):
        name = _OTHERS
    counter[name] = min(counter[name] + times, 2**62)
