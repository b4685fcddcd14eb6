"""What an MCAP file holds and where, read so that a wrong bit costs no more than the part that it lies in.

The summary at the end, which has a checksum of its own, says where everything stands. A file without one (whoever wrote
it was killed), or one whose summary is damaged, is walked over from record to record.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

__all__ = [
    "DAMAGED",
    "END",
    "MAGIC",
    "Channel",
    "FileError",
    "Place",
    "Record",
    "Schema",
    "Survey",
    "Writer",
    "attachment",
    "chunk",
    "metadata",
    "stamps",
    "surveyed",
    "writer",
]

ENDS_EARLY = "it ends in the middle"
DAMAGED = "a part of it is damaged"
END = (  # the records that end a file which has no summary
    struct.pack("<BQI", Opcode.DATA_END, 4, 0) + struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0) + MAGIC
)
_HEAD = 9  # bytes of a record before its content: opcode, length
_KNOWN = (*range(Opcode.HEADER, Opcode.DATA_END + 1), *range(0x80, 0x100))  # the latter are anybody's own
_FOOTER = _HEAD + 20 + len(MAGIC)
_FAULTS = (McapError, ValueError, struct.error)  # what mcap raises when bytes are no record


_UNLIMITED = 2**62  # chunks are closed by whoever writes


class FileError(ValueError):
    """These bytes are not what they should be."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a record's content stands."""

    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class Index:
    """What the summary says of a chunk's messages: where their stamps stand, the first and the last of them."""

    place: Place
    start_ns: int
    end_ns: int


@dataclass(slots=True)
class Survey:
    """
    library   what wrote the file
    chunks    in the order in which they were written
    indexes   of each chunk, and counts of messages by channel, where the summary says so
    channels  id -> topic and name of its schema, where the summary says so; else they are in the chunks
    messages  how many were written, where the summary says so
    fault     what is wrong with the file as far as it shows without opening its parts; "" when nothing is
    """

    library: str = ""
    chunks: list[Place] = field(default_factory=list)
    indexes: list[Index] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    attachments: dict[str, Place] = field(default_factory=dict)
    metadata: list[Place] = field(default_factory=list)
    channels: dict[int, tuple[str, str]] = field(default_factory=dict)
    messages: int | None = None
    fault: str = ""


def writer(sink: BinaryIO, compression: str) -> Writer:
    """A writer whose chunks are closed by its `flush` alone; compression is zstd, lz4 or none."""
    return Writer(sink, chunk_size=_UNLIMITED, compression=CompressionType[compression.upper()])


def surveyed(file: BinaryIO) -> Survey | None:
    """What the file holds; None when it does not begin as an MCAP file does."""
    size = file.seek(0, 2)
    if _read(file, 0, len(MAGIC)) != MAGIC:
        return None
    found = _from_summary(file, size) or _walked(file, size)
    try:
        found.library = Header.read(_stream(file, Place(len(MAGIC) + _HEAD, 1000))).library
    except _FAULTS:
        found.fault = found.fault or DAMAGED
    return found


def chunk(file: BinaryIO, place: Place) -> list[McapRecord]:
    """The records of a chunk.

    raises  FileError when it is damaged
    """
    try:
        return breakup_chunk(Chunk.read(_stream(file, place)), validate_crc=True)
    except Exception as error:
        raise FileError(str(error)) from error


