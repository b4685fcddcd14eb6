"""Bytes of an encoder's line, with the time they arrived -> Ticks on the bridge's clock."""

from collections import Counter

from omnivert.config import Encoder
from omnivert.drivers import protocols
from omnivert.drivers.counters import CounterPair, Jump
from omnivert.drivers.device_clock import BridgeClock, DeviceClock
from omnivert.drivers.talk import Asked, Begun, Heard, Timed
from omnivert.messages import Ticks

RESTARTED = "device restarted; what it drove meanwhile is lost"
AWAY = "port was away; what was driven meanwhile is lost"
EARLY_NS = 10**9  # a line this much ahead of its own clock is not of that clock


class EncoderLine:
    """A stepper: knows no port and asks no time.

    Out come only readings whose time grows and whose counts a wheel can have made; what is refused is counted.
    """

    def __init__(self, config: Encoder) -> None:
        self._config = config
        self._parser = protocols.parser(config)
        self._talk = _talk(config, self._parser)
        self._clock = _clock(config)
        self._counters = CounterPair(config)
        self._refused: Counter[str] = Counter()
        self._last: Timed | None = None
        self._time_us = 0  # rollover undone
        self._stamp_ns = 0
        self._doubted: list[Timed] = []
        self._reopened = False

    @property
    def refused(self) -> dict[str, int]:
        """Readings left out so far, by reason."""
        return dict(self._parser.refused + self._refused)

    @property
    def clock(self) -> str:
        """How well the readings' times are known: drift and jitter, in words; "" before there is anything to tell."""
        return str(self._clock) if isinstance(self._clock, DeviceClock) else str(self._talk)

    def question(self, now_ns: int) -> bytes:
        """What to send to the device now; mostly nothing. It counts as sent at `now_ns`."""
        return self._talk.question(now_ns)

    def idle_s(self, now_ns: int) -> float:
        """For so long the device has nothing to say, and nothing to be asked."""
        return self._talk.idle_s(now_ns)

    def step(self, data: bytes, arrival_ns: int) -> list[Ticks]:
        """The readings that these bytes complete, in order of their growing stamps."""
        steps = (self._reading(reading) for reading in self._talk.step(data, arrival_ns))
        return [ticks for ticks in steps if ticks is not None]

    def reopened(self) -> None:
        """The port was lost and is back: the device may have gone on, or begun anew."""
        self._parser.reset()
        self._talk.reopened()
        self._doubted.clear()
        self._reopened = True

    def _reading(self, reading: Timed) -> Ticks | None:
        if self._last is None:
            self._reopened = False
            return self._accepted(reading, reading.time_us, self._counters.step(reading.left, reading.right, 0.0))
        if self._reopened:
            self._reopened = False
            if not self._went_on(self._last, reading):
                return self._restarted(reading, RESTARTED if self._clock.own else AWAY)
        advance_us = self._clock.advance_us(self._last.time_us, reading.time_us)
        if advance_us <= 0:
            return self._refuse("device time repeated" if advance_us == 0 else "device time reversed", reading)
        if self._clock.early_ns(self._time_us + advance_us, reading.until_ns) > EARLY_NS:
            return self._refuse("device time ahead", reading)
        counts = self._counters.step(reading.left, reading.right, advance_us * 1e-6 + reading.slack_s)
        return self._accepted(reading, self._time_us + advance_us, counts)

    def _went_on(self, last: Timed, reading: Timed) -> bool:
        """Whether the device's clock says that it was not restarted while the port was away."""
        silent_us = (reading.until_ns - last.until_ns) // 1000
        off_us = self._clock.advance_us(last.time_us + silent_us, reading.time_us)
        return self._clock.own and abs(off_us) * 1000 <= EARLY_NS

    def _accepted(self, reading: Timed, time_us: int, counts: tuple[int, int] | Jump) -> Ticks | None:
        if isinstance(counts, Jump):
            return self._refuse(counts.reason, reading)
        self._doubted.clear()
        self._last, self._time_us = reading, time_us
        # A clock that is still being learnt may step back by its own uncertainty; stamps never do.
        self._stamp_ns = max(self._clock.step(time_us, reading.until_ns), self._stamp_ns + 1)
        return Ticks(self._stamp_ns, *counts)

    def _refuse(self, reason: str, reading: Timed) -> Ticks | None:
        """Counts it, unless it is the last of a row that tells a new beginning."""
        self._refused[reason] += 1
        if self._doubted and not self._follows(self._doubted[-1], reading):
            self._doubted.clear()
        self._doubted.append(reading)
        if self._last is None or len(self._doubted) < self._config.restart_after_lines:
            return None
        return self._restarted(reading, RESTARTED)

    def _follows(self, before: Timed, reading: Timed) -> bool:
        """Whether the two can be neighbouring readings of one device."""
        advance_us = self._clock.advance_us(before.time_us, reading.time_us)
        probe = CounterPair(self._config)
        if advance_us <= 0 or isinstance(probe.step(before.left, before.right, 0.0), Jump):
            return False
        return not isinstance(probe.step(reading.left, reading.right, advance_us * 1e-6 + reading.slack_s), Jump)

    def _restarted(self, reading: Timed, reason: str) -> Ticks | None:
        self._refused[reason] += 1
        self._doubted.clear()
        self._clock = _clock(self._config)
        return self._accepted(reading, reading.time_us, self._counters.restart(reading.left, reading.right))


def _talk(config: Encoder, parser: protocols.AnyParser) -> Heard | Asked | Begun:
    match parser:
        case protocols.OmnivertLine():
            return Heard(config, parser)
        case protocols.Create2():
            return Begun(config, parser)
        case _:
            return Asked(config, parser)


def _clock(config: Encoder) -> DeviceClock | BridgeClock:
    return DeviceClock(config) if config.protocol == "omnivert" else BridgeClock()
