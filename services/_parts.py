"""A recording in one file, or in as many as a limit of size or time asks for; each is a recording of its own."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Self

from omnivert.config import Config
from omnivert.messages import Health, Message, Playback
from omnivert.wire.recording import RecordingWriter

_SECOND = 1_000_000_000


class Parts:
    """Writes messages into `path`, or, with a limit, into `path` with the numbers 001, 002, ... behind its name.

    paths   of the files so far, in order
    raises  OSError when a file cannot be begun, or written any further; what was written before is good
    """

    def __init__(self, path: Path, config: Config) -> None:
        self.paths: list[Path] = []
        self._config = config
        self._names = numbered(path) if is_split(config) else iter((path,))
        self._most_bytes = 1e6 * config.recorder.split_mb or float("inf")
        self._most_ns = _SECOND * config.recorder.split_s or float("inf")
        self._first_ns: int | None = None  # stamp of a sensor's message
        self._closed_bytes = 0
        self._writer = self._begun()

    @property
    def size(self) -> int:
        """Bytes of all files, without what waits for its chunk to be closed; also of those that were moved away."""
        return self._closed_bytes + self._writer.written

    def put(self, key: str, message: Message, data: bytes) -> None:
        """Adds a message, of which `data` are the bytes; before it the next part is begun where its limit asks for."""
        sensed = not isinstance(message, Health | Playback)
        if self._is_full(message.stamp_ns if sensed else None, len(data)):
            self._writer.close()
            self._closed_bytes += self._writer.written
            self._writer = self._begun()
            self._first_ns = None
        if sensed and self._first_ns is None:
            self._first_ns = message.stamp_ns
        self._writer.put(key, type(message).__name__, message.stamp_ns, data)

    def flush(self) -> None:
        """What was written so far survives a `kill -9`."""
        self._writer.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def _is_full(self, stamp_ns: int | None, more: int) -> bool:
        if not self._writer.counts:
            return False
        lasted = 0 if stamp_ns is None or self._first_ns is None else stamp_ns - self._first_ns
        return lasted >= self._most_ns or self._writer.size + more > self._most_bytes

    def _begun(self) -> RecordingWriter:
        path = next(self._names)
        writer = RecordingWriter(path, self._config, self._config.recorder.compression)
        self.paths.append(path)
        return writer


def is_split(config: Config) -> bool:
    return config.recorder.split_mb > 0.0 or config.recorder.split_s > 0.0


def numbered(path: Path) -> Iterator[Path]:
    """Names of parts that are not there yet: a recorder that comes back goes on behind its earlier ones."""
    names = (path.with_name(f"{path.stem}-{number:03d}{path.suffix}") for number in count(1))
    return (name for name in names if not name.exists())
