"""The encoder's lines of text -> samples: incremental, from bytes in any pieces.

$T,<device time, us>,<left>,<right>*<CRC-16>\\n        described in deploy/encoder-protocol.md
"""

import re
from collections import Counter
from dataclasses import dataclass

LONGEST_LINE = 80  # bytes; the longest line that can be right has 68
LINE = re.compile(rb"\$T,(\d{1,10}),(-?\d{1,19}),(-?\d{1,19})\*([0-9A-Fa-f]{4})")
DEVICE_TIME_SPAN_US = 2**32


@dataclass(frozen=True, slots=True)
class Sample:
    """One line, as the device sent it."""

    device_us: int  # [0, 2**32), rolls over after 71.6 min
    left: int  # raw counts, rolling over with the counter's width
    right: int


class LineParser:
    """Finds the whole and right lines in a stream of bytes and counts what it had to leave out.

    A line ends at \\n or \\r; so after garbage, or after a piece that was lost, the next line is read again.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()  # by reason
        self._begun = bytearray()
        self._overlong = False

    def feed(self, data: bytes) -> list[Sample]:
        """The samples that these bytes complete."""
        samples = []
        *ended, rest = data.replace(b"\r", b"\n").split(b"\n")
        for piece in ended:
            self._add(piece)
            sample = self._sample()
            if sample is not None:
                samples.append(sample)
        self._add(rest)
        return samples

    def reset(self) -> None:
        """Forgets a line that was begun: the port was closed, its end will not come."""
        if self._begun or self._overlong:
            self.refused["line cut off"] += 1
        self._begun.clear()
        self._overlong = False

    def _add(self, piece: bytes) -> None:
        self._begun += piece[: LONGEST_LINE + 1 - len(self._begun)]
        self._overlong |= len(self._begun) > LONGEST_LINE

    def _sample(self) -> Sample | None:
        """What the line that has just ended says; None when it is empty or refused."""
        line, overlong = bytes(self._begun), self._overlong
        self._begun.clear()
        self._overlong = False
        if overlong:
            self.refused["line too long"] += 1
            return None
        line = line.strip()
        if not line or line.startswith(b"#"):  # a remark of the device's
            return None
        match = LINE.fullmatch(line)
        if match is None:
            self.refused["not a line of the protocol"] += 1
            return None
        if crc16(line[1:-5]) != int(match[4], 16):
            self.refused["checksum differs"] += 1
            return None
        device_us, left, right = int(match[1]), int(match[2]), int(match[3])
        if device_us >= DEVICE_TIME_SPAN_US:
            self.refused["device time beyond 32 bits"] += 1
            return None
        return Sample(device_us, left, right)


def line_from_sample(sample: Sample) -> bytes:
    """What a device sends; for simulators and tests."""
    text = f"T,{sample.device_us},{sample.left},{sample.right}".encode()
    return b"$%b*%04X\n" % (text, crc16(text))


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF): finds every error burst of up to 16 bits."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc
