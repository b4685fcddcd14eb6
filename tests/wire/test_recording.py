"""A recording gives back what was written, in the order of the stamps, and of a broken file what it still holds."""

import dataclasses
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnivert.config import Config, Robot
from omnivert.errors import DataError
from omnivert.messages import Frame, Health, Message, PixelFormat, Ticks
from omnivert.wire import mcap_file
from omnivert.wire import recording_writer as module
from omnivert.wire.codec import encode
from omnivert.wire.recording import Recording, RecordingWriter

SECOND = 1_000_000_000
TICKS = "v1/encoder/base/ticks"
FRAME = "v1/camera/front/frame"
CONFIG = Config(robot=Robot(id="r7", wheel_base_m=0.5))
CHUNK, DATA_END = 6, 15  # opcodes of MCAP


def drive(seconds: int = 5) -> list[tuple[str, Message]]:
    noise = np.random.default_rng(1)
    out: list[tuple[str, Message]] = []
    for i in range(seconds * 50):
        out.append((TICKS, Ticks(100 * SECOND + i * SECOND // 50, i, -i)))
        if i % 5 == 0:
            data = noise.integers(0, 256, 300, dtype=np.uint8)
            out.append((FRAME, Frame(100 * SECOND + i * SECOND // 50 + 1, PixelFormat.PNG, 4, 3, data)))
    return out


def written(path: Path, messages: list[tuple[str, Message]], compression: str = "zstd") -> Path:
    with RecordingWriter(path, CONFIG, compression) as writer:
        for key, message in messages:
            writer.write(key, message)
    return path


def held(recording: Recording, **which: object) -> list[tuple[str, bytes]]:
    return [(key, encode(message)) for key, message in recording.messages(**which)]  # type: ignore[arg-type]


def as_bytes(messages: list[tuple[str, Message]]) -> list[tuple[str, bytes]]:
    return [(key, encode(message)) for key, message in messages]


def test_what_was_written_comes_back(tmp_path: Path) -> None:
    messages = drive()
    recording = Recording(written(tmp_path / "a.mcap", messages))
    assert held(recording) == as_bytes(messages)
    assert recording.counts == {TICKS: 250, FRAME: 50}
    assert recording.cut == ""
    assert (recording.start_ns, recording.end_ns) == (messages[0][1].stamp_ns, messages[-1][1].stamp_ns)
    assert recording.config(Config()) == CONFIG
    assert set(recording.rig) == {"robot", "encoder", "camera", "ring"}


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(stamps=st.lists(st.integers(0, 20 * SECOND), min_size=1, max_size=60))
def test_messages_come_in_the_order_of_their_stamps_equal_ones_as_written(tmp_path: Path, stamps: Any) -> None:
    messages: list[tuple[str, Message]] = [(TICKS, Ticks(stamp, i, 0)) for i, stamp in enumerate(stamps)]
    recording = Recording(written(tmp_path / "a.mcap", messages))
    assert held(recording) == as_bytes(sorted(messages, key=lambda entry: entry[1].stamp_ns))


def test_a_part_can_be_read(tmp_path: Path) -> None:
    messages = drive()
    recording = Recording(written(tmp_path / "a.mcap", messages))
    inside = [m for m in messages if SECOND <= m[1].stamp_ns - 100 * SECOND < 2 * SECOND]
    assert held(recording, from_s=1.0, to_s=2.0) == as_bytes(inside)
    assert held(recording, types=(Frame,), from_s=1.0, to_s=2.0) == as_bytes([m for m in inside if m[0] == FRAME])
    assert recording.count({FRAME}, 1.0, 2.0) == sum(key == FRAME for key, _ in inside)
    assert recording.count({FRAME}) == 50


@pytest.mark.parametrize("far", [1e9, 1.9e10, 1e300])
def test_a_part_far_beyond_the_end_is_empty(tmp_path: Path, far: float) -> None:
    recording = Recording(written(tmp_path / "a.mcap", drive()))
    assert held(recording, from_s=far) == held(recording, from_s=far, to_s=2.0 * far) == []
    assert held(recording, to_s=far) == as_bytes(drive())


def test_attachments_stand_beside_the_messages(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", CONFIG) as writer:
        writer.write(*drive()[0])
        writer.attach("truth.json", b"{}")
        writer.attach("empty", b"")
    recording = Recording(tmp_path / "a.mcap")
    assert recording.attachments == ("truth.json", "empty")
    assert recording.attachment("truth.json") == b"{}"
    assert recording.attachment("empty") == b""


def test_the_hosts_clock_is_no_part_of_the_span(tmp_path: Path) -> None:
    health = ("v1/vision/front/health", Health(7, "vision", "front", 1.0))
    recording = Recording(written(tmp_path / "a.mcap", [*drive(), health]))
    assert recording.start_ns == 100 * SECOND


@pytest.mark.parametrize("host_ns", [7, 10**18])
def test_what_is_of_the_hosts_clock_stands_where_it_came(tmp_path: Path, host_ns: int) -> None:
    """On a playback that clock is hours or years away from the drive's."""
    messages = drive()
    middle = len(messages) // 2
    health = ("v1/vision/front/health", Health(host_ns, "vision", "front", 1.0))
    recording = Recording(written(tmp_path / "a.mcap", [*messages[:middle], health, *messages[middle:]]))
    assert held(recording) == as_bytes([*messages[:middle], health, *messages[middle:]])
    at_s = (messages[middle - 1][1].stamp_ns - messages[0][1].stamp_ns) / SECOND
    assert held(recording, types=(Health,), from_s=at_s - 0.01, to_s=at_s + 0.01) == as_bytes([health])
    (entry,) = recording.entries({"Health"})
    assert (entry.at_ns, entry.stamp_ns) == (messages[middle - 1][1].stamp_ns, host_ns)


@pytest.mark.parametrize("host_ns", [7, 10**18])
def test_what_is_of_the_hosts_clock_and_comes_first_stands_at_the_first_of_a_sensor(
    tmp_path: Path, host_ns: int
) -> None:
    """Services are there, and say so, before a playback begins: its recording is not hours long for that."""
    health = [("v1/vision/front/health", Health(host_ns + k, "vision", "front", 1.0)) for k in range(3)]
    recording = Recording(written(tmp_path / "a.mcap", [*health, *drive()]))
    assert held(recording) == as_bytes([*health, *drive()])
    first_ns = drive()[0][1].stamp_ns
    assert [(e.at_ns, e.stamp_ns) for e in recording.entries({"Health"})] == [(first_ns, host_ns + k) for k in range(3)]


def test_what_is_of_the_hosts_clock_alone_is_kept(tmp_path: Path) -> None:
    health: list[tuple[str, Message]] = [
        ("v1/vision/front/health", Health(7 + k, "vision", "front", 1.0)) for k in range(3000)
    ]
    assert held(Recording(written(tmp_path / "a.mcap", health))) == as_bytes(health)


def test_chunks_are_given_back_while_the_next_are_read_whatever_the_hosts_clock_says(tmp_path: Path) -> None:
    """A recording may be larger than the memory: no more than two of its seconds are held at a time."""
    messages = [
        entry for i, message in enumerate(drive(20)) for entry in (message, ("h", Health(i, "vision", "front", 1.0)))
    ]
    recording = Recording(written(tmp_path / "a.mcap", messages))
    opened: list[mcap_file.Place] = []
    read = mcap_file.chunk

    def counted(file: BinaryIO, place: mcap_file.Place) -> list[Any]:
        opened.append(place)
        return read(file, place)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mcap_file, "chunk", counted)
        for number, _ in enumerate(recording.entries()):
            assert len(opened) <= 2 + number * recording.chunks / len(messages)
    assert len(opened) == recording.chunks >= 20


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_however_it_is_compressed_it_is_read(tmp_path: Path, compression: str) -> None:
    path = written(tmp_path / "a.mcap", drive(2), compression)
    assert held(Recording(path)) == as_bytes(drive(2))
    named = {"zstd": b"zstd", "lz4": b"lz4", "none": b""}[compression]
    assert (b"zstd" in path.read_bytes(), b"lz4" in path.read_bytes()) == (named == b"zstd", named == b"lz4")


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(where=st.floats(0.0, 1.0), compression=st.sampled_from(["zstd", "lz4", "none"]))
def test_of_a_writer_killed_at_any_byte_every_closed_second_is_there(
    tmp_path: Path, where: float, compression: str
) -> None:
    messages, path = drive(3), tmp_path / f"{compression}.mcap"
    if not path.exists():
        written(path, messages, compression)
    whole = path.read_bytes()
    size = round(where * len(whole))
    closed = sum(place + length <= size for place, length in chunks(path))
    (tmp_path / "cut.mcap").write_bytes(whole[:size])
    try:
        got = held(Recording(tmp_path / "cut.mcap"))
    except DataError:
        got = []
    assert got == as_bytes(messages)[: closed * 60]


def test_two_recordings_of_the_same_have_the_same_bytes(tmp_path: Path) -> None:
    a, b = (written(tmp_path / name, drive()).read_bytes() for name in ("a", "b"))
    assert a == b


# ------------------------------------------------------------------ broken files


def test_a_file_cut_anywhere_gives_all_closed_chunks_before_the_cut(tmp_path: Path) -> None:
    messages = drive()
    whole = written(tmp_path / "a.mcap", messages).read_bytes()
    expected = as_bytes(messages)
    most = 0
    for size in range(len(whole) - 1, 8, -997):
        part = tmp_path / "cut.mcap"
        part.write_bytes(whole[:size])
        try:
            recording = Recording(part)
        except DataError as error:
            assert error.code == "OV303"  # noqa: PT017 - one of two right outcomes
            continue
        got = held(recording)
        assert got == expected[: len(got)]
        most = max(most, len(got))
        if len(got) < len(expected):
            assert recording.cut == "it ends in the middle"
    assert most == len(expected)


def test_what_was_flushed_is_readable_while_the_writer_still_writes(tmp_path: Path) -> None:
    messages = drive()
    with RecordingWriter(tmp_path / "a.mcap", CONFIG) as writer:
        for key, message in messages[:100]:
            writer.write(key, message)
        writer.flush()
        recording = Recording(tmp_path / "a.mcap")
        assert held(recording) == as_bytes(messages[:100])
        assert recording.cut


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    messages = drive()
    path = written(tmp_path / "a.mcap", messages)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    recording = Recording(path)
    got = held(recording)
    assert len(messages) - 70 < len(got) < len(messages)
    assert set(got) < set(as_bytes(messages))
    assert recording.cut == "a part of it is damaged"


def flipped(path: Path, place: int, bit: int = 0) -> Path:
    """A copy of the file with one bit turned over."""
    data = bytearray(path.read_bytes())
    data[place] ^= 1 << bit
    path.with_suffix(".flipped").write_bytes(data)
    return path.with_suffix(".flipped")


def chunks(path: Path) -> list[tuple[int, int]]:
    """Where the record of each chunk begins, and how long it is."""
    data, place, found = path.read_bytes(), 8, []
    while data[place] != DATA_END:
        length = 9 + int.from_bytes(data[place + 1 : place + 9], "little")
        found += [(place, length)] * (data[place] == CHUNK)
        place += length
    return found


def chunk_place(path: Path, number: int = 0) -> int:
    return chunks(path)[number][0]


@pytest.mark.parametrize("behind", [9 + 60, 9 + 300])
def test_a_wrong_bit_in_the_first_chunk_costs_that_chunk_only(tmp_path: Path, behind: int) -> None:
    messages = drive()
    path = written(tmp_path / "a.mcap", messages)
    recording = Recording(flipped(path, chunk_place(path) + behind))
    assert held(recording) == as_bytes(messages)[60:]
    assert (recording.cut, recording.lost) == ("a part of it is damaged", 60)


# ------------------------------------------------------------------ opened quickly


def told(recording: Recording) -> tuple[object, ...]:
    """What is known of a recording once all of it has been read."""
    return (
        dict(recording.counts),
        recording.spans,
        (recording.start_ns, recording.end_ns),
        (recording.cut, recording.lost, recording.chunks),
        recording.refused,
    )


stamped = st.lists(st.tuples(st.integers(0, 20 * SECOND), st.sampled_from(["ticks", "frame", "health"])), min_size=1)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(stamped=stamped)
def test_a_whole_file_that_is_opened_quickly_tells_and_gives_the_same(tmp_path: Path, stamped: Any) -> None:
    kinds: dict[str, Any] = {
        "ticks": lambda stamp_ns: (TICKS, Ticks(stamp_ns, 1, 2)),
        "frame": lambda stamp_ns: (FRAME, Frame(stamp_ns, PixelFormat.PNG, 4, 3, np.zeros(300, np.uint8))),
        "health": lambda stamp_ns: ("v1/vision/front/health", Health(stamp_ns, "vision", "front", 1.0)),
    }
    path = written(tmp_path / "a.mcap", [kinds[kind](stamp_ns) for stamp_ns, kind in stamped])
    quick, thorough = Recording(path, quick=True), Recording(path)
    assert told(quick) == told(thorough)
    assert held(quick) == held(thorough)


def test_a_whole_file_that_is_opened_quickly_is_not_looked_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "a.mcap", drive())
    looked: list[mcap_file.Place] = []
    chunk = mcap_file.chunk

    def counted(file: BinaryIO, place: mcap_file.Place) -> list[Any]:
        looked.append(place)
        return chunk(file, place)

    monkeypatch.setattr(mcap_file, "chunk", counted)
    recording = Recording(path, quick=True)
    assert looked == []
    held(recording)
    assert len(looked) == recording.chunks == 5


def test_a_damaged_chunk_of_a_file_that_was_opened_quickly_is_found_when_it_is_read(tmp_path: Path) -> None:
    messages = drive()
    path = written(tmp_path / "a.mcap", messages)
    recording = Recording(flipped(path, chunk_place(path) + 69), quick=True)
    assert (recording.cut, recording.lost) == ("", 0)
    for _ in range(2):  # counted once, as often as it is read
        assert held(recording) == as_bytes(messages)[60:]
        assert (recording.cut, recording.lost) == ("a part of it is damaged", 60)
        assert recording.refused == {"damaged chunk": 1}


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_wrong_bit_anywhere_costs_no_more_when_it_was_opened_quickly(tmp_path: Path, place: float, bit: int) -> None:
    path = written(tmp_path / "a.mcap", drive(2), "none")
    path = flipped(path, int(place * path.stat().st_size), bit)

    def read(quick: bool) -> tuple[object, ...]:
        try:
            recording = Recording(path, quick=quick)
            messages = held(recording)
        except DataError as error:
            return (error.code,)
        return sorted(messages), recording.lost, recording.cut, recording.refused

    assert read(quick=True) == read(quick=False)


@pytest.mark.parametrize(("byte", "bit"), [(0, 3), (1, 0), (2, 1), (6, 7)])
def test_a_wrong_bit_in_a_chunks_head_costs_nothing_and_is_said(tmp_path: Path, byte: int, bit: int) -> None:
    messages = drive()
    path = written(tmp_path / "a.mcap", messages)
    recording = Recording(flipped(path, chunk_place(path) + byte, bit))
    assert held(recording) == as_bytes(messages)
    assert (recording.cut, recording.lost) == ("a part of it is damaged", 0)


@pytest.mark.parametrize("back", [8, 20, 40, 200])
def test_a_wrong_bit_in_the_summary_costs_nothing(tmp_path: Path, back: int) -> None:
    messages = drive()
    path = written(tmp_path / "a.mcap", messages)
    recording = Recording(flipped(path, len(path.read_bytes()) - back))
    assert held(recording) == as_bytes(messages)
    assert (recording.start_ns, recording.end_ns) == (messages[0][1].stamp_ns, messages[-1][1].stamp_ns)


def test_no_wrong_bit_of_the_rig_gives_another_rig(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", drive(1))
    other = Config(robot=Robot(id="other"))
    refused = 0
    for place in range(chunk_place(path)):
        for bit in (0, 5):
            try:
                given = Recording(flipped(path, place, bit)).config(other)
            except DataError as error:
                assert error.code in ("OV302", "OV309")  # noqa: PT017 - one of two right outcomes
                refused += error.code == "OV309"
            else:
                assert given == CONFIG, (place, bit)
    assert refused > 800


def test_a_rig_without_a_digest_is_read_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Before(mcap_file.Writer):
        def add_metadata(self, name: str, data: dict[str, str]) -> None:
            super().add_metadata(name, {"rig": data["rig"]})

    monkeypatch.setattr(mcap_file, "Writer", Before)
    assert Recording(written(tmp_path / "a.mcap", drive(1))).config(Config()) == CONFIG


def test_a_wrong_bit_in_an_attachment_is_found(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", CONFIG) as writer:
        writer.write(*drive(1)[0])
        writer.attach("truth.json", b"the very truth")
    place = (tmp_path / "a.mcap").read_bytes().index(b"the very truth")
    recording = Recording(flipped(tmp_path / "a.mcap", place))
    with pytest.raises(DataError, match=r"truth\.json in .* is damaged") as refused:
        recording.attachment("truth.json")
    assert refused.value.code == "OV306"


@pytest.mark.parametrize(("byte", "bit"), [(0, 6), (8, 6)])
def test_without_a_summary_a_record_that_is_none_is_damage(tmp_path: Path, byte: int, bit: int) -> None:
    messages = drive(3)
    path = written(tmp_path / "a.mcap", messages)
    path.write_bytes(path.read_bytes()[:-8])  # its writer was killed
    recording = Recording(flipped(path, chunk_place(path, 1) + byte, bit))
    assert recording.cut == ("a part of it is damaged" if byte == 0 else "it ends in the middle")
    assert held(recording)[:60] == as_bytes(messages)[:60]


def test_pages_that_never_came_to_the_disk_are_not_read(tmp_path: Path) -> None:
    messages = drive(3)
    path = written(tmp_path / "a.mcap", messages)
    path.write_bytes(path.read_bytes()[: chunk_place(path, 2)] + bytes(50_000_000))
    began = time.process_time()
    recording = Recording(path)
    assert time.process_time() - began < 2.0  # one record of nothing after the other took ten times that
    assert recording.cut == "a part of it is damaged"
    assert held(recording) == as_bytes(messages)[:120]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 1 << 30), byte=st.integers(0, 255))
def test_a_changed_byte_anywhere_is_survived(tmp_path: Path, place: Any, byte: Any) -> None:
    path = tmp_path / "a.mcap"
    if not path.exists():
        written(path, drive(2))
    data = bytearray(path.read_bytes())
    data[place % len(data)] = byte
    (tmp_path / "b.mcap").write_bytes(data)
    with suppress(DataError):
        list(Recording(tmp_path / "b.mcap").messages())


@pytest.mark.parametrize(
    ("content", "code"),
    [(None, "OV301"), (b"", "OV302"), (b"no recording at all", "OV302")],
    ids=["absent", "empty", "text"],
)
def test_what_is_no_recording_is_refused_with_its_name(tmp_path: Path, content: Any, code: Any) -> None:
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, match=r"a\.mcap") as refused:
        Recording(path)
    assert refused.value.code == code


def test_a_full_disk_leaves_a_good_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = 20_000

    class Full(module.FileIO):  # type: ignore[name-defined,misc]
        def write(self, data: bytes) -> int:
            if self.tell() + len(data) > room:
                raise OSError(28, "No space left on device")
            return int(super().write(data))

    monkeypatch.setattr(module, "FileIO", Full)
    messages = drive(10)
    path = tmp_path / "a.mcap"
    with pytest.raises(OSError, match="No space left"):
        written(path, messages)
    got = held(Recording(path))
    assert len(got) > 30
    assert got == as_bytes(messages)[: len(got)]
    assert Recording(path).cut == ""


def test_a_disk_that_is_full_from_the_start_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(module.FileIO):  # type: ignore[name-defined,misc]
        def write(self, data: bytes) -> int:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "FileIO", Full)
    with pytest.raises(OSError, match="No space left"):
        RecordingWriter(tmp_path / "a.mcap", CONFIG)
    assert list(tmp_path.iterdir()) == []


def test_messages_of_another_version_are_counted_and_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good = drive(1)
    monkeypatch.setattr(module, "encode", lambda message: encode(message).replace(b"Ticks\x01", b"Ticks\x09"))
    recording = Recording(written(tmp_path / "a.mcap", good))
    assert all(key == FRAME for key, _ in held(recording))
    assert recording.refused == {"Ticks of another version": 50}


def test_a_closed_writer_refuses_more(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", CONFIG) as writer:
        pass
    with pytest.raises(ValueError, match="closed"):
        writer.write(*drive()[0])


@pytest.mark.parametrize("rig", [{"robot": {"wheel_bbse_m": 0.4}}, {"ring": {"r_max_px": 1e300}}, {"robbt": {}}])
def test_a_rig_that_cannot_be_is_a_fault_of_the_data(tmp_path: Path, rig: dict[str, Any]) -> None:
    recording = Recording(written(tmp_path / "a.mcap", drive(1)))
    recording.rig = rig
    with pytest.raises(DataError) as refused:
        recording.config(Config())
    assert (refused.value.code, refused.value.exit_code) == ("OV307", 1)


def test_a_rig_that_is_not_whole_takes_the_rest_from_the_base(tmp_path: Path) -> None:
    recording = Recording(written(tmp_path / "a.mcap", drive(1)))
    recording.rig = {"robot": {"id": "other"}}
    assert recording.config(Config()).camera == Config().camera
    assert dataclasses.asdict(Ticks(1, 2, 3))["left"] == 2
