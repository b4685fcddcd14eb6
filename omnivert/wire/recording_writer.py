"""Writing a recording: what was written so far can be read whatever comes, and a chunk is closed every second."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from errno import ENOENT
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self, cast

from omnivert.config import Config
from omnivert.messages import Drive, Health, Message, Playback
from omnivert.wire import mcap_file
from omnivert.wire.codec import VERSION, encode

LIBRARY = "omnivert"  # what its own recordings say that they are written by
META = "omnivert"  # name of the metadata record that holds the rig as JSON, and its SHA-256
# Stamps that are not a sensor's: no part of the recording's span.
HOST_CLOCK = {Drive.__name__, Health.__name__, Playback.__name__}
_CHUNK_NS = 1_000_000_000
_CHUNK_BYTES = 4 * 2**20
_EARLY = 1000  # messages of the host's clock that wait for the first of a sensor
_SUMMARY, _OF_A_CHUNK, _OF_A_CHANNEL, _OF_A_MESSAGE = 2000, 150, 1000, 60  # bytes beside their content, at most


class RecordingWriter:
    """Writes a recording; as a context manager it always leaves a finished file.

    compression  of chunks: "zstd" is the smallest, "lz4" takes a quarter of its time, "none" hardly any
    counts       messages by key
    raises       OSError when the file cannot be begun
    """

    def __init__(self, path: Path, config: Config, compression: str = "zstd") -> None:
        self.path = path
        self.counts: Counter[str] = Counter()
        self._sink = _Sink(path)
        self._writer = mcap_file.writer(cast(BinaryIO, self._sink), compression)
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_ns: int | None = None
        self._newest_ns: int | None = None  # of what is not of the host's clock
        self._early: list[tuple[str, str, int, bytes]] = []  # those of the host's clock that came before all others
        self._pending = 0  # bytes of the open chunk
        self._chunks = 0  # closed ones
        self._open = True
        self._guarded(lambda: self._start(config.rig()))

    def _start(self, rig: dict[str, Any]) -> None:
        text = json.dumps(rig, sort_keys=True)
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata(META, {"rig": text, "rig_sha256": digest(text)})
        self._sink.keep()

    @property
    def size(self) -> int:
        """Bytes of the file if it were finished now, at most: as if nothing compressed the open chunk."""
        channels = len(self._channels)
        summary = _SUMMARY + _OF_A_CHANNEL * channels + self._chunks * (_OF_A_CHUNK + 10 * channels)
        early = sum(len(data) + _OF_A_MESSAGE for *_, data in self._early)
        return self.written + self._pending + early + summary

    @property
    def written(self) -> int:
        """Bytes of the file so far, also when it is closed, or somebody has taken it away meanwhile."""
        return self._sink.tell()

    def write(self, key: str, message: Message) -> None:
        """Adds a message; a chunk is closed when its stamps have passed a second.

        raises  OSError when the disk is full; the file then ends, readable, with the last closed chunk
        """
        self.put(key, type(message).__name__, message.stamp_ns, encode(message))

    def put(self, key: str, name: str, stamp_ns: int, data: bytes) -> None:
        """Adds a message of which the bytes are there already.

        A message of the host's clock stands where it came, behind the newest of the others, or with the first of them:
        on a playback the two clocks have nothing to do with each other.
        """
        if name not in HOST_CLOCK:
            if self._chunk_ns is not None and not 0 <= stamp_ns - self._chunk_ns < _CHUNK_NS:
                self.flush()
            if self._chunk_ns is None:
                self._chunk_ns = stamp_ns
            self._newest_ns = max(stamp_ns, self._newest_ns or 0)
            self._place_early(stamp_ns)
            self._add(key, name, stamp_ns, stamp_ns, data)
        elif self._newest_ns is not None:
            self._add(key, name, self._newest_ns, stamp_ns, data)
        else:
            self._guarded(lambda: self._early.append((key, name, stamp_ns, data)))
            if len(self._early) > _EARLY:
                self._place_early(None)
        self.counts[key] += 1

    def _place_early(self, at_ns: int | None) -> None:
        """Writes what waits at this stamp, or at its own."""
        early, self._early = self._early, []
        for key, name, stamp_ns, data in early:
            self._add(key, name, stamp_ns if at_ns is None else at_ns, stamp_ns, data)

    def _add(self, key: str, name: str, at_ns: int, stamp_ns: int, data: bytes) -> None:
        self._pending += len(data) + _OF_A_MESSAGE
        self._guarded(lambda: self._writer.add_message(self._channel(key, name), at_ns, data, stamp_ns))
        if self._pending > _CHUNK_BYTES:
            self.flush()

    def attach(self, name: str, data: bytes) -> None:
        """Puts a file beside the messages; the messages so far are closed into a chunk first."""
        self.flush()
        self._guarded(lambda: self._writer.add_attachment(0, 0, name, "application/octet-stream", data))
        self._guarded(self._sink.keep)

    def flush(self) -> None:
        """Closes the chunk; what was written so far survives a `kill -9`.

        raises  OSError when the disk is full, or the file was deleted
        """
        self._guarded(self._writer.flush)
        self._guarded(self._sink.keep)
        self._chunk_ns = None
        self._chunks += self._pending > 0
        self._pending = 0

    def close(self) -> None:
        if self._open:
            self._place_early(None)
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


def digest(text: str) -> str:
    """What tells that a rig is still the one that was written."""
    return hashlib.sha256(text.encode()).hexdigest()


class _Sink:
    """A file without a buffer, which knows up to where it is good."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = FileIO(path, "w")
        self._good = self._at = 0
        self._has_names = os.fstat(self._file.fileno()).st_nlink > 0  # not every file system counts them

    def tell(self) -> int:
        return self._at

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            count = self._file.write(left)
            self._at += count
            left = left[count:]
        return len(data)

    def flush(self) -> None:
        """Nothing waits here."""

    def keep(self) -> None:
        """Up to here it is good.

        raises  OSError when the file has no name any more: what is written into it is nowhere
        """
        if self._has_names and os.fstat(self._file.fileno()).st_nlink == 0:
            raise FileNotFoundError(ENOENT, "it was deleted", str(self._path))
        self._good = self._at

    def end_at_last_chunk(self) -> None:
        """The file becomes a whole one as far as it is good; one that has not even begun goes."""
        with suppress(OSError):
            if self._good == 0:
                self._path.unlink()
            else:
                self._file.truncate(self._good)
                self._file.seek(self._good)
                self._at = self._good
                self.write(mcap_file.END)
        self._file.close()

    def close(self) -> None:
        self._file.close()
