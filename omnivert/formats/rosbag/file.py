"""A bag of ROS 1 (.bag) or ROS 2 (a folder, .db3, .mcap), read and written without ROS.

Read part by part and message by message: nothing of a bag is held that was not asked for.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rosbags.interfaces import Connection, MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from omnivert.errors import DataError, OmnivertError

ROS1 = ".bag"
_PARTS = (ROS1, ".mcap", ".db3")  # files that are a bag, or a part of one
_CURES = {
    ROS1: "rosbag reindex FILE mends what a killed recorder left",
    ".mcap": "mcap recover FILE -o WHOLE.mcap mends what a killed recorder left",
}
_CURE = "ros2 bag reindex DIR mends what a killed recorder left"
_METADATA = "metadata.yaml"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_HEADER = "std_msgs/msg/Header"


@dataclass(frozen=True, slots=True)
class Topic:
    """
    type      as ROS 2 writes it, "sensor_msgs/msg/Image", also of a bag of ROS 1
    count     messages, as the bag tells
    fields    name -> type of those that are numbers, such as "int32"
    stamped   whether its messages carry a header with a stamp of their own
    known     whether its messages can be read: the type is a common one, or its definition is in the bag
    """

    name: str
    type: str
    count: int
    fields: dict[str, str] = field(default_factory=dict)
    stamped: bool = False
    known: bool = True

    def __str__(self) -> str:
        return f"{self.name} ({self.type.replace('/msg/', '/')}, {self.count} messages)"


@dataclass(frozen=True, slots=True)
class Received:
    """A message as the recorder got it."""

    place: str  # "/odom, message 7"
    bag_ns: int  # when it was recorded
    content: Any

    @property
    def header_ns(self) -> int:
        """The stamp that its sender gave it."""
        stamp = self.content.header.stamp
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)


class Bag:
    """A bag whose index has been read.

    raises  DataError when it is none, or is damaged
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts = _parts(path)
        self._ros1 = self._parts[0].suffix == ROS1
        self._types = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.LATEST)
        self._defined: dict[str, Typesdict] = {}  # type -> it, and what it is made of
        with self._opened() as readers:
            connections = [connection for reader in readers for connection in reader.connections]
            self.topics = {topic.name: topic for topic in self._topics(connections)}

    @property
    def unread(self) -> str:
        """What lies beside the bag and is not read, in words; "" when there is nothing."""
        files = self._files("*.db3")
        logs = [log for part in files if (log := part.with_name(f"{part.name}-wal")).exists() and log.stat().st_size]
        if not logs:
            return ""
        return f"{logs[0].name} holds messages that are not in the bag yet and are not read: {_CURE}"

    def _files(self, pattern: str) -> list[Path]:
        files = [file for part in self._parts for file in ([part] if part.is_file() else sorted(part.iterdir()))]
        return [file for file in files if file.match(pattern)]

    def messages(self, topic: Topic) -> Iterator[Received]:
        """Its messages in the order in which they were recorded.

        raises  DataError where a message cannot be read
        """
        number = 0
        with self._opened() as readers:
            self._learn(topic.type)
            for reader in readers:
                wanted = [connection for connection in reader.connections if connection.topic == topic.name]
                for _, bag_ns, data in reader.messages(wanted) if wanted else ():
                    number += 1
                    place = f"{topic.name}, message {number}"
                    yield Received(place, bag_ns, self._content(place, data, topic.type))

    def _content(self, place: str, data: bytes, name: str) -> Any:
        try:
            return self._types.deserialize_ros1(data, name) if self._ros1 else self._types.deserialize_cdr(data, name)
        except Exception as error:
            because = f"its bytes are no {name.replace('/msg/', '/')}: {_line(error)}"
            raise DataError("OV331", place, because, "omnivert explain OV331") from error

    @contextmanager
    def _opened(self) -> "Iterator[Sequence[Reader1] | Sequence[Reader2]]":
        """A reader for each part, in order of time; what goes wrong while they are open is the bag's fault."""
        try:
            with ExitStack() as stack:
                for part in self._files("*.db3"):
                    _hold_whole(part)
                kind: Callable[[Path], Any] = Reader1 if self._ros1 else Reader2
                readers = [stack.enter_context(kind(part)) for part in self._parts]
                yield sorted(readers, key=lambda reader: reader.start_time)
        except OmnivertError:
            raise
        except Exception as error:  # the library's own, SQLite's, those of decompressors and of the system
            raise _unreadable(self.path, self._parts[0].suffix, _line(error)) from error

    def _topics(self, connections: Sequence[Connection]) -> Iterator[Topic]:
        for name in sorted({connection.topic for connection in connections}):
            there = [connection for connection in connections if connection.topic == name]
            kind = there[0].msgtype
            count = sum(connection.msgcount for connection in there)
            forms = self._types.fielddefs if kind in self._types.fielddefs else _defined(there[0])
            self._defined[kind] = forms
            if kind not in forms:
                yield Topic(name, kind, count, known=False)
                continue
            fields = dict(forms[kind][1])
            numbers = {part: str(form[1][0]) for part, form in fields.items() if form[0] == Nodetype.BASE}
            yield Topic(name, kind, count, numbers, ("header", _HEADER) in [(n, f[1]) for n, f in fields.items()])

    def _learn(self, kind: str) -> None:
        """From here on messages of this type are understood."""
        common = self._types.fielddefs
        if kind not in common:
            self._types.register({name: form for name, form in self._defined[kind].items() if name not in common})


