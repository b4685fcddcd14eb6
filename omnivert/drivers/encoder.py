"""Bytes of an encoder's line, with the time they arrived -> Ticks on the bridge's clock."""

from collections import Counter

from omnivert.config import Encoder
from omnivert.drivers.counters import CounterPair, Jump
from omnivert.drivers.device_clock import DeviceClock
from omnivert.drivers.line_protocol import DEVICE_TIME_SPAN_US, LineParser, Sample
from omnivert.messages import Ticks

RESTARTED = "device restarted; what it drove meanwhile is lost"
EARLY_NS = 10**9  # a line this much ahead of its own clock is not of that clock


class EncoderLine:
    """A stepper: knows no port and asks no time.

    Out come only samples whose device time grows and whose counts a wheel can have made; what is refused is counted.
    """

    def __init__(self, config: Encoder) -> None:
        self._config = config
        self._parser = LineParser()
        self._counters = CounterPair(config)
        self._clock = DeviceClock(config)
        self._refused: Counter[str] = Counter()
        self._last: Sample | None = None
        self._device_us = 0  # rollover undone
        self._arrival_ns = 0
        self._stamp_ns = 0
        self._doubted: list[Sample] = []
        self._reopened = False

    @property
    def refused(self) -> dict[str, int]:
        """Lines left out so far, by reason."""
        return dict(self._parser.refused + self._refused)

    def step(self, data: bytes, arrival_ns: int) -> list[Ticks]:
        """The readings that these bytes complete, in order of their growing stamps."""
        steps = (self._reading(sample, arrival_ns) for sample in self._parser.feed(data))
        return [ticks for ticks in steps if ticks is not None]

    def reopened(self) -> None:
        """The port was lost and is back: the device may have gone on, or begun anew."""
        self._parser.reset()
        self._doubted.clear()
        self._reopened = True

    def _reading(self, sample: Sample, arrival_ns: int) -> Ticks | None:
        if self._last is None:
            return self._accepted(
                sample, arrival_ns, sample.device_us, self._counters.step(sample.left, sample.right, 0.0)
            )
        if self._reopened:
            self._reopened = False
            silent_us = (arrival_ns - self._arrival_ns) // 1000
            if abs(_advance(self._last.device_us + silent_us, sample.device_us)) * 1000 > EARLY_NS:
                return self._restarted(sample, arrival_ns)
        advance_us = _advance(self._last.device_us, sample.device_us)
        if advance_us <= 0:
            return self._refuse(
                "device time repeated" if advance_us == 0 else "device time reversed", sample, arrival_ns
            )
        if self._clock.early_ns(self._device_us + advance_us, arrival_ns) > EARLY_NS:
            return self._refuse("device time ahead", sample, arrival_ns)
        counts = self._counters.step(sample.left, sample.right, advance_us * 1e-6)
        return self._accepted(sample, arrival_ns, self._device_us + advance_us, counts)

    def _accepted(
        self, sample: Sample, arrival_ns: int, device_us: int, counts: tuple[int, int] | Jump
    ) -> Ticks | None:
        if isinstance(counts, Jump):
            return self._refuse(counts.reason, sample, arrival_ns)
        self._doubted.clear()
        self._last, self._device_us, self._arrival_ns = sample, device_us, arrival_ns
        # A clock that is still being learnt may step back by its own uncertainty; stamps never do.
        self._stamp_ns = max(self._clock.step(device_us, arrival_ns), self._stamp_ns + 1)
        return Ticks(self._stamp_ns, *counts)

    def _refuse(self, reason: str, sample: Sample, arrival_ns: int) -> Ticks | None:
        """Counts it, unless it is the last of a row that tells a new beginning."""
        self._refused[reason] += 1
        if self._doubted and not self._follows(self._doubted[-1], sample):
            self._doubted.clear()
        self._doubted.append(sample)
        if self._last is None or len(self._doubted) < self._config.restart_after_lines:
            return None
        return self._restarted(sample, arrival_ns)

    def _follows(self, before: Sample, sample: Sample) -> bool:
        """Whether the two can be neighbouring readings of one device."""
        advance_us = _advance(before.device_us, sample.device_us)
        probe = CounterPair(self._config)
        if advance_us <= 0 or isinstance(probe.step(before.left, before.right, 0.0), Jump):
            return False
        return not isinstance(probe.step(sample.left, sample.right, advance_us * 1e-6), Jump)

    def _restarted(self, sample: Sample, arrival_ns: int) -> Ticks | None:
        self._refused[RESTARTED] += 1
        self._doubted.clear()
        self._clock = DeviceClock(self._config)
        return self._accepted(sample, arrival_ns, sample.device_us, self._counters.restart(sample.left, sample.right))


def _advance(before_us: int, after_us: int) -> int:
    """How far the device's clock has gone on, its rollover undone; negative when it went back; us."""
    half = DEVICE_TIME_SPAN_US // 2
    return (after_us - before_us + half) % DEVICE_TIME_SPAN_US - half