def stamps(file: BinaryIO, index: Index) -> dict[int, NDArray[np.uint64]]:
    """Channel -> stamps of a chunk's messages, from the index beside it, without a look into the chunk.

    raises  FileError when it does not agree with the summary
    """
    content, at = _read(file, index.place.offset, index.place.length), 0
    found: dict[int, NDArray[np.uint64]] = {}
    try:
        while at < index.place.length:
            opcode, length, channel, size = struct.unpack_from("<BQHI", content, at)
            pairs = np.frombuffer(content, "<u8", size // 8, at + struct.calcsize("<BQHI"))
            if opcode != Opcode.MESSAGE_INDEX or length != size + 6 or size % 16:
                raise FileError("it is no index")
            if size:
                found[channel] = pairs[::2]
            at += _HEAD + length
    except _FAULTS as error:
        raise FileError(str(error)) from error
    low, high = (of([of(times) for times in found.values()], default=0) for of in (min, max))
    if (low, high) != (index.start_ns, index.end_ns):
        raise FileError("it tells of other times than the summary")
    return found


def metadata(file: BinaryIO, place: Place) -> tuple[str, dict[str, str]]:
    """Name and entries.

    raises  FileError when it is damaged
    """
    try:
        content = Metadata.read(_stream(file, place))
    except _FAULTS as error:
        raise FileError(str(error)) from error
    return content.name, content.metadata


def attachment(file: BinaryIO, place: Place) -> bytes:
    """A file that was put beside the messages.

    raises  FileError when it is damaged
    """
    content = _read(file, place.offset, place.length)
    said = int.from_bytes(content[-4:], "little")
    if len(content) != place.length or (said and said != zlib.crc32(content[:-4])):  # 0: it has none
        raise FileError("its checksum does not fit")
    try:
        return bytes(Attachment.read(ReadDataStream(BytesIO(content))).data)
    except _FAULTS as error:
        raise FileError(str(error)) from error


# ---------------------------------------------------------------- with a summary


def _from_summary(file: BinaryIO, size: int) -> Survey | None:
    """None when there is none, it is damaged, or does not tell of everything."""
    found = Survey()
    schemas: dict[int, str] = {}
    channels: list[Channel] = []
    said: Statistics | None = None
    for record in _summary(file, size):
        match record:
            case Schema():
                schemas[record.id] = record.name
            case Channel():
                channels.append(record)
            case Statistics():
                said = record
            case ChunkIndex(chunk_start_offset=start, chunk_length=length):
                found.chunks.append(_indexed(file, size, found, Opcode.CHUNK, start, length))
                index = Place(min(record.message_index_offsets.values(), default=0), record.message_index_length)
                found.indexes.append(Index(index, record.message_start_time, record.message_end_time))
            case AttachmentIndex(offset=start, length=length, name=name):
                found.attachments[name] = _indexed(file, size, found, Opcode.ATTACHMENT, start, length)
            case MetadataIndex(offset=start, length=length):
                found.metadata.append(_indexed(file, size, found, Opcode.METADATA, start, length))
    if said is None or said.chunk_count != len(found.chunks):
        return None
    if (said.attachment_count and not found.attachments) or said.metadata_count != len(found.metadata):
        return None
    found.channels = {channel.id: (channel.topic, schemas.get(channel.schema_id, "")) for channel in channels}
    found.messages, found.counts = said.message_count, said.channel_message_counts
    return found


def _summary(file: BinaryIO, size: int) -> Iterator[McapRecord]:
    """Its records; nothing when its checksum does not fit."""
    ending = _read(file, max(size - _FOOTER, 0), _FOOTER)
    if len(ending) < _FOOTER or ending[0] != Opcode.FOOTER or not ending.endswith(MAGIC):
        return
    footer = Footer.read(ReadDataStream(BytesIO(ending[_HEAD:])))
    if not 0 < footer.summary_start < size - _FOOTER:
        return
    content = _read(file, footer.summary_start, size - footer.summary_start)
    if footer.summary_crc and zlib.crc32(content[: -4 - len(MAGIC)]) != footer.summary_crc:
        return
    try:
        yield from StreamReader(BytesIO(content), skip_magic=True).records
    except _FAULTS:  # a file without a checksum
        return


def _indexed(file: BinaryIO, size: int, found: Survey, opcode: Opcode, start: int, length: int) -> Place:
    """The place that the summary says; the fault is noted when the record itself does not agree."""
    if length < _HEAD or start + length > size:
        found.fault = DAMAGED
        return Place(size, 0)
    if _read(file, start, _HEAD) != struct.pack("<BQ", opcode, length - _HEAD):
        found.fault = DAMAGED
    return Place(start + _HEAD, length - _HEAD)


# ---------------------------------------------------------------- without one


def _walked(file: BinaryIO, size: int) -> Survey:
    """What stands between the beginning and the end of the data, or of the file."""
    found = Survey()
    place = Place(len(MAGIC), 0)
    while True:
        head = _read(file, place.offset + place.length, _HEAD)
        if len(head) < _HEAD:
            found.fault = ENDS_EARLY
            return found
        opcode, length = struct.unpack("<BQ", head)
        place = Place(place.offset + place.length + _HEAD, length)
        if place.offset + length > size:
            found.fault = ENDS_EARLY if opcode in _KNOWN else DAMAGED
            return found
        match opcode:
            case Opcode.DATA_END | Opcode.FOOTER:
                return found
            case Opcode.CHUNK:
                found.chunks.append(place)
            case Opcode.METADATA:
                found.metadata.append(place)
            case Opcode.ATTACHMENT:
                named = int.from_bytes(_read(file, place.offset + 16, 4), "little")
                name = _read(file, place.offset + 20, min(named, 1000)).decode(errors="replace")
                found.attachments[name] = place
            case 0 if length == 0:  # no record is so; a file is, where its pages never came to the disk
                found.fault = DAMAGED
                return found
            case _ if opcode not in _KNOWN:
                found.fault = DAMAGED


def _read(file: BinaryIO, offset: int, length: int) -> bytes:
    file.seek(offset)
    return file.read(length)


def _stream(file: BinaryIO, place: Place) -> ReadDataStream:
    return ReadDataStream(BytesIO(_read(file, place.offset, place.length)))