def _defined(connection: Connection) -> Typesdict:
    """The types that the bag defines for a connection; none where it does not, or nobody understands it."""
    definition = connection.msgdef
    try:
        match definition.format:
            case MessageDefinitionFormat.MSG:
                return get_types_from_msg(definition.data, connection.msgtype)
            case MessageDefinitionFormat.IDL:
                return get_types_from_idl(definition.data)
            case MessageDefinitionFormat.NONE:
                return {}
    except Exception:  # noqa: BLE001 - costs only its own topic, however the grammar refuses it
        return {}


class BagWriter:
    """Writes a bag: of ROS 1 where the name ends in .bag, else of ROS 2, a folder with an MCAP file in it."""

    def __init__(self, path: Path) -> None:
        self._ros1 = path.suffix == ROS1
        self._types = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.ROS2_HUMBLE)
        if self._ros1:  # the one type of ours that is not among the library's common ones there
            self._types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", _TRANSFORMS))
        self._writer: Any = Writer1(path) if self._ros1 else Writer2(path, version=8, storage_plugin=StoragePlugin.MCAP)
        self._connections: dict[str, Connection] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        """A message, or a part of one; `kind` as in "geometry_msgs/Pose"."""
        name = kind.replace("/", "/msg/")
        if self._ros1 and name == _HEADER:
            fields["seq"] = 0
        return self._types.types[name](**fields)

    def stamp(self, stamp_ns: int) -> Any:
        return self.make("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Adds a message, recorded when its stamp says."""
        name: str = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, name, typestore=self._types)
        serialized = self._types.serialize_ros1 if self._ros1 else self._types.serialize_cdr
        self._writer.write(self._connections[topic], stamp_ns, serialized(message, name))

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.__exit__(kind, error, trace)


def _hold_whole(base: Path) -> None:
    """SQLite takes what is missing at the end of its file for zeros.

    raises  ValueError when the file is shorter than its first page says
    """
    with base.open("rb") as file:
        head = file.read(100)
    if len(head) == 100 and head[24:28] == head[92:96]:  # else whoever wrote it did not keep its length there
        page = int.from_bytes(head[16:18])
        said = (page if page > 1 else 65536) * int.from_bytes(head[28:32])
        if said > base.stat().st_size:
            raise ValueError(f"{base.name} ends in the middle, after {base.stat().st_size} of {said} bytes")


def _parts(path: Path) -> list[Path]:
    """The files, or the folder, that the library reads as one."""
    if path.is_file() and path.suffix in _PARTS:
        return [path]
    if (path / _METADATA).is_file():
        return [path]
    for suffix in _PARTS:  # what a recorder that was killed has left, or the pieces of a long bag of ROS 1
        if parts := sorted(path.glob(f"*{suffix}")):
            return parts
    because = "a bag is a .bag file, a folder with metadata.yaml, or a .db3 or .mcap file"
    if not path.exists():
        because = "there is no such file or folder"
    raise DataError("OV331", f"{path} is no bag", because, "omnivert explain OV331")


def _unreadable(path: Path, suffix: str, because: str) -> DataError:
    return DataError("OV331", f"{path} cannot be read as a bag", because, _CURES.get(suffix, _CURE))


def _line(error: Exception) -> str:
    """What an error says, in one short line."""
    return " ".join(str(error).split())[:200] or type(error).__name__
