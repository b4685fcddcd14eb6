"""RoboClaw, packet serial: asked for both counters by command 78 (GETENCODERS).

Basicmicro, RoboClaw Series User Manual, "Packet Serial" and "78 - Read Encoder Counters":
asked     address, 78
answered  count of M1 (4 bytes), count of M2 (4 bytes), CRC (2 bytes); the high byte first
The CRC-16 (polynomial 0x1021, start 0) covers the address and command that were sent and the answer. M1 is left.
"""

import struct
from binascii import crc_hqx
from collections import Counter

from omnivert.drivers.protocols.exchange import Exchange
from omnivert.drivers.protocols.sample import Sample

GETENCODERS = 78
ANSWER = struct.Struct(">IIH")
COUNTER_BITS = 32


class RoboClaw:
    """One answer at a time: what is no right answer is left out whole, and the next question begins anew."""

    def __init__(self, address: int) -> None:
        self.refused: Counter[str] = Counter()
        self._question = bytes((address, GETENCODERS))
        self._begun = bytearray()
        self._exchange = Exchange(self.refused)

    @property
    def awaits(self) -> bool:
        return self._exchange.awaits

    def request(self) -> bytes:
        self._exchange.begin(heard=bool(self._begun))
        self._begun.clear()
        return self._question

    def feed(self, data: bytes) -> list[Sample]:
        if not data or not self._exchange.awaits:
            return []  # nobody asked for it
        self._begun += data
        if len(self._begun) < ANSWER.size:
            return []
        answer = bytes(self._begun[: ANSWER.size])
        self._begun.clear()
        self._exchange.end()
        left, right, crc = ANSWER.unpack(answer)
        if crc16(self._question + answer[:-2]) != crc:
            self.refused["checksum differs"] += 1
            return []
        asked = len(self._question)
        return [Sample(None, left, right, asked, asked + ANSWER.size)]

    def reset(self) -> None:
        self._begun.clear()
        self._exchange.reset()


def crc16(data: bytes) -> int:
    """CRC-16 as the manual has it (polynomial 0x1021, start 0)."""
    return crc_hqx(data, 0)
