"""The sender's times of a network stream -> the bridge's clock, once they have been seen to run like it.

Arrival varies by what the network, its buffers and the decoder hold back; the sender's times do not. But some senders
tell times that are made up from a rate, so they are believed only after they have kept pace with the arrivals.
"""

from omnivert.config import Encoder
from omnivert.drivers.camera_facts import Stamp
from omnivert.drivers.device_clock import DeviceClock

CLOCKED = frozenset(("rtsp", "rtsps", "rtp", "srt", "udp", "rtmp", "rtmps"))
"""Protocols that carry the sender's times. Pictures over HTTP carry none; OpenCV then counts them at 25 Hz."""

_PROOF_NS = 2 * 10**9  # the sender's times are watched for so long
_PACE = 0.05  # and have to run as fast as this clock to within
_WORST_NS = 10**9  # a stamp that lies farther from its frame's arrival, either way, is of a clock that has jumped


class StreamClock:
    """The times of one connection; a new one begins anew."""

    def __init__(self, source: str) -> None:
        self._is_clocked = source.partition("://")[0].lower() in CLOCKED
        self._restart()

    def _restart(self) -> None:
        self._clock = DeviceClock(Encoder())
        self._first: tuple[int, int] | None = None
        self._last_us = -1
        self.stamp = Stamp.ARRIVAL

    def step(self, place_ms: float, arrival_ns: int) -> int:
        """When the frame was sent; its arrival as long as that is not known.

        place_ms  the sender's time of it, from any origin
        """
        place_us = round(place_ms * 1e3)
        if not self._is_clocked or place_us <= 0:
            return arrival_ns
        if place_us <= self._last_us or self._clock.early_ns(place_us, arrival_ns) > _WORST_NS:
            self._restart()
        self._last_us = place_us
        if self._first is None:
            self._first = place_us, arrival_ns
        sent_ns = self._clock.step(place_us, arrival_ns)
        if self.stamp is Stamp.ARRIVAL:
            here_ns, there_ns = arrival_ns - self._first[1], 1000 * (place_us - self._first[0])
            if here_ns < _PROOF_NS or there_ns < _PROOF_NS // 2:
                return arrival_ns
            if abs(here_ns - there_ns) > _PACE * here_ns:  # a burst at the beginning, or times that are made up
                self._restart()
                return arrival_ns
            self.stamp = Stamp.STREAM
        if arrival_ns - sent_ns > _WORST_NS:
            self._restart()
            return arrival_ns
        return sent_ns
