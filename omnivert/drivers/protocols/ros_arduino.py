"""ros_arduino_bridge: an Arduino that answers the command `e` with both counts, without checksum and time.

github.com/hbrobotics/ros_arduino_bridge, README "Firmware commands", ROSArduinoBridge.ino and commands.h:
asked     e\\r
answered  <left> <right>\\r\\n      decimal, signed, 32 bits

A digit that was changed on the way is a right number still. So each question asks three times in a row, which the
firmware answers within a millisecond, and a reading is believed where another says the very same, or where it lies
between the one before and the one after. It is then a count that the wheel did have at that time.
"""

import re
from collections import Counter
from dataclasses import replace

from omnivert.drivers.protocols.exchange import Exchange
from omnivert.drivers.protocols.sample import Sample

ASK = b"e\r"
TIMES = 3
LONGEST_LINE = 40  # bytes; a right answer has at most 25
COUNT = rb"(0|-?[1-9]\d{0,9})"  # as the firmware writes it: no other zeros, no plus
LINE = re.compile(COUNT + b" " + COUNT + rb"\r")
COUNTER_BITS = 32
SHARE = 0.25  # of the way since the last reading; the three take a seventh of the time or less
HURRY = 0.1  # of the fastest, by which a wheel may have become faster since


class RosArduino:
    """Three answers together make a reading.

    reach  counts that a wheel can make at most while the three are asked
    """

    def __init__(self, reach: float) -> None:
        self.refused: Counter[str] = Counter()
        self._reach = reach
        self._last: Sample | None = None
        self._line = bytearray()
        self._answers: list[Sample | None] = []  # None: not of the protocol
        self._heard_bytes = 0
        self._exchange = Exchange(self.refused)

    @property
    def awaits(self) -> bool:
        return self._exchange.awaits

    def request(self) -> bytes:
        self._exchange.begin(heard=self._heard_bytes > 0)
        self._begin_anew()
        return ASK * TIMES

    def feed(self, data: bytes) -> list[Sample]:
        if not self._exchange.awaits:
            return []  # nobody asked for it
        *ended, rest = data.split(b"\n")
        for piece in ended:
            self._add(piece)
            self._heard_bytes += 1
            self._answers.append(_sample(bytes(self._line)))
            self._line.clear()
            if len(self._answers) == TIMES:
                return self._judged()
        self._add(rest)
        return []

    def reset(self) -> None:
        self._last = None
        self._begin_anew()
        self._exchange.reset()

    def _add(self, piece: bytes) -> None:
        self._heard_bytes += len(piece)
        self._line += piece[: LONGEST_LINE - len(self._line)]

    def _begin_anew(self) -> None:
        self._line.clear()
        self._answers.clear()
        self._heard_bytes = 0

    def _judged(self) -> list[Sample]:
        self._exchange.end()
        first, middle, last = self._answers
        self._answers = []
        for answer, others in ((first, (middle, last)), (middle, (last,))):
            if answer is not None and answer in others:
                return [self._on_the_wire(answer)]
        if first is None or middle is None or last is None:
            self.refused["not an answer to e"] += 1
        elif self._are_in_order(first, middle, last):
            return [self._on_the_wire(middle)]
        else:
            self.refused["answers disagree"] += 1
        return []

    def _on_the_wire(self, answer: Sample) -> Sample:
        """It was read when the second of the three had come; the answers follow the first without a pause."""
        self._last = answer
        return replace(answer, before_bytes=2 * len(ASK), wire_bytes=len(ASK) + self._heard_bytes)

    def _are_in_order(self, first: Sample, middle: Sample, last: Sample) -> bool:
        """Whether both wheels can have passed through all three, going on about as they went before."""
        for side in ("left", "right"):
            a, b, c = (getattr(sample, side) for sample in (first, middle, last))
            reach = self._reach
            if self._last is not None:
                reach = min(reach, SHARE * abs(b - getattr(self._last, side)) + HURRY * reach + 2.0)
            if not min(a, c) <= b <= max(a, c) or abs(c - a) > reach:
                return False
        return True


def _sample(line: bytes) -> Sample | None:
    match = LINE.fullmatch(line)
    return None if match is None else Sample(None, int(match[1]), int(match[2]))
