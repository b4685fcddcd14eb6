"""A part of a recording, and parts made one again: every message as it was; what is no one drive is refused."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnivert.cli.settings import recording_path
from omnivert.config import Config, parsed
from omnivert.errors import DataError
from omnivert.formats.recut import cut, merge
from omnivert.messages import Bearings, Frame, Health, Message, PixelFormat, Ticks
from omnivert.wire.channels import CHANNELS
from omnivert.wire.codec import encode
from omnivert.wire.recording import Entry, Recording, RecordingWriter
from services._parts import Parts

MS = 1_000_000
SECOND = 1000 * MS
CONFIG = parsed({"robot": {"id": "r7", "wheel_base_m": 0.31}}, "the test")
KEYS = {channel.message: channel.key(CONFIG) for channel in CHANNELS} | {Health: "v1/vision/front/health"}


def bearings(stamp_ns: int) -> Bearings:
    none = np.zeros(0)
    return Bearings(stamp_ns, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))


def drive(seconds: int, first_s: int = 100) -> list[Message]:
    """Ten ticks and five frames a second; bearings come 270 ms after their frame, health by another clock."""
    out: list[tuple[int, Message]] = []
    for i in range(10 * seconds):
        stamp = first_s * SECOND + i * 100 * MS
        out.append((stamp, Ticks(stamp, i, -i)))
        if i % 2 == 0:
            data = np.full(40, i % 256, np.uint8)
            out += [
                (stamp + MS, Frame(stamp + MS, PixelFormat.PNG, 4, 3, data)),
                (stamp + 271 * MS, bearings(stamp + MS)),
            ]
        if i % 10 == 5:
            out.append((stamp, Health(7 + i, "vision", "front", 1.0)))
    return [message for _, message in sorted(out, key=lambda entry: entry[0])]


def written(
    path: Path, messages: list[Message], attached: dict[str, bytes] | None = None, config: Config = CONFIG
) -> Recording:
    with RecordingWriter(path, config) as writer:
        for message in messages:
            writer.write(KEYS[type(message)], message)
        for name, data in (attached or {}).items():
            writer.attach(name, data)
    return Recording(path)


def held(recording: Recording) -> list[tuple[int, str, bytes]]:
    return [(entry.stamp_ns, entry.key, entry.data) for entry in recording.entries()]


def messages_of(messages: list[Message]) -> list[bytes]:
    return sorted(encode(message) for message in messages)


# ------------------------------------------------------------------ cut


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(times=st.lists(st.floats(0.0, 6.0), min_size=1, max_size=4).map(sorted))
def test_parts_cut_anywhere_are_the_whole_again(tmp_path: Path, times: Any) -> None:
    table = "index,line_id,bearing_rad\n" + "".join(f"{k},{10 + k},0.{k}\n" for k in range(30))
    whole = written(tmp_path / "whole.mcap", drive(6), {"truth/lines.csv": table.encode()})
    parts = []
    for number, (begin, end) in enumerate(zip([None, *times], [*times, None], strict=True)):
        path = tmp_path / f"{number}.mcap"
        path.unlink(missing_ok=True)
        try:
            counts = cut(whole, path, begin, end)
        except DataError as error:
            assert error.code == "OV305"  # noqa: PT017 - nothing between two times is one of two right outcomes
            assert not path.exists()
            continue
        assert counts == dict(Recording(path).counts)
        parts.append(Recording(path))
    assert [entry for part in parts for entry in held(part)] == held(whole)
    assert all(part.config(Config()) == whole.config(Config()) for part in parts)
    if len(parts) > 1:
        merge(parts[::-1], tmp_path / "merged.mcap")
        merged = Recording(tmp_path / "merged.mcap")
        assert held(merged) == held(whole)
        assert merged.attachment("truth/lines.csv").decode() == table


def test_truth_by_frame_goes_with_its_frames_and_all_else_stays(tmp_path: Path) -> None:
    table = "index,line_id,bearing_rad\n" + "".join(f"{k},{10 + k},0.{k}\n{k},{20 + k},0.5\n" for k in range(30))
    attached = {
        "truth/lines.csv": table.encode(),
        "truth/edges.csv": b"line_id,x_m\n1,2.0\n",
        "truth/extrinsics.json": b'{"index": 3}',
        "meta.json": b"{}",
        "truth/odd.csv": b"index,x\nno,1\n",
    }
    whole = written(tmp_path / "a.mcap", drive(6), attached)
    cut(whole, tmp_path / "b.mcap", 1.0, 1.5)
    part = Recording(tmp_path / "b.mcap")
    assert part.counts[KEYS[Frame]] == 3  # numbers 5, 6, 7
    rows = part.attachment("truth/lines.csv").decode().splitlines()
    assert rows[1:3] == ["0,15,0.5", "0,25,0.5"]
    assert [row.split(",")[0] for row in rows[1:]] == ["0", "0", "1", "1", "2", "2"]
    others = attached.keys() - {"truth/lines.csv"}
    assert {name: part.attachment(name) for name in others} == {name: attached[name] for name in others}


def test_the_truth_of_a_part_of_the_corridor_is_that_of_its_frames(tmp_path: Path) -> None:
    from omnivert.bench.score.truth import truth_of

    corridor = Recording(recording_path("corridor"))
    cut(corridor, tmp_path / "part.mcap", 10.0, 12.0)
    whole, part = truth_of(corridor), truth_of(Recording(tmp_path / "part.mcap"))
    assert whole is not None
    assert part is not None
    assert len(part) == 6
    for there, here in zip(whole[30:36], part, strict=True):
        assert there is not None
        assert here is not None
        assert np.array_equal(there.bearing_rad, here.bearing_rad)
        assert there.center_px == here.center_px


def test_of_a_file_that_is_not_whole_a_cut_makes_one_that_is(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", drive(6)).path
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    torn = Recording(path)
    assert torn.cut
    cut(torn, tmp_path / "b.mcap")
    again = Recording(tmp_path / "b.mcap")
    assert (again.cut, again.lost) == ("", 0)
    assert held(again) == held(torn)


@pytest.mark.parametrize("work", ["cut", "merge"])
def test_what_fails_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, work: str) -> None:
    a, b = written(tmp_path / "a.mcap", drive(2)), written(tmp_path / "b.mcap", drive(2, 200))
    put, before = RecordingWriter.put, sorted(tmp_path.iterdir())

    def full(*given: Any) -> None:
        put(*given)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RecordingWriter, "put", full)
    with pytest.raises(DataError, match="No space left") as refused:
        cut(a, tmp_path / "c.mcap") if work == "cut" else merge([a, b], tmp_path / "c.mcap")
    assert refused.value.code == "OV311"
    assert sorted(tmp_path.iterdir()) == before


# ------------------------------------------------------------------ merge


@pytest.mark.parametrize("seconds", [1.0, 1.73])
def test_what_a_recorder_has_split_is_one_drive_again(tmp_path: Path, seconds: float) -> None:
    """Results come later than what they are of, so that the parts overlap in time, though no stream of them does."""
    split = parsed({**CONFIG.model_dump(mode="json"), "recorder": {"split_s": seconds}}, "the test")
    messages = drive(6)
    with Parts(tmp_path / "drive.mcap", split) as parts:
        for message in messages:
            parts.put(KEYS[type(message)], message, encode(message))
    recordings = [Recording(path) for path in parts.paths]
    assert any(b.start_ns < a.end_ns for a, b in pairwise(recordings))
    counts, left_out = merge(recordings, tmp_path / "whole.mcap")
    whole = Recording(tmp_path / "whole.mcap")
    assert (counts, left_out) == (dict(whole.counts), ())
    assert sorted(data for _, _, data in held(whole)) == messages_of(messages)
    stamps = [entry.at_ns for entry in whole.entries()]
    assert stamps == sorted(stamps)


def test_a_part_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    a, b = written(tmp_path / "a.mcap", drive(3)), written(tmp_path / "b.mcap", drive(3, 102))
    for parts in ([a, a], [a, b], [b, a]):
        with pytest.raises(DataError, match=r"overlap: v1/.* goes on for") as refused:
            merge(parts, tmp_path / "c.mcap")
        assert refused.value.code == "OV312"
    assert not (tmp_path / "c.mcap").exists()


def test_one_that_lies_within_another_is_refused_though_a_third_begins_between(tmp_path: Path) -> None:
    long = written(tmp_path / "long.mcap", [m for m in drive(9) if isinstance(m, Ticks)])
    frames = written(tmp_path / "frames.mcap", [m for m in drive(1, 102) if isinstance(m, Frame)])
    within = written(tmp_path / "within.mcap", [m for m in drive(1, 104) if isinstance(m, Ticks)])
    with pytest.raises(DataError, match=r"long\.mcap and .*within\.mcap overlap"):
        merge([within, frames, long], tmp_path / "c.mcap")
    merge([frames, long], tmp_path / "c.mcap")


def test_other_rigs_are_refused_with_what_differs(tmp_path: Path) -> None:
    other = parsed({"robot": {"id": "r7", "wheel_base_m": 0.32}, "encoder": {"ticks_per_rev": 77}}, "the test")
    a, b = written(tmp_path / "a.mcap", drive(2)), written(tmp_path / "b.mcap", drive(2, 200), config=other)
    with pytest.raises(DataError, match=r"not of one rig: they differ in robot\.wheel_base_m, encoder\.ticks_per_rev"):
        merge([a, b], tmp_path / "c.mcap")


def test_truth_that_one_part_alone_carries_stays_with_its_frames(tmp_path: Path) -> None:
    tables = {"truth/lines.csv": b"index,x\n0,1\n1,2\n", "truth/world.csv": b"line_id,x\n1,2\n"}
    cut_short = {"truth/poses.csv": b"index,x\n0,5"}  # without an end of its last line
    a = written(tmp_path / "a.mcap", drive(2), {"truth/odd.csv": b"index,x\n0,1\n"} | cut_short)
    b = written(tmp_path / "b.mcap", drive(2, 200), tables | {"truth/odd.csv": b"index,y\n0,1\n"} | cut_short)
    frames = a.counts[KEYS[Frame]]
    _, left_out = merge([b, a], tmp_path / "c.mcap")
    merged = Recording(tmp_path / "c.mcap")
    assert left_out == ("truth/odd.csv",)  # of other columns
    assert merged.attachment("truth/lines.csv").decode() == f"index,x\n{frames},1\n{frames + 1},2\n"
    assert merged.attachment("truth/world.csv") == tables["truth/world.csv"]
    assert merged.attachment("truth/poses.csv").decode() == f"index,x\n0,5\n{frames},5"


def test_what_differs_between_the_files_that_they_carry_is_left_out_and_said(tmp_path: Path) -> None:
    a = written(tmp_path / "a.mcap", drive(2), {"same": b"1", "other": b"2", "first": b"3"})
    b = written(tmp_path / "b.mcap", drive(2, 200), {"same": b"1", "other": b"4"})
    _, left_out = merge([a, b], tmp_path / "c.mcap")
    merged = Recording(tmp_path / "c.mcap")
    assert (left_out, merged.attachments, merged.attachment("first")) == (("other",), ("same", "first"), b"3")


def test_a_merge_opens_a_part_when_its_time_has_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a hundred parts need no more memory than two."""
    parts = [written(tmp_path / f"{k}.mcap", drive(2, 100 * k)) for k in range(1, 9)]
    opened: list[Recording] = []
    read = Recording.entries

    def counted(part: Recording) -> Iterator[Entry]:
        opened.append(part)
        return read(part)

    monkeypatch.setattr(Recording, "entries", counted)
    total = sum(part.counts.total() for part in parts)
    told: list[tuple[int, int, int]] = []
    merge(parts, tmp_path / "all.mcap", lambda done, of: told.append((done, len(opened), of)))
    assert all(count <= 2 + done * len(parts) / total for done, count, _ in told)
    assert told[-1] == (total, len(parts), total)
