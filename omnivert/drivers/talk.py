"""When a device is asked, and when it read its counters: one talk for each way of theirs.

Heard   it sends by itself, and tells its own time
Asked   it answers; it read its counters between the question and the answer
Begun   it sends on once it was told to begin; it read its counters when it began to send
"""

from dataclasses import dataclass

from omnivert.config import Encoder
from omnivert.drivers.device_clock import NS_PER_US
from omnivert.drivers.lateness import Lateness
from omnivert.drivers.least import Least
from omnivert.drivers.protocols.sample import Parser, Polled, Sample, Streaming

BITS_PER_BYTE = 10  # start and stop with it
SECOND = 10**9
ANSWER_NS = 100_000_000  # no answer comes after that
GAP_NS = 20_000_000  # nor does one that has paused for so long go on
LONGEST_NS = SECOND  # what goes on without a pause for so long is no answer
BEGIN_AGAIN_NS = SECOND  # a stream that is silent for so long is asked for again
STALLED_NS = SECOND // 2  # what had to wait in the port for so long was sent at any time


@dataclass(frozen=True, slots=True)
class Timed:
    """A reading with the time at which it was read, by the device's clock or the bridge's."""

    time_us: int
    left: int  # raw counts
    right: int
    until_ns: int  # by the bridge's clock: it was read no later
    slack_s: float = 0.0  # so much longer ago the reading before may have been


class Heard:
    """A device that sends by itself, and tells its own time."""

    def __init__(self, config: Encoder, parser: Parser) -> None:
        self._parser = parser
        self._byte_ns = BITS_PER_BYTE * SECOND // config.baud

    def question(self, now_ns: int) -> bytes:
        return b""

    def idle_s(self, now_ns: int) -> float:
        return 0.0

    def step(self, data: bytes, arrival_ns: int) -> list[Timed]:
        return [
            Timed(sample.device_us, sample.left, sample.right, arrival_ns - sample.wire_bytes * self._byte_ns)
            for sample in self._parser.feed(data)
            if sample.device_us is not None
        ]

    def reopened(self) -> None:
        """Nothing was asked."""

    def __str__(self) -> str:
        return ""


class Asked:
    """A device that answers.

    Of the time from question to answer, what the bytes take on the wire is known, and the rest is shared evenly by the
    ways there and back. What an answer takes longer than the fastest was spent on the way back: serial adapters hold
    back what comes in, not what goes out. After an answer that did not come whole and in time the next one is passed
    over, because it may be the late one.
    """

    def __init__(self, config: Encoder, parser: Polled) -> None:
        self._parser = parser
        self._byte_ns = BITS_PER_BYTE * SECOND // config.baud
        self._period_ns = round(SECOND / config.poll_rate_hz)
        self._window_ns = int(config.clock_window_s * SECOND)
        self._fastest = Least(self._window_ns)
        self._lateness = Lateness()
        self._due_ns = 0
        self._asked_ns = 0
        self._heard_ns = 0
        self._doubted = False  # the answer that comes now

    def question(self, now_ns: int) -> bytes:
        if now_ns < self._due_ns or (self._parser.awaits and not self._is_silent(now_ns)):
            return b""
        self._doubted = self._parser.awaits
        self._due_ns = max(self._due_ns, now_ns - self._period_ns) + self._period_ns
        self._asked_ns = now_ns
        return self._parser.request()

    def _is_silent(self, now_ns: int) -> bool:
        """Whether no answer will come any more, or no more of one."""
        if self._heard_ns > self._asked_ns and now_ns - self._asked_ns <= LONGEST_NS:
            return now_ns - self._heard_ns > GAP_NS
        return now_ns - self._asked_ns > ANSWER_NS

    def idle_s(self, now_ns: int) -> float:
        return 0.0 if self._parser.awaits else max(self._due_ns - now_ns, 0) / SECOND

    def step(self, data: bytes, arrival_ns: int) -> list[Timed]:
        if data:
            self._heard_ns = arrival_ns
        samples = self._parser.feed(data)
        return [] if self._doubted else [self._timed(sample, arrival_ns) for sample in samples]

    def _timed(self, sample: Sample, arrival_ns: int) -> Timed:
        before_ns, wire_ns = sample.before_bytes * self._byte_ns, sample.wire_bytes * self._byte_ns
        spare_ns = arrival_ns - self._asked_ns - wire_ns
        least_ns = self._fastest.step(arrival_ns, spare_ns)
        self._lateness.add(spare_ns - least_ns)
        # Over USB bytes may go faster than the baud says: the answer came before its bytes could have passed.
        read_ns = before_ns + (least_ns // 2 if least_ns >= 0 else least_ns * before_ns // wire_ns)
        time_us = (self._asked_ns + read_ns) // NS_PER_US
        return Timed(time_us, sample.left, sample.right, arrival_ns, (spare_ns - least_ns) / SECOND)

    def reopened(self) -> None:
        self._due_ns = 0
        self._doubted = False
        self._fastest = Least(self._window_ns)

    def __str__(self) -> str:
        late = str(self._lateness)
        return late and f"none, stamped between question and answer; answers come {late} after the fastest"


class Begun:
    """A device that sends on once it was told to begin."""

    def __init__(self, config: Encoder, parser: Streaming) -> None:
        self._parser = parser
        self._byte_ns = BITS_PER_BYTE * SECOND // config.baud
        self._told_ns: int | None = None
        self._looked_ns: int | None = None
        self._stamp_ns = 0
        self._lateness = Lateness()

    def question(self, now_ns: int) -> bytes:
        if self._told_ns is not None and now_ns - max(self._told_ns, self._stamp_ns) < BEGIN_AGAIN_NS:
            return b""
        self._told_ns = now_ns
        return self._parser.request()

    def idle_s(self, now_ns: int) -> float:
        return 0.0

    def step(self, data: bytes, arrival_ns: int) -> list[Timed]:
        """The last of them was sent as it arrived, those before it a period earlier each, as far as there was time."""
        samples = self._parser.feed(data)
        stalled = self._looked_ns is not None and arrival_ns - self._looked_ns > STALLED_NS
        self._looked_ns = arrival_ns
        if not samples:
            return []
        if stalled:
            self._parser.refused["waited too long to be stamped"] += len(samples)
            return []
        period_ns = self._parser.period_ns
        wire_ns = samples[-1].wire_bytes * self._byte_ns
        last_ns = max(arrival_ns - wire_ns, self._stamp_ns + NS_PER_US * len(samples))
        step_ns = min(period_ns, (last_ns - self._stamp_ns) // len(samples))
        if self._stamp_ns:
            since_ns = last_ns - self._stamp_ns
            periods = max(round(since_ns / period_ns), len(samples))  # more where some were lost
            self._lateness.add(abs(since_ns - periods * period_ns))
        self._stamp_ns = last_ns
        return [
            Timed((last_ns - k * step_ns) // NS_PER_US, sample.left, sample.right, arrival_ns, period_ns / SECOND)
            for k, sample in zip(reversed(range(len(samples))), samples, strict=True)
        ]

    def reopened(self) -> None:
        self._told_ns = self._looked_ns = None

    def __str__(self) -> str:
        late = str(self._lateness)
        return late and f"none, stamped on arrival; packets come {late} off their rhythm"
