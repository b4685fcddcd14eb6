"""The encoder's lines: read in any pieces, found again after anything, refused by reason."""

import binascii
import re
from itertools import pairwise
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from omnivert.drivers.protocols.omnivert_line import OmnivertLine, crc16, line_from_sample
from omnivert.drivers.protocols.sample import Sample

PROTOCOL = Path(__file__).resolve().parents[2] / "deploy" / "encoder-protocol.md"

counts = st.integers(-(2**62), 2**63 - 1)
samples = st.builds(Sample, st.integers(0, 2**32 - 1), counts, counts)


def cut(data: bytes, places: list[int]) -> list[bytes]:
    marks = sorted({0, len(data), *(place % (len(data) + 1) for place in places)})
    return [data[a:b] for a, b in pairwise(marks)]


@given(data=st.binary(max_size=200))
def test_the_checksum_is_the_usual_ccitt_crc(data: bytes) -> None:
    assert crc16(data) == binascii.crc_hqx(data, 0xFFFF)


@given(sent=st.lists(samples, max_size=8), places=st.lists(st.integers(0, 2000), max_size=12))
def test_lines_in_any_pieces_are_the_samples_that_were_sent(sent: list[Sample], places: list[int]) -> None:
    parser = OmnivertLine()
    pieces = cut(b"".join(map(line_from_sample, sent)), places)
    assert [sample for piece in pieces for sample in parser.feed(piece)] == sent
    assert not parser.refused


@given(garbage=st.binary(max_size=400), places=st.lists(st.integers(0, 2000), max_size=12), sample=samples)
def test_after_any_garbage_the_next_line_is_read(garbage: bytes, places: list[int], sample: Sample) -> None:
    parser = OmnivertLine()
    for piece in cut(garbage + b"\n", places):
        parser.feed(piece)
    assert parser.feed(line_from_sample(sample)) == [sample]


@given(sample=samples, place=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_one_flipped_bit_never_gives_another_sample(sample: Sample, place: int, bit: int) -> None:
    line = bytearray(line_from_sample(sample))
    line[place % len(line)] ^= 1 << bit
    assert OmnivertLine().feed(bytes(line) + b"\n") in ([], [sample])  # [sample]: a letter of the checksum changed case


def test_what_is_left_out_is_counted_by_reason() -> None:
    parser = OmnivertLine()
    good = line_from_sample(Sample(20_000, 13, -13))
    assert parser.feed(b"boot ok\r\n") == []
    assert parser.feed(good[:9] + good) == [Sample(20_000, 13, -13)]  # a piece was lost, its line runs into the next
    assert parser.feed(good.replace(b"13,", b"14,")) == []
    assert parser.feed(b"$T," + b"1" * 500 + b"\n") == []
    assert parser.feed(b"$T,4294967296,1,1*%04X\n" % crc16(b"T,4294967296,1,1")) == []
    assert parser.feed(b"\r\n\r\n# a remark\r\n") == []
    assert parser.feed(good[:7]) == []
    parser.reset()
    assert parser.feed(good) == [Sample(20_000, 13, -13)]
    assert parser.refused == {
        "not a line of the protocol": 2,
        "checksum differs": 1,
        "line too long": 1,
        "device time beyond 32 bits": 1,
        "line cut off": 1,
    }


def test_an_endless_line_takes_no_memory() -> None:
    parser = OmnivertLine()
    for _ in range(100):
        parser.feed(b"x" * 10_000)
    assert len(parser._begun) < 100


def test_the_examples_of_the_document_are_right() -> None:
    examples = re.findall(r"^    (\$T,\S+)$", PROTOCOL.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(examples) >= 3
    parser = OmnivertLine()
    assert len([parser.feed(example.encode() + b"\r\n") for example in examples]) == len(examples)
    assert not parser.refused
