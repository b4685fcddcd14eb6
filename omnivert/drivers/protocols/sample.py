"""What all protocols of encoders have in common: bytes in, samples out. They know no port and no clock."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of both counters, as the device sent it."""

    device_us: int | None  # [0, 2**32), rolls over after 71.6 min; None where the protocol tells no time
    left: int  # raw counts, rolling over with the counter's width
    right: int
    # Bytes that pass, one after the other, before the counters can have been read; and in all, question and answer.
    before_bytes: int = field(default=0, compare=False)
    wire_bytes: int = field(default=0, compare=False)


class Parser(Protocol):
    """Finds what is whole and right in a stream of bytes, whatever its pieces, and counts what it leaves out."""

    refused: Counter[str]  # by reason

    def feed(self, data: bytes) -> list[Sample]:
        """The samples that these bytes complete; any bytes at all are allowed."""

    def reset(self) -> None:
        """Forgets what was begun: the port was closed, its end will not come."""


class Talker(Parser, Protocol):
    """A parser of a device that sends when it is told to, and tells no time of its own."""

    def request(self) -> bytes:
        """What to send; begins a new exchange, and an answer that is still open counts as none."""


class Polled(Talker, Protocol):
    """Sends one answer for each question."""

    @property
    def awaits(self) -> bool:
        """Whether a question was asked and its answer is not complete."""


class Streaming(Talker, Protocol):
    """Sends on, once it was told to begin."""

    @property
    def period_ns(self) -> int:
        """Between two samples."""
