"""Recordings: MCAP files whose topics are keys below the robot's namespace and whose messages are the codec's bytes.

A chunk is closed every second, so that a file cut off in the middle is readable up to there. `Recording` reads whole
and cut files by the same way: it walks over the chunks' headers, and opens a chunk when its time has come.
"""

import heapq
import json
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO, FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.records import Message as Record
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.messages import Health, Message, Playback
from omnivert.wire.codec import VERSION, WireError, decode, encode

_CHUNK_NS = 1_000_000_000
_META = "omnivert"  # name of the metadata record that holds the rig as JSON
_HOST_CLOCK = {Health.__name__, Playback.__name__}  # stamps that are not a sensor's: no part of the recording's span


class RecordingWriter:
    """Writes a recording; as a context manager it always leaves a finished file."""

    def __init__(self, path: Path, config: Config) -> None:
        self.path = path
        self.counts: Counter[str] = Counter()
        self._sink = _Sink(path)
        self._writer = Writer(cast(BinaryIO, self._sink), chunk_size=4 * 2**20)
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_ns: int | None = None
        self._open = True
        self._guarded(lambda: self._start(config.rig()))

    def _start(self, rig: dict[str, Any]) -> None:
        self._writer.start(profile="", library="omnivert")
        self._writer.add_metadata(_META, {"rig": json.dumps(rig, sort_keys=True)})
        self._sink.keep()

    def write(self, key: str, message: Message) -> None:
        """Adds a message; a chunk is closed when its stamps have passed a second.

        raises  OSError when the disk is full; the file then ends, readable, with the last closed chunk
        """
        data = encode(message)
        stamp = message.stamp_ns
        name = type(message).__name__
        if name not in _HOST_CLOCK:
            if self._chunk_ns is not None and not 0 <= stamp - self._chunk_ns < _CHUNK_NS:
                self.flush()
            if self._chunk_ns is None:
                self._chunk_ns = stamp
        self._guarded(lambda: self._writer.add_message(self._channel(key, name), stamp, data, stamp))
        self.counts[key] += 1

    def attach(self, name: str, data: bytes) -> None:
        """Puts a file beside the messages; the messages so far are closed into a chunk first."""
        self.flush()
        self._guarded(lambda: self._writer.add_attachment(0, 0, name, "application/octet-stream", data))
        self._sink.keep()

    def flush(self) -> None:
        """Closes the chunk; what was written so far survives a `kill -9`."""
        self._guarded(self._writer.flush)
        self._sink.keep()
        self._chunk_ns = None

    def close(self) -> None:
        if self._open:
            self._guarded(self._writer.finish)
            self._open = False
            self._sink.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _channel(self, key: str, name: str) -> int:
        if (key, name) not in self._channels:
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(f"omnivert.{name}.v{VERSION}", "", b"")
            self._channels[key, name] = self._writer.register_channel(key, "msgpack", self._schemas[name])
        return self._channels[key, name]

    def _guarded(self, step: Callable[[], object]) -> None:
        if not self._open:
            raise ValueError("this recording is closed")
        try:
            step()
        except OSError:
            self._open = False
            self._sink.end_at_last_chunk()
            raise


class _Sink:
    """A file without a buffer, which knows up to where it is good."""

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, "w")
        self._good = 0

    def tell(self) -> int:
        return self._file.tell()

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]
        return len(data)

    def flush(self) -> None:
        """Nothing waits here."""

    def keep(self) -> None:
        self._good = self._file.tell()

    def end_at_last_chunk(self) -> None:
        with suppress(OSError):
            self._file.truncate(self._good)
            self._file.seek(self._good)
            self.write(_END)
        self._file.close()

    def close(self) -> None:
        self._file.close()


_END = (  # the records that end a file which has no summary
    struct.pack("<BQI", Opcode.DATA_END, 4, 0) + struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0) + MCAP0_MAGIC
)


@dataclass(frozen=True, slots=True)
class _ChunkPlace:
    offset: int  # of the record's content
    length: int
    start_ns: int
    end_ns: int


