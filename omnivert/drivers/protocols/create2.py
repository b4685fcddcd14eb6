"""iRobot Create 2 (and Roomba 600): a stream of the encoders' packets 43 and 44, every 15 ms.

iRobot Create 2 Open Interface (OI) Specification based on the iRobot Roomba 600, "Stream" (opcode 148) and "Left
Encoder Counts", "Right Encoder Counts":
asked     148, 2, 43, 44
sent      19, 6, 43, left (2 bytes), 44, right (2 bytes), checksum; the high byte first
All bytes with the header and the checksum add up to 0 in their low byte. Counters have 16 bits, 508.8 counts to a turn
of the wheel of 72 mm, and count up whatever way the wheel turns while no speed is commanded.
"""

from collections import Counter

from omnivert.drivers.protocols.sample import Sample

START, STREAM = 128, 148
LEFT, RIGHT = 43, 44
BEGIN = bytes((19, 6, LEFT))
PACKET_BYTES = 9
PERIOD_NS = 15_000_000
COUNTER_BITS = 16


class Create2:
    """Looks for a packet at every byte, so that garbage costs no packet but those that it lies in."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self._begun = bytearray()
        self._asked = False
        self._astray = False

    @property
    def period_ns(self) -> int:
        return PERIOD_NS

    def request(self) -> bytes:
        """First only the stream is asked for; START, too, when that was not enough: it takes the robot out of other
        modes, and so stops it."""
        start = bytes((START,)) if self._asked else b""
        self._asked = True
        return start + bytes((STREAM, 2, LEFT, RIGHT))

    def feed(self, data: bytes) -> list[Sample]:
        self._begun += data
        samples = []
        at = 0
        while True:
            found = self._begun.find(BEGIN, at)
            if found < 0:
                found = max(at, len(self._begun) - len(BEGIN) + 1)  # what may still become a beginning
            if found > at:
                self._refuse("not a packet of encoders")
            at = found
            packet = self._begun[at : at + PACKET_BYTES]
            if len(packet) < PACKET_BYTES:
                break
            if packet[5] != RIGHT:
                self._refuse("not a packet of encoders")
                at += 1
            elif sum(packet) % 256:
                self._refuse("checksum differs")
                at += 1
            else:
                left, right = packet[3] << 8 | packet[4], packet[6] << 8 | packet[7]
                samples.append(Sample(None, left, right, wire_bytes=PACKET_BYTES))
                self._asked = self._astray = False
                at += PACKET_BYTES
        del self._begun[:at]
        return samples

    def reset(self) -> None:
        self._begun.clear()
        self._asked = self._astray = False

    def _refuse(self, reason: str) -> None:
        """Counts it once until the next right packet."""
        if not self._astray:
            self.refused[reason] += 1
        self._astray = True
