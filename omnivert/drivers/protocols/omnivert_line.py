"""omnivert's own protocol: lines of text with the device's time, by themselves.

$T,<device time, us>,<left>,<right>*<CRC-16>\\n        described in deploy/encoder-protocol.md
"""

import re
from binascii import crc_hqx
from collections import Counter

from omnivert.drivers.device_clock import SPAN_US
from omnivert.drivers.protocols.sample import Sample

LONGEST_LINE = 80  # bytes; the longest line that can be right has 68
BEGIN = b"$T,"
LINE = re.compile(rb"\$T,(\d{1,10}),(-?\d{1,19}),(-?\d{1,19})\*([0-9A-Fa-f]{4})")


class OmnivertLine:
    """A line ends at \\n or \\r, and the last that begins in it counts.

    So after garbage, or after a piece that was lost, the next line is read, even if it is the line's end that was lost.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self._begun = bytearray()
        self._overlong = False
        self._remark = False

    def feed(self, data: bytes) -> list[Sample]:
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
        if self._begun:
            self.refused["line cut off"] += 1
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._begun.clear()
        self._overlong = self._remark = False

    def _add(self, piece: bytes) -> None:
        self._begun += piece
        if not self._overlong:
            first = self._begun.lstrip()[:2]
            self._remark = first.startswith(b"#") and first != b"#$"  # that is a spoilt end, and the next line's begin
        self._overlong |= len(self._begun) > LONGEST_LINE
        del self._begun[:-LONGEST_LINE]

    def _sample(self) -> Sample | None:
        """What the line that has just ended says; None when it is empty or refused."""
        text, overlong, remark = bytes(self._begun).strip(), self._overlong, self._remark
        self._begin_anew()
        if remark or not text:
            return None
        before, begin, said = text.rpartition(BEGIN)
        match = LINE.fullmatch(begin + said)
        if before or overlong or match is None:
            self.refused["line too long" if overlong else "not a line of the protocol"] += 1
        if match is None:
            return None
        if crc16(match[0][1:-5]) != int(match[4], 16):
            self.refused["checksum differs"] += 1
            return None
        device_us, left, right = int(match[1]), int(match[2]), int(match[3])
        if device_us >= SPAN_US:
            self.refused["device time beyond 32 bits"] += 1
            return None
        return Sample(device_us, left, right, wire_bytes=len(match[0]) + 1)


def line_from_sample(sample: Sample) -> bytes:
    """What a device sends; for simulators and tests."""
    text = f"T,{sample.device_us},{sample.left},{sample.right}".encode()
    return b"$%b*%04X\n" % (text, crc16(text))


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF): finds every error burst of up to 16 bits."""
    return crc_hqx(data, 0xFFFF)
