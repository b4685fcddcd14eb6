"""What travels beside every message: who published it, as which of its messages, when, and from which drive.

An incarnation is 8 random bytes that a process draws when it starts; a run is the incarnation of the process that
published the sensor's message from which all else followed. So results of an earlier playback are told from this one's.
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Self

_FORM = struct.Struct("<4s8s8sIQqB")
_MAGIC = b"OVE1"
_REPLAY = 1
_MOST_LOST = 10**7  # at 100 Hz a day's; a number that is farther ahead is wrong


def _this_boot() -> int:
    """Names this host's monotonic clock, which begins anew at each boot; 0 where that is not known."""
    try:
        return zlib.crc32(Path("/proc/sys/kernel/random/boot_id").read_bytes())
    except OSError:
        return 0


THIS_CLOCK = _this_boot()


@dataclass(frozen=True, slots=True)
class Envelope:
    """
    incarnation  of the process that published this
    run          of the sensor data that it comes from
    sequence     counts this process's messages on this key
    sent_ns      monotonic, of the publishing host
    replay       a recording plays
    clock        names the clock of `sent_ns`
    """

    incarnation: bytes
    run: bytes
    sequence: int
    sent_ns: int
    replay: bool = False
    clock: int = THIS_CLOCK

    def packed(self) -> bytes:
        return _FORM.pack(
            _MAGIC, self.incarnation, self.run, self.clock, self.sequence, self.sent_ns, _REPLAY * self.replay
        )

    @classmethod
    def unpacked(cls, data: bytes) -> Self | None:
        """None for bytes that are no envelope."""
        if len(data) != _FORM.size:
            return None
        magic, incarnation, run, clock, sequence, sent_ns, flags = _FORM.unpack(data)
        if magic != _MAGIC:
            return None
        return cls(incarnation, run, sequence, sent_ns, bool(flags & _REPLAY), clock)


def missing_between(last: int, sequence: int) -> int | None:
    """How many messages are missing between two that follow each other; None where the second number is wrong."""
    missing = max(sequence - last - 1, 0)
    return missing if missing <= _MOST_LOST else None