class Recording:
    """A recording on disk.

    rig         `Config.rig` of the machine that made it
    start_ns    first and last stamp of what sensors and results say
    end_ns
    counts      messages by key
    cut         why it ends early; "" when it is whole
    refused     messages that could not be read, by reason; grows while reading
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rig: dict[str, Any] = {}
        self.cut = ""
        self.counts: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.start_ns = 0
        self.end_ns = 0
        self._attachments: dict[str, tuple[int, int]] = {}
        self._chunks: list[_ChunkPlace] = []
        self._topics: dict[int, tuple[str, str]] = {}  # channel -> key, message name
        self._schemas: dict[int, str] = {}  # schema -> message name
        try:
            with path.open("rb") as file:
                self._survey(file)
        except OSError as error:
            raise DataError("OV301", f"cannot read the recording {path}", error.strerror or str(error)) from error
        if not self.counts:
            raise DataError("OV303", f"{path} holds no message", self.cut or "the recording is empty")

    @property
    def attachments(self) -> tuple[str, ...]:
        return tuple(self._attachments)

    def attachment(self, name: str) -> bytes:
        offset, length = self._attachments[name]
        try:
            with self.path.open("rb") as file:
                return bytes(Attachment.read(_stream(file, offset, length)).data)
        except (McapError, ValueError, struct.error) as error:
            raise DataError("OV306", f"{name} in {self.path} is damaged", str(error)) from error

    def config(self, base: Config) -> Config:
        """`base` for the machine that made this recording.

        raises  DataError when what it says of that machine cannot be
        """
        try:
            return with_rig(base, self.rig, str(self.path))
        except UseError as error:
            what = f"{self.path} says something of its robot that cannot be"
            raise DataError("OV307", what, f"{error}", "omnivert explain OV307") from error

    def messages(
        self,
        types: Collection[type[Message]] | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
    ) -> Iterator[tuple[str, Message]]:
        """(key, message) in the order of the stamps, equal ones as they were written.

        types         those messages only; None: all
        from_s, to_s  part of the recording, counted from its start; to_s excluded
        """
        names = None if types is None else {message.__name__ for message in types}
        with self.path.open("rb") as file:
            for key, data in self._records(file, names, *self._span(from_s, to_s)):
                try:
                    yield key, decode(data)
                except WireError as error:
                    self.refused[error.reason] += 1

    def count(self, keys: Collection[str], from_s: float | None = None, to_s: float | None = None) -> int:
        """How many messages there are of these keys."""
        if from_s is None and to_s is None:
            return sum(self.counts[key] for key in keys)
        with self.path.open("rb") as file:
            return sum(key in keys for key, _ in self._records(file, None, *self._span(from_s, to_s)))

    def _span(self, from_s: float | None, to_s: float | None) -> tuple[int, int]:
        low = self.start_ns + round(from_s * 1e9) if from_s is not None else 0
        high = self.start_ns + round(to_s * 1e9) if to_s is not None else 2**64
        return low, high

    def _records(self, file: BinaryIO, names: set[str] | None, low: int, high: int) -> Iterator[tuple[str, bytes]]:
        waiting: list[tuple[int, int, int, str, bytes]] = []  # stamp, chunk, place in it, key, bytes
        chunks = sorted((c for c in self._chunks if c.end_ns >= low and c.start_ns < high), key=lambda c: c.start_ns)
        for chunk in [*chunks, None]:
            while waiting and (chunk is None or waiting[0][0] < chunk.start_ns):
                *_, key, data = heapq.heappop(waiting)
                yield key, data
            if chunk is not None:
                for place, record in enumerate(self._opened(file, chunk)):
                    key, name = self._topics.get(record.channel_id, ("", ""))
                    if low <= record.log_time < high and (names is None or name in names):
                        heapq.heappush(waiting, (record.log_time, chunk.offset, place, key, record.data))

    # ------------------------------------------------------------------ the walk over the file

    def _survey(self, file: BinaryIO) -> None:
        size = file.seek(0, 2)
        file.seek(0)
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise DataError("OV302", f"{self.path} is no recording", "it does not begin as an MCAP file does")
        spans: list[int] = []
        while True:
            offset = file.tell() + 9
            head = file.read(9)
            if len(head) < 9:
                self.cut = "it ends in the middle"
                break
            opcode, length = struct.unpack("<BQ", head)
            if offset + length > size:
                self.cut = "it ends in the middle"
                break
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            if opcode == Opcode.CHUNK:
                place = _chunk_place(file, offset, length)
                if place is None or not self._count(file, place, spans):
                    self.refused["damaged chunk"] += 1
                    self.cut = "a part of it is damaged"
                else:
                    self._chunks.append(place)
            elif opcode == Opcode.METADATA:
                self._take_rig(_stream(file, offset, length))
            elif opcode == Opcode.ATTACHMENT:
                named = int.from_bytes(_read(file, offset + 16, 4), "little")
                name = _read(file, offset + 20, min(named, 1000)).decode(errors="replace")
                self._attachments[name] = (offset, length)
            file.seek(offset + length)
        if spans:
            self.start_ns, self.end_ns = min(spans), max(spans)

    def _take_rig(self, content: ReadDataStream) -> None:
        try:
            metadata = Metadata.read(content)
            rig = json.loads(metadata.metadata.get("rig", "null")) if metadata.name == _META else None
        except (McapError, ValueError, struct.error):
            self.cut = "a part of it is damaged"
            return
        if isinstance(rig, dict) and all(isinstance(table, dict) for table in rig.values()):
            self.rig = rig

    def _count(self, file: BinaryIO, place: _ChunkPlace, spans: list[int]) -> bool:
        try:
            records = list(self._opened(file, place))
        except Exception:  # noqa: BLE001 - each decompressor has errors of its own
            return False
        for record in records:
            key, name = self._topics.get(record.channel_id, ("", ""))
            self.counts[key] += 1
            if name not in _HOST_CLOCK:
                spans.append(record.log_time)
        return True

    def _opened(self, file: BinaryIO, place: _ChunkPlace) -> Iterator[Record]:
        chunk = Chunk.read(_stream(file, place.offset, place.length))
        for record in breakup_chunk(chunk, validate_crc=True):
            match record:
                case Schema():
                    self._schemas[record.id] = record.name.removeprefix("omnivert.").removesuffix(f".v{VERSION}")
                case Channel():
                    self._topics[record.id] = (record.topic, self._schemas.get(record.schema_id, ""))
                case Record():
                    yield record


def _read(file: BinaryIO, offset: int, length: int) -> bytes:
    file.seek(offset)
    return file.read(length)


def _stream(file: BinaryIO, offset: int, length: int) -> ReadDataStream:
    return ReadDataStream(BytesIO(_read(file, offset, length)))


def _chunk_place(file: BinaryIO, offset: int, length: int) -> _ChunkPlace | None:
    head = _read(file, offset, 16)
    return _ChunkPlace(offset, length, *struct.unpack("<QQ", head)) if len(head) == 16 and length >= 16 else None
