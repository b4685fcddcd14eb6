"""Recordings: MCAP files whose topics are keys below the robot's namespace and whose messages are the codec's bytes.

A chunk is closed every second, so that a file cut off in the middle is readable up to there. `Recording` opens a chunk
when its time has come.
"""

import heapq
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.messages import Message
from omnivert.wire import mcap_file
from omnivert.wire.codec import VERSION, WireError, decode
from omnivert.wire.recording_writer import HOST_CLOCK, LIBRARY, META, RecordingWriter, digest

__all__ = ["Entry", "Recording", "RecordingWriter"]

_EVER_NS = 2**64  # beyond the last stamp that a file can hold


@dataclass(frozen=True, slots=True)
class Entry:
    """A message as it stands in a recording.

    name      of its type
    at_ns     where it stands: its stamp, or among which others one of the host's clock came
    stamp_ns  its stamp
    data      its bytes
    """

    key: str
    name: str
    at_ns: int
    stamp_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class _Chunk:
    place: mcap_file.Place
    start_ns: int  # of its messages
    end_ns: int
    first_ns: int  # of those that are not of the host's clock, where there are some
    messages: int


class Recording:
    """A recording on disk.

    rig         `Config.rig` of the machine that made it
    start_ns    first and last stamp of what sensors and results say
    end_ns
    counts      messages by key
    spans       their first and last stamp
    cut         what is wrong with the file; "" when it is whole
    lost        messages that were written and cannot be read, where the file says how many there were
    refused     messages that could not be read, by reason; grows while reading
    opened      told how many of how many chunks have been looked into; every one is, for its checksum
    quick       a whole file is believed its index instead: what is damaged in it is found where it is read
    """

    def __init__(
        self, path: Path, opened: Callable[[int, int], None] = lambda done, total: None, quick: bool = False
    ) -> None:
        self.path = path
        self.rig: dict[str, Any] = {}
        self.cut = ""
        self.lost = 0
        self.counts: Counter[str] = Counter()
        self.spans: dict[str, tuple[int, int]] = {}
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
                self._survey(file, opened, quick)
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
        for entry in self.entries(names, from_s, to_s):
            try:
                yield entry.key, decode(entry.data)
            except WireError as error:
                self.refused[error.reason] += 1

    def entries(
        self, names: Collection[str] | None = None, from_s: float | None = None, to_s: float | None = None
    ) -> Iterator[Entry]:
        """The same as they stand there, by name of type, without a look into their bytes."""
        with self.path.open("rb") as file:
            yield from self._entries(file, names, *self._span(from_s, to_s))

    def count(self, keys: Collection[str], from_s: float | None = None, to_s: float | None = None) -> int:
        """How many messages there are of these keys."""
        if from_s is None and to_s is None:
            return sum(self.counts[key] for key in keys)
        return sum(entry.key in keys for entry in self.entries(None, from_s, to_s))

    @property
    def chunks(self) -> int:
        """How many can be read."""
        return len(self._chunks)

    def _span(self, from_s: float | None, to_s: float | None) -> tuple[int, int]:
        low = self._ns(from_s) if from_s is not None else 0
        return low, self._ns(to_s) if to_s is not None else _EVER_NS

    def _ns(self, second: float) -> int:
        """On the recording's clock; what is farther than any stamp is ever."""
        return self.start_ns + round(second * 1e9) if second < 1e-9 * _EVER_NS else _EVER_NS

    def _entries(self, file: BinaryIO, names: Collection[str] | None, low: int, high: int) -> Iterator[Entry]:
        waiting: list[tuple[int, int, int, Entry]] = []  # stamp, chunk, place in it
        chunks = sorted((c for c in self._chunks if c.end_ns >= low and c.start_ns < high), key=lambda c: c.first_ns)
        for chunk in [*chunks, None]:
            while waiting and (chunk is None or waiting[0][0] < chunk.first_ns):
                yield heapq.heappop(waiting)[-1]
            if chunk is not None:
                for place, record in enumerate(self._content(file, chunk)):
                    key, name = self._topics.get(record.channel_id, ("", ""))
                    if low <= record.log_time < high and (names is None or name in names):
                        entry = Entry(key, name, record.log_time, record.publish_time, record.data)
                        heapq.heappush(waiting, (record.log_time, chunk.place.offset, place, entry))

    def _content(self, file: BinaryIO, chunk: _Chunk) -> list[mcap_file.Record]:
        """A chunk's messages; one that was believed the index, and is damaged, is left out from then on."""
        records = self._read(file, chunk.place)
        if not records:
            self._chunks.remove(chunk)
            self.lost += chunk.messages
        return records

    def _read(self, file: BinaryIO, place: mcap_file.Place) -> list[mcap_file.Record]:
        """A chunk's messages; none when it is damaged."""
        try:
            return list(self._opened(file, place))
        except mcap_file.FileError:
            self.refused["damaged chunk"] += 1
            self.cut = mcap_file.DAMAGED
            return []

    # ------------------------------------------------------------------ what the file holds

    def _survey(self, file: BinaryIO, opened: Callable[[int, int], None], quick: bool) -> None:
        survey = mcap_file.surveyed(file)
        if survey is None:
            raise DataError("OV302", f"{self.path} is no recording", "it does not begin as an MCAP file does")
        self.cut = survey.fault
        self._attachments = survey.attachments
        self._topics = {number: (topic, _message_name(schema)) for number, (topic, schema) in survey.channels.items()}
        self._take_rig(file, survey)
        sensed: list[tuple[int, int]] = []  # first and last stamp of each chunk
        indexed = _indexed(file, survey) if quick else None
        for done, place in enumerate(survey.chunks, 1):
            opened(done, len(survey.chunks))
            self._count(place, indexed[done - 1] if indexed else self._stamps(file, place), sensed)
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
                held = entries if name == META else held
        text = held.get("rig")
        if text is None:
            self._rig_fault = "it can not be found any more" if survey.library == LIBRARY else ""
            return
        try:
            rig = json.loads(text)
        except ValueError:
            rig = None
        if not isinstance(rig, dict) or not all(isinstance(table, dict) for table in rig.values()):
            self._rig_fault = "it is no JSON object any more"
        elif held.get("rig_sha256", digest(text)) != digest(text):  # recordings of before have none
            self._rig_fault = "its digest does not fit"
        else:
            self.rig = rig

    def _stamps(self, file: BinaryIO, place: mcap_file.Place) -> dict[int, list[int]]:
        """Channel -> stamps of a chunk's messages, after a look at all of it."""
        found: dict[int, list[int]] = {}
        for record in self._read(file, place):
            found.setdefault(record.channel_id, []).append(record.log_time)
        return found

    def _count(
        self, place: mcap_file.Place, stamps: Mapping[int, Collection[Any]], sensed: list[tuple[int, int]]
    ) -> None:
        """Takes a chunk with the stamps of its messages."""
        of_all, of_sensors = [], []
        for channel, times in stamps.items():
            key, name = self._topics.get(channel, ("", ""))
            low, high = int(min(times)), int(max(times))
            first, last = self.spans.get(key, (low, high))
            self.spans[key] = min(first, low), max(last, high)
            self.counts[key] += len(times)
            of_all.append((low, high))
            of_sensors += [(low, high)] if name not in HOST_CLOCK else []
        if of_all:
            (start, end), (first, last) = _span(of_all), _span(of_sensors or of_all)
            self._chunks.append(_Chunk(place, start, end, first, sum(map(len, stamps.values()))))
            sensed += [(first, last)] if of_sensors else []

    def _opened(self, file: BinaryIO, place: mcap_file.Place) -> Iterator[mcap_file.Record]:
        for record in mcap_file.chunk(file, place):
            match record:
                case mcap_file.Schema():
                    self._schemas[record.id] = _message_name(record.name)
                case mcap_file.Channel():
                    self._topics[record.id] = (record.topic, self._schemas.get(record.schema_id, ""))
                case mcap_file.Record():
                    yield record


def _indexed(file: BinaryIO, survey: mcap_file.Survey) -> list[dict[int, NDArray[np.uint64]]] | None:
    """The stamps of each chunk's messages from the file's own index; None where it does not tell of all of them."""
    if survey.fault or not survey.indexes:
        return None
    counts: Counter[int] = Counter()
    indexed = []
    try:
        for index in survey.indexes:
            indexed.append(mcap_file.stamps(file, index))
            counts.update({channel: len(times) for channel, times in indexed[-1].items()})
    except mcap_file.FileError:
        return None
    told = {channel: count for channel, count in survey.counts.items() if count}
    return indexed if counts == told and counts.keys() <= survey.channels.keys() else None


def _span(spans: Collection[tuple[int, int]]) -> tuple[int, int]:
    return min(low for low, _ in spans), max(high for _, high in spans)


def _message_name(schema: str) -> str:
    return schema.removeprefix("omnivert.").removesuffix(f".v{VERSION}")
