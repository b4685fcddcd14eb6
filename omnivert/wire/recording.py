"""Recordings: MCAP files whose topics are keys below the robot's namespace and whose messages are the codec's bytes.

A chunk is closed every second, so that a file cut off in the middle is readable up to there. `Recording` opens a chunk
when its time has come.
"""

import hashlib
import heapq
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.messages import Health, Message, Playback
from omnivert.wire import mcap_file
from omnivert.wire.codec import VERSION, WireError, decode, encode

_CHUNK_NS = 1_000_000_000
_LIBRARY = "omnivert"  # what its own recordings say that they are written by
_META = "omnivert"  # name of the metadata record that holds the rig as JSON, and its SHA-256
_HOST_CLOCK = {Health.__name__, Playback.__name__}  # stamps that are not a sensor's: no part of the recording's span


class RecordingWriter:
    """Writes a recording; as a context manager it always leaves a finished file."""

    def __init__(self, path: Path, config: Config) -> None:
        self.path = path
        self.counts: Counter[str] = Counter()
        self._sink = _Sink(path)
        self._writer = mcap_file.Writer(cast(BinaryIO, self._sink), chunk_size=4 * 2**20)
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_ns: int | None = None
        self._open = True
        self._guarded(lambda: self._start(config.rig()))

    def _start(self, rig: dict[str, Any]) -> None:
        text = json.dumps(rig, sort_keys=True)
        self._writer.start(profile="", library=_LIBRARY)
        self._writer.add_metadata(_META, {"rig": text, "rig_sha256": _sha256(text)})
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
            self.write(mcap_file.END)
        self._file.close()

    def close(self) -> None:
        self._file.close()


@dataclass(frozen=True, slots=True)
class _Chunk:
    place: mcap_file.Place
    start_ns: int  # of its messages
    end_ns: int


class Recording:
    """A recording on disk.

    rig         `Config.rig` of the machine that made it
    start_ns    first and last stamp of what sensors and results say
    end_ns
    counts      messages by key
    cut         what is wrong with the file; "" when it is whole
    lost        messages that were written and cannot be read, where the file says how many there were
    refused     messages that could not be read, by reason; grows while reading
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rig: dict[str, Any] = {}
        self.cut = ""
        self.lost = 0
        self.counts: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.start_ns = 0
        self.end_ns = 0
        self._rig_fault = ""
        self._attachments: dict[str, mcap_file.Place] = {}
        self._chunks: list[_Chunk] = []
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
        try:
            with self.path.open("rb") as file:
                return mcap_file.attachment(file, self._attachments[name])
        except mcap_file.FileError as error:
            raise DataError("OV306", f"{name} in {self.path} is damaged", str(error)) from error

    def config(self, base: Config) -> Config:
        """`base` for the machine that made this recording.

        raises  DataError when what it says of that machine cannot be, or is damaged
        """
        if self._rig_fault:
            what, again = f"the rig in {self.path} is damaged", "take a copy of it that is whole"
            raise DataError("OV309", what, self._rig_fault, again)
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
                for place, record in enumerate(self._opened(file, chunk.place)):
                    key, name = self._topics.get(record.channel_id, ("", ""))
                    if low <= record.log_time < high and (names is None or name in names):
                        heapq.heappush(waiting, (record.log_time, chunk.place.offset, place, key, record.data))

    # ------------------------------------------------------------------ what the file holds

    def _survey(self, file: BinaryIO) -> None:
        survey = mcap_file.surveyed(file)
        if survey is None:
            raise DataError("OV302", f"{self.path} is no recording", "it does not begin as an MCAP file does")
        self.cut = survey.fault
        self._attachments = survey.attachments
        self._topics = {number: (topic, _message_name(schema)) for number, (topic, schema) in survey.channels.items()}
        self._take_rig(file, survey)
        sensed: list[tuple[int, int]] = []  # first and last stamp of each chunk
        for place in survey.chunks:
            try:
                self._count(file, place, sensed)
            except mcap_file.FileError:
                self.refused["damaged chunk"] += 1
                self.cut = mcap_file.DAMAGED
        if sensed:
            self.start_ns, self.end_ns = min(low for low, _ in sensed), max(high for _, high in sensed)
        self.lost = max((survey.messages or 0) - self.counts.total(), 0)

    def _take_rig(self, file: BinaryIO, survey: mcap_file.Survey) -> None:
        """The rig, or what is wrong with it: the wheels of another robot would give a wrong mount."""
        held: dict[str, str] = {}
        for place in survey.metadata:
            try:
                name, entries = mcap_file.metadata(file, place)
            except mcap_file.FileError:
                self.cut = mcap_file.DAMAGED
            else:
                held = entries if name == _META else held
        text = held.get("rig")
        if text is None:
            self._rig_fault = "it can not be found any more" if survey.library == _LIBRARY else ""
            return
        try:
            rig = json.loads(text)
        except ValueError:
            rig = None
        if not isinstance(rig, dict) or not all(isinstance(table, dict) for table in rig.values()):
            self._rig_fault = "it is no JSON object any more"
        elif held.get("rig_sha256", _sha256(text)) != _sha256(text):  # recordings of before have none
            self._rig_fault = "its digest does not fit"
        else:
            self.rig = rig

    def _count(self, file: BinaryIO, place: mcap_file.Place, sensed: list[tuple[int, int]]) -> None:
        records = list(self._opened(file, place))
        if not records:
            return
        for record in records:
            self.counts[self._topics.get(record.channel_id, ("", ""))[0]] += 1
        stamps = [record.log_time for record in records]
        self._chunks.append(_Chunk(place, min(stamps), max(stamps)))
        of_sensors = [r.log_time for r in records if self._topics.get(r.channel_id, ("", ""))[1] not in _HOST_CLOCK]
        if of_sensors:
            sensed.append((min(of_sensors), max(of_sensors)))

    def _opened(self, file: BinaryIO, place: mcap_file.Place) -> Iterator[mcap_file.Record]:
        for record in mcap_file.chunk(file, place):
            match record:
                case mcap_file.Schema():
                    self._schemas[record.id] = _message_name(record.name)
                case mcap_file.Channel():
                    self._topics[record.id] = (record.topic, self._schemas.get(record.schema_id, ""))
                case mcap_file.Record():
                    yield record


def _message_name(schema: str) -> str:
    return schema.removeprefix("omnivert.").removesuffix(f".v{VERSION}")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
