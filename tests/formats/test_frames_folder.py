"""The folder of images and encoder counts: all of it comes through, or nothing does and one line says why."""

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.folder import FramesFolder
from omnivert.formats.frames_import import import_frames
from omnivert.formats.table import rows
from omnivert.messages import Frame, Message, PixelFormat, Scan, Ticks
from omnivert.wire.recording import Recording

META: dict[str, Any] = {
    "image": {"width": 64, "height": 48},
    "ring": {"center_px": [32.0, 24.0], "r_min_px": 5.0, "r_max_px": 23.0},
    "bearing_sign": -1,
    "robot": {"wheel_base_m": 0.3, "wheel_diameter_m": 0.1, "ticks_per_rev": 512, "unknown": 1},
    "frame_rate_hz": 10.0,
    "laser": {"angle_min": -1.0, "angle_increment": 0.5, "n": 5, "range_max": 8.0, "invalid": -1.0, "yaw": 0.0},
    "remark": "unknown keys are ignored",
}
PIXELS = np.random.default_rng(1).integers(0, 256, (48, 64), np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three frames, six readings, three scans, and truth."""
    there = tmp_path / "drive"
    (there / "frames").mkdir(parents=True)
    (there / "truth").mkdir()
    (there / "meta.json").write_text(json.dumps(META))
    for k, suffix in enumerate((".jpg", ".png", ".pgm")):
        cv2.imwrite(str(there / "frames" / f"{k}{suffix}"), PIXELS)
    (there / "frames.csv").write_text(
        "index,t_s,file\n0,0.0,frames/0.jpg\n1,0.1,frames/1.png\n2,0.2000000004,frames/2.pgm\n"
    )
    (there / "encoders.csv").write_text(
        "t_s,left_ticks,right_ticks\n" + "".join(f"{k / 20},{3 * k},{-2 * k}\n" for k in range(6))
    )
    (there / "scans.csv").write_text(
        "t_s,r0,r1,r2,r3,r4\n" + "".join(f"{k / 10},1.5,-1,9.5,0.25,8\n" for k in range(3))
    )
    (there / "truth" / "extrinsics.json").write_text('{"phi_rad": 1}')
    return there


def imported(folder: Path) -> Recording:
    import_frames(folder, folder.parent / "out.mcap")
    return Recording(folder.parent / "out.mcap")


def messages(recording: Recording) -> list[Message]:
    return [message for _, message in recording.messages()]


def test_everything_in_the_folder_is_in_the_recording(folder: Path) -> None:
    recording = imported(folder)
    all_of_them = messages(recording)
    assert not recording.refused
    assert [message.stamp_ns for message in all_of_them] == sorted(message.stamp_ns for message in all_of_them)
    assert [type(message) for message in all_of_them[:4]] == [Ticks, Scan, Frame, Ticks]
    ticks = [message for message in all_of_them if isinstance(message, Ticks)]
    assert [(t.stamp_ns, t.left, t.right) for t in ticks] == [(k * 50_000_000, 3 * k, -2 * k) for k in range(6)]
    frames = [message for message in all_of_them if isinstance(message, Frame)]
    assert [frame.format for frame in frames] == [PixelFormat.JPEG, PixelFormat.PNG, PixelFormat.GREY8]
    assert [frame.stamp_ns for frame in frames] == [0, 100_000_000, 200_000_000]  # to the nearest nanosecond
    assert frames[0].data.tobytes() == (folder / "frames" / "0.jpg").read_bytes()
    assert np.array_equal(frames[2].data.reshape(48, 64), PIXELS)
    scans = [message for message in all_of_them if isinstance(message, Scan)]
    assert len(scans) == 3
    assert scans[0].range_m.tolist() == [1.5, 0.0, 0.0, 0.25, 8.0]  # no echo: the invalid mark, or beyond the range
    assert (scans[0].angle_min_rad, scans[0].angle_increment_rad) == (-1.0, 0.5)


def test_the_rig_comes_from_meta_and_the_names_from_the_configuration(folder: Path) -> None:
    config = imported(folder).config(Config())
    assert (config.robot.id, config.robot.wheel_base_m) == ("demo", 0.3)
    assert (config.encoder.wheel_diameter_m, config.encoder.ticks_per_rev) == (0.1, 512)
    assert (config.camera.width_px, config.camera.height_px, config.camera.bearing_sign) == (64, 48, -1)
    assert (config.ring.center_px, config.ring.r_min_px, config.ring.r_max_px) == ((32.0, 24.0), 5.0, 23.0)


def test_truth_and_meta_are_attached_as_they_are(folder: Path) -> None:
    recording = imported(folder)
    assert recording.attachments == ("meta.json", "truth/extrinsics.json")
    assert recording.attachment("truth/extrinsics.json") == b'{"phi_rad": 1}'


def test_importing_twice_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    import_frames(folder, tmp_path / "one.mcap")
    import_frames(folder, tmp_path / "two.mcap")
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_scans_and_truth_may_be_missing(folder: Path) -> None:
    (folder / "scans.csv").unlink()
    (folder / "truth" / "extrinsics.json").unlink()
    (folder / "truth").rmdir()
    assert {type(message) for message in messages(imported(folder))} == {Ticks, Frame}


def test_times_may_begin_before_zero(folder: Path) -> None:
    (folder / "encoders.csv").write_text("t_s,left_ticks,right_ticks\n-0.5,0,0\n0,0,0\n0.3,1,1\n")
    given = FramesFolder(folder, Config())
    assert given.shift_ns == 500_000_000
    ticks = [message.stamp_ns for message in given.messages() if isinstance(message, Ticks)]
    assert ticks == [0, 500_000_000, 800_000_000]


def test_times_may_count_from_1970_to_the_nanosecond(folder: Path) -> None:
    (folder / "scans.csv").unlink()
    (folder / "frames.csv").write_text("t_s,file,index\n1700000000.123456789,frames/0.jpg,0\n")
    (folder / "encoders.csv").write_text("t_s,left_ticks,right_ticks\n1700000000,0,0\n1700000001,1,1\n")
    given = FramesFolder(folder, Config())
    assert given.shift_ns == 0
    stamps = [message.stamp_ns for message in given.messages()]
    assert stamps == [1700000000_000000000, 1700000000_123456789, 1700000001_000000000]


@pytest.mark.parametrize("name", ["meta.json", "frames.csv", "encoders.csv", "scans.csv"])
def test_a_byte_order_mark_at_the_beginning_is_no_part_of_it(folder: Path, name: str) -> None:
    (folder / name).write_bytes(b"\xef\xbb\xbf" + (folder / name).read_bytes())
    assert FramesFolder(folder, Config()).counts == {"Frame": 3, "Ticks": 6, "Scan": 3}


def test_progress_is_told(folder: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    import_frames(folder, tmp_path / "out.mcap", progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (12, 12)


# ---------------------------------------------------------------- refusals

Damage = Callable[[Path], object]


def replaced(name: str, before: str, after: str) -> Damage:
    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        assert before in text
        (folder / name).write_text(text.replace(before, after, 1))

    return damage


def meta(**changes: Any) -> Damage:
    return lambda folder: (folder / "meta.json").write_text(json.dumps({**META, **changes}))


def removed(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


def written(name: str, text: str | bytes) -> Damage:
    return lambda folder: (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())


def without(key: str) -> Damage:
    return lambda folder: (folder / "meta.json").write_text(json.dumps({k: v for k, v in META.items() if k != key}))


def torn(folder: Path) -> None:
    whole = (folder / "frames" / "0.jpg").read_bytes()
    (folder / "frames" / "0.jpg").write_bytes(whole[: len(whole) // 2])


def resized(folder: Path) -> None:
    cv2.imwrite(str(folder / "frames" / "1.png"), PIXELS[:20])


def linked_out(folder: Path) -> None:
    (folder / "frames" / "1.png").rename(folder.parent / "secret.png")
    (folder / "frames" / "1.png").symlink_to(folder.parent / "secret.png")


def pipe_at(name: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return damage


def later(name: str, by_s: float) -> Damage:
    """All times of a table moved."""

    def damage(folder: Path) -> None:
        header, *lines = (folder / name).read_text().splitlines()
        column = header.split(",").index("t_s")
        moved = [line.split(",") for line in lines]
        for fields in moved:
            fields[column] = f"{float(fields[column]) + by_s}"
        (folder / name).write_text("\n".join([header, *(",".join(fields) for fields in moved)]))

    return damage


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (removed("meta.json"), ("meta.json", "no such file")),
        (removed("frames.csv"), ("frames.csv", "no such file")),
        (removed("encoders.csv"), ("encoders.csv", "no such file")),
        (removed("frames/1.png"), ("frames.csv, row 3", "frames/1.png", "No such file")),
        (written("meta.json", "{"), ("meta.json", "not JSON")),
        (written("meta.json", "[" * 100_000), ("meta.json", "not JSON")),
        (written("meta.json", "[]"), ("meta.json", "not a JSON object")),
        (written("meta.json", b"\xff\xfe"), ("meta.json", "not JSON")),
        (without("robot"), ("meta.json", "robot.wheel_base_m is missing")),
        (without("bearing_sign"), ("meta.json", "bearing_sign is missing")),
        (without("laser"), ("meta.json", "laser.angle_min is missing")),
        (meta(frame_rate_hz=float("nan")), ("meta.json", "frame_rate_hz", "no finite number")),
        (meta(frame_rate_hz=10**400), ("meta.json", "frame_rate_hz", "no finite number")),
        (meta(bearing_sign=0), ("meta.json", "bearing_sign")),
        (meta(ring={"center_px": [1], "r_min_px": 5.0, "r_max_px": 23.0}), ("meta.json", "ring.center_px")),
        (meta(ring={"center_px": [9, 9], "r_min_px": 22.0, "r_max_px": 23.0}), ("meta.json", "ring")),
        (meta(robot={**META["robot"], "wheel_base_m": 300}), ("meta.json", "wheel_base_m = 300")),
        (written("frames.csv", ""), ("frames.csv", "empty")),
        (written("frames.csv", "index,t_s,file\n"), ("frames.csv", "no rows")),
        (written("encoders.csv", "t_s,left_ticks,right_ticks\n\n"), ("encoders.csv", "no rows")),
        (written("encoders.csv", b"\xff\xfe\x00"), ("encoders.csv", "UTF-8")),
        (written("encoders.csv", 't_s,left_ticks,right_ticks\n"0,1'), ("encoders.csv", "CSV")),
        (replaced("frames.csv", "index,t_s,file", "index,time,file"), ("frames.csv", "no column 't_s'")),
        (replaced("encoders.csv", "left_ticks", "left"), ("encoders.csv", "no column 'left_ticks'")),
        (replaced("scans.csv", "t_s,", "time,"), ("scans.csv", "'time' instead of 't_s'")),
        (replaced("frames.csv", "0.1,", "nan,"), ("frames.csv, row 3", "'nan' is no time")),
        (replaced("frames.csv", "0.1,", "soon,"), ("frames.csv, row 3", "'soon' is no number")),
        (replaced("frames.csv", "0.1,", "1e999999,"), ("frames.csv, row 3", "no time")),
        (replaced("frames.csv", "0.1,", "9.0,"), ("frames.csv, row 4", "runs backwards")),
        (replaced("frames.csv", "1,0.1", "one,0.1"), ("frames.csv, row 3", "index")),
        (replaced("frames.csv", "frames/1.png", "../out.png"), ("frames.csv, row 3", "leaves the folder")),
        (replaced("frames.csv", "frames/1.png", "/etc/passwd"), ("frames.csv, row 3", "leaves the folder")),
        (replaced("frames.csv", "frames/1.png", ""), ("frames.csv, row 3", "file is empty")),
        (replaced("frames.csv", "frames/1.png", "frames/1.png,7"), ("frames.csv, row 3", "4 fields")),
        (replaced("frames.csv", "frames/1.png", "frames"), ("frames.csv, row 3", "directory")),
        (replaced("encoders.csv", "0.1,6", "0.01,6"), ("encoders.csv, row 4", "runs backwards")),
        (replaced("encoders.csv", "0.1,6", "0.1,NaN"), ("encoders.csv, row 4", "left_ticks")),
        (replaced("encoders.csv", "0.1,6", "0.1,6.5"), ("encoders.csv, row 4", "no whole number")),
        (replaced("encoders.csv", "0.1,6", "0.1,1e300"), ("encoders.csv, row 4", "no whole number")),
        (replaced("scans.csv", "0.1,1.5", "0.1,nan"), ("scans.csv, row 3", "NaN")),
        (replaced("scans.csv", "0.1,1.5", "0.1,-2"), ("scans.csv, row 3", "negative")),
        (replaced("scans.csv", "0.1,1.5", "0.1,x"), ("scans.csv, row 3", "'x'")),
        (meta(laser={**META["laser"], "n": 6}), ("scans.csv, row 2", "5 ranges, meta.json says 6")),
        (meta(laser={**META["laser"], "angle_min": -180}), ("meta.json", "radians")),
        (torn, ("frames.csv, row 2", "frames/0.jpg", "JPEG ends")),
        (written("frames/2.pgm", b"P5"), ("frames.csv, row 4", "frames/2.pgm")),
        (written("frames/2.pgm", b""), ("frames.csv, row 4", "empty")),
        (resized, ("frames.csv, row 3", "64 x 20", "64 x 48")),
        (pipe_at("frames/1.png"), ("frames.csv, row 3", "frames/1.png", "no regular file")),
        (pipe_at("meta.json"), ("meta.json", "no regular file")),
        (pipe_at("encoders.csv"), ("encoders.csv", "no regular file")),
        (later("encoders.csv", 1000.0), ("encoders.csv, row 2", "999.8 s after", "frames.csv, row 4", "one clock")),
        (later("encoders.csv", -1000.0), ("encoders.csv, row 7", "999.75 s before", "frames.csv, row 2")),
        (later("scans.csv", 10000.0), ("scans.csv, row 2", "after the last frame")),
        (replaced("frames.csv", "2,0.2000000004", "2,1e9"), ("frames.csv, row 4", "jumps by 1e+09 s")),
        (replaced("encoders.csv", "0.25,", "3600.3,"), ("encoders.csv, row 7", "jumps by 3600.1 s")),
        (replaced("encoders.csv", "right_ticks", "left_ticks"), ("encoders.csv, row 1", "'left_ticks' twice")),
        (replaced("scans.csv", "r3", "t_s"), ("scans.csv, row 1", "'t_s' twice")),
        (linked_out, ("frames.csv, row 3", "leaves the folder")),
    ],
)
def test_a_fault_is_one_line_that_names_file_and_row_and_leaves_nothing_behind(
    folder: Path, damage: Damage, says: tuple[str, ...]
) -> None:
    damage(folder)
    before = sorted(folder.parent.iterdir())
    with pytest.raises(DataError) as refusal:
        import_frames(folder, folder.parent / "out.mcap")
    assert refusal.value.code.startswith("OV3")
    assert refusal.value.exit_code == 1
    line = str(refusal.value)
    assert "\n" not in line
    assert all(word in line for word in says), line
    assert sorted(folder.parent.iterdir()) == before


def test_an_empty_folder_and_no_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"meta\.json"):
        import_frames(tmp_path / "empty", tmp_path / "out.mcap")
    with pytest.raises(DataError, match="is no folder"):
        import_frames(tmp_path / "missing", tmp_path / "out.mcap")


def test_a_failed_import_leaves_the_recording_that_was_there(folder: Path, tmp_path: Path) -> None:
    import_frames(folder, tmp_path / "out.mcap")
    before = (tmp_path / "out.mcap").read_bytes()
    torn(folder)
    with pytest.raises(DataError):
        import_frames(folder, tmp_path / "out.mcap")
    assert (tmp_path / "out.mcap").read_bytes() == before


def test_a_place_that_cannot_be_written_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot write"):
        import_frames(folder, tmp_path / "nowhere" / "out.mcap")


def test_a_place_below_a_file_is_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(DataError, match="cannot write"):
        import_frames(folder, tmp_path / "file" / "out.mcap")


def test_what_a_killed_import_has_left_is_cleared_away_by_the_next(folder: Path, tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    stale, other = tmp_path / f".out.mcap.{ended.pid}.part", tmp_path / f".other.mcap.{ended.pid}.part"
    working = tmp_path / f".out.mcap.{os.getppid()}.part"
    for part in (stale, other, working):
        part.write_bytes(b"half")
    import_frames(folder, tmp_path / "out.mcap")
    assert [part.exists() for part in (stale, other, working)] == [False, True, True]


def test_sigterm_leaves_nothing_behind(folder: Path, tmp_path: Path) -> None:
    here = tmp_path / "out"
    here.mkdir()
    command = "import os, signal, sys\nfrom omnivert.formats import folder\nread = folder.frame_from_file\n"
    command += "def terminated(*rest):\n    os.kill(os.getpid(), signal.SIGTERM)\n    return read(*rest)\n"
    command += "folder.frame_from_file = terminated\nfrom omnivert.cli import main\nmain()"
    arguments = ["import", "frames", str(folder), "-o", str(here / "out.mcap")]
    done = subprocess.run([sys.executable, "-c", command, *arguments], capture_output=True, timeout=60, check=False)
    assert done.returncode == 128 + signal.SIGTERM
    assert (done.stdout, b"Traceback" in done.stderr) == (b"", False)
    assert list(here.iterdir()) == []


@given(data=st.binary(max_size=300))
def test_any_bytes_as_a_table_give_rows_or_a_refusal(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(b"t_s,left_ticks\n" + data)
    said = ""
    try:
        for row in rows(path, ("t_s", "left_ticks")):
            row.stamp_ns("t_s")
            row.integer("left_ticks")
    except DataError as error:
        said = str(error)
    assert not said or "any.csv" in said


# ---------------------------------------------------------------- the corridor


def test_the_packaged_recording_is_the_corridor(shared_data: Path) -> None:
    packaged = Path(__file__).resolve().parents[2] / "omnivert" / "data" / "corridor.mcap"
    assert packaged.stat().st_size < 10_000_000
    recording = Recording(packaged)
    given = FramesFolder(shared_data / "corridor", Config())
    assert recording.config(Config()) == given.config
    for (_, packed), fresh in zip(recording.messages(), given.messages(), strict=True):
        assert type(packed) is type(fresh)
        assert packed.stamp_ns == fresh.stamp_ns
        if isinstance(packed, Frame) and isinstance(fresh, Frame):
            assert np.array_equal(packed.data, fresh.data)
    for name, data in given.attachments():
        assert recording.attachment(name) == data
    with (shared_data / "corridor" / "frames.csv").open() as table:
        assert len(list(csv.reader(table))) - 1 == given.counts["Frame"] == 158
