"""Recordings -> a recording: a part of one, or several one after the other."""

import heapq
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from shlex import quote

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.frame_tables import joined, part_of
from omnivert.formats.written import Progress, new_recording
from omnivert.messages import Bearings, Frame, Scan, Ticks
from omnivert.wire.channels import BEARINGS, FRAME, channel_from_key
from omnivert.wire.recording import Entry, Recording

_SENSORS = (Frame, Ticks, Scan, Bearings)  # whose stamps grow in each stream
_COMPRESSION = "lz4"  # as the recorder's


def cut(
    recording: Recording,
    out: Path,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Progress = lambda done, of: None,
) -> dict[str, int]:
    """Writes what lies between two times into a recording of its own; returns how many messages of each key.

    from_s, to_s  counted from the recording's start, to_s excluded; None: its start, its end
    raises        DataError when there is nothing between them
    """
    config = recording.config(Config())
    frame = _frame_key(recording, config)
    before, total = 0, recording.counts.total()
    with new_recording(out, config, _COMPRESSION) as writer:
        if from_s is not None:
            before = recording.count({frame}, None, from_s)
        for done, entry in enumerate(_keyed(recording.entries(None, from_s, to_s)), 1):
            _put(writer.put, entry)
            progress(done, total)
        if not writer.counts:
            lasts_s = 1e-9 * (recording.end_ns - recording.start_ns)
            what = f"{recording.path} holds nothing between these times"
            raise DataError(
                "OV305", what, f"it lasts {lasts_s:.1f} s", f"omnivert rec info {quote(str(recording.path))}"
            )
        for name in recording.attachments:
            data = recording.attachment(name)
            writer.attach(name, part_of(data, before, writer.counts[frame]) if _is_table(name) else data)
        return dict(writer.counts)


def merge(
    recordings: Sequence[Recording], out: Path, progress: Progress = lambda done, of: None
) -> tuple[dict[str, int], tuple[str, ...]]:
    """Writes recordings of one rig that follow each other into one.

    returns  messages of each key; names of attachments that differ and are no tables by frame: left out
    raises   DataError when the rigs differ, or a stream of one goes on when that of the next has begun
    """
    parts = sorted(recordings, key=lambda part: part.start_ns)
    config = parts[0].config(Config())
    for part in parts[1:]:
        _hold_alike(parts[0], part)
    for earlier, later in ((a, b) for k, b in enumerate(parts) for a in parts[:k]):
        _hold_apart(earlier, later)
    total = sum(part.counts.total() for part in parts)
    with new_recording(out, config, _COMPRESSION) as writer:
        for done, entry in enumerate(_keyed(_in_order(parts)), 1):
            _put(writer.put, entry)
            progress(done, total)
        left_out = []
        for name in dict.fromkeys(name for part in parts for name in part.attachments):
            if (data := _merged(name, parts, config)) is None:
                left_out.append(name)
            else:
                writer.attach(name, data)
        return dict(writer.counts), tuple(left_out)


def _frame_key(recording: Recording, config: Config) -> str:
    """Of the stream whose messages the tables of the truth are counted by."""
    frame = FRAME.key(config)
    return frame if frame in recording.counts else BEARINGS.key(config)


def _is_table(name: str) -> bool:
    return name.startswith("truth/") and name.endswith(".csv")


def _merged(name: str, parts: Sequence[Recording], config: Config) -> bytes | None:
    """An attachment of the whole: tables by frame one after the other, else what all have alike; None: they differ."""
    before, tables = 0, []
    for part in parts:
        if name in part.attachments:
            tables.append((before, part.attachment(name)))
        before += part.counts[_frame_key(part, config)]
    if _is_table(name) and (table := joined(tables)) is not None:
        return table
    first, *others = (data for _, data in tables)
    return first if all(other == first for other in others) else None


def _keyed(entries: Iterator[Entry]) -> Iterator[Entry]:
    """Without those of which a damaged file does not tell any more what they are."""
    return (entry for entry in entries if entry.name)


def _put(put: Callable[[str, str, int, bytes], None], entry: Entry) -> None:
    put(entry.key, entry.name, entry.stamp_ns, entry.data)


def _in_order(parts: Sequence[Recording]) -> Iterator[Entry]:
    """All messages by stamp; a part is opened when its time has come."""
    waiting = deque(parts)
    opened: list[tuple[int, int, Entry, Iterator[Entry]]] = []
    while waiting or opened:
        while waiting and (not opened or waiting[0].start_ns <= opened[0][0]):
            entries = waiting.popleft().entries()
            if (entry := next(entries, None)) is not None:
                heapq.heappush(opened, (entry.at_ns, len(parts) - len(waiting), entry, entries))
        if opened:
            _, number, entry, entries = opened[0]
            yield entry
            if (following := next(entries, None)) is not None:
                heapq.heapreplace(opened, (following.at_ns, number, following, entries))
            else:
                heapq.heappop(opened)


def _hold_alike(first: Recording, other: Recording) -> None:
    """raises DataError when the rigs differ"""
    ours, theirs = first.config(Config()).rig(), other.config(Config()).rig()
    differ = [f"{table}.{key}" for table, keys in ours.items() for key in keys if keys[key] != theirs[table][key]]
    if differ:
        what = f"{first.path} and {other.path} are not of one rig"
        raise DataError("OV312", what, f"they differ in {', '.join(differ)}", "omnivert explain OV312")


def _hold_apart(earlier: Recording, later: Recording) -> None:
    """raises DataError when a sensor's stream of both is of the same time"""
    for key in sorted(earlier.spans.keys() & later.spans.keys()):
        channel = channel_from_key(key)
        over_ns = earlier.spans[key][1] - later.spans[key][0]
        if channel is not None and channel.message in _SENSORS and over_ns >= 0:
            what = f"{earlier.path} and {later.path} overlap"
            because = f"{key} of the first goes on for {over_ns * 1e-9:.3f} s when that of the second has begun"
            raise DataError("OV312", what, because, "omnivert rec cut takes a part of one")
