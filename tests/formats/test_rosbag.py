"""Bags of ROS 1 and ROS 2: the same drive comes out of each as out of a folder, and what was guessed is said."""

import json
import sqlite3
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from omnivert.cli.settings import recording_path
from omnivert.config import Config, with_rig
from omnivert.formats.frames_import import import_frames
from omnivert.formats.origin import ATTACHMENT, origin_ns
from omnivert.formats.rosbag.drive import RosBag
from omnivert.formats.rosbag.import_ import import_rosbag
from omnivert.formats.rosbag.topics import Named
from omnivert.messages import Frame, Message, Scan, Ticks
from omnivert.wire.codec import encode
from omnivert.wire.recording import Recording
from tests.formats.bags import FORMS, ORIGIN_NS, RIG, SUFFIX, SWEEP, BagMaker, small_drive

DRIVE = small_drive()


@pytest.fixture(scope="module", params=FORMS)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small drive as each kind of bag, its pictures recorded 80 ms late."""
    return written(tmp_path_factory.mktemp("bag") / "drive", str(request.param), DRIVE)


def written(path: Path, form: str, drive: Sequence[Message]) -> Path:
    with BagMaker(path.with_suffix(SUFFIX[form]), form) as maker:
        maker.drive(drive, late_ns=80_000_000)
    return maker.path


def as_folder(there: Path, drive: Sequence[Message]) -> None:
    """The drive as the logger of a folder would have written it."""
    (there / "frames").mkdir(parents=True)
    encoder, ring = RIG.encoder, RIG.ring
    meta = {
        "image": {"width": 64, "height": 48},
        "ring": {"center_px": list(ring.center_px), "r_min_px": ring.r_min_px, "r_max_px": ring.r_max_px},
        "bearing_sign": 1,
        "robot": {
            "wheel_base_m": RIG.robot.wheel_base_m,
            "wheel_diameter_m": encoder.wheel_diameter_m,
            "ticks_per_rev": encoder.ticks_per_rev,
        },
        "frame_rate_hz": 10.0,
        "laser": {"angle_min": SWEEP[0], "angle_increment": SWEEP[1], "n": 90, "range_max": 30.0, "invalid": 0.0},
    }
    (there / "meta.json").write_text(json.dumps(meta))
    tables = {"frames": ["index,t_s,file"], "encoders": ["t_s,left_ticks,right_ticks"], "scans": [f"t_s{',r' * 90}"]}
    for number, message in enumerate(drive):
        at = f"{message.stamp_ns / 10**9:.9f}"
        match message:
            case Frame():
                (there / "frames" / f"{number}.png").write_bytes(message.data.tobytes())
                tables["frames"].append(f"{number},{at},frames/{number}.png")
            case Ticks():
                tables["encoders"].append(f"{at},{message.left},{message.right}")
            case Scan():
                tables["scans"].append(",".join([at, *(repr(float(r)) for r in message.range_m)]))
    tables["scans"][0] = "t_s," + ",".join(f"r{k}" for k in range(90))
    for name, lines in tables.items():
        (there / f"{name}.csv").write_text("\n".join(lines))


def bytes_of(path: Path) -> list[tuple[str, bytes]]:
    return [(key, encode(message)) for key, message in Recording(path).messages()]


def test_a_bag_and_a_folder_of_one_drive_give_the_same_messages_and_the_same_rig(bag: Path, tmp_path: Path) -> None:
    as_folder(tmp_path / "folder", DRIVE)
    import_frames(tmp_path / "folder", tmp_path / "folder.mcap", RIG)
    import_rosbag(bag, tmp_path / "bag.mcap", RIG)
    assert bytes_of(tmp_path / "bag.mcap") == bytes_of(tmp_path / "folder.mcap")
    assert Recording(tmp_path / "bag.mcap").rig == Recording(tmp_path / "folder.mcap").rig


def test_stamps_are_those_of_the_headers_from_an_origin_that_is_told(bag: Path, tmp_path: Path) -> None:
    given = import_rosbag(bag, tmp_path / "out.mcap", RIG)
    assert given.shift_ns == -ORIGIN_NS
    assert any("stamps count from 1700000000 s" in note and "2023-11-14 22:13:20 UTC" in note for note in given.notes)
    recording = Recording(tmp_path / "out.mcap")
    told = json.loads(recording.attachment(ATTACHMENT))
    assert (told["clock_origin_ns"], told["bag"]) == (ORIGIN_NS, bag.name)
    stamps = [message.stamp_ns for _, message in recording.messages()]
    assert stamps == sorted(message.stamp_ns for message in DRIVE)


def test_the_time_of_recording_is_taken_when_it_is_asked_for(bag: Path, tmp_path: Path) -> None:
    given = import_rosbag(bag, tmp_path / "out.mcap", RIG, bag_times=True)
    (first, *_) = [message for _, message in Recording(tmp_path / "out.mcap").messages() if isinstance(message, Frame)]
    assert first.stamp_ns == 31_234_567 + 80_000_000
    assert any("time of recording" in note for note in given.notes)


def test_what_was_taken_is_said(bag: Path) -> None:
    notes = " ".join(RosBag(bag, RIG, Named(), False, None).notes)
    assert "images are taken from /camera/image_raw (sensor_msgs/CompressedImage, 20 messages)" in notes
    assert "the wheels are taken from /wheels (robot_msgs/WheelTicks, 101 messages)" in notes
    assert "laser scans are taken from /scan (sensor_msgs/LaserScan, 8 messages)" in notes


def test_progress_tells_every_message_and_ends_at_its_end(bag: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    import_rosbag(bag, tmp_path / "out.mcap", RIG, progress=lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == list(range(1, 101 + 129 + 1))  # the wheels are read first
    assert told[-1] == (230, 230)


def test_importing_twice_gives_the_same_bytes(bag: Path, tmp_path: Path) -> None:
    for name in ("one.mcap", "two.mcap"):
        import_rosbag(bag, tmp_path / name, RIG)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_of_the_packaged_corridor_every_message_comes_back(tmp_path: Path) -> None:
    corridor = Recording(recording_path("corridor"))
    drive = [message for _, message in corridor.messages(types=(Frame, Ticks, Scan), to_s=6.0)]
    bag = written(tmp_path / "corridor", "mcap", drive)
    import_rosbag(bag, tmp_path / "out.mcap", corridor.config(Config()))
    back = [message for _, message in Recording(tmp_path / "out.mcap").messages()]
    assert sum(isinstance(message, Frame) for message in back) > 15
    for kind in (Frame, Ticks):
        assert [encode(m) for m in back if isinstance(m, kind)] == [encode(m) for m in drive if isinstance(m, kind)]
    scans = zip(*([m for m in messages if isinstance(m, Scan)] for messages in (back, drive)), strict=True)
    assert all(np.array_equal(ours.range_m, theirs.range_m) for ours, theirs in scans)  # angles have 32 bits in ROS
    assert Recording(tmp_path / "out.mcap").config(Config()) == corridor.config(Config())


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"{}", b'{"clock_origin_ns": "soon"}', b'{"clock_origin_ns": 1.5}'])
def test_an_attachment_of_somebody_else_tells_no_origin(text: bytes) -> None:
    assert origin_ns(text) == 0


# ---------------------------------------------------------------- forms of a bag


def parts(folder: Path, form: str) -> Path:
    """The drive in two bags, the second part first by name."""
    half = len(DRIVE) // 2
    for name, drive in (("b", DRIVE[:half]), ("a", DRIVE[half:])):
        written(folder / name, form, drive)
    return folder


def test_a_folder_of_the_parts_of_a_long_bag_is_one_drive(tmp_path: Path) -> None:
    import_rosbag(parts(tmp_path, "ros1"), tmp_path / "out.mcap", RIG)
    assert [data for _, data in bytes_of(tmp_path / "out.mcap")] == list(map(encode, DRIVE))


@pytest.mark.parametrize("form", ["sqlite3", "mcap"])
def test_a_bag_without_its_metadata_is_read_as_a_folder_and_as_a_file(tmp_path: Path, form: str) -> None:
    bag = written(tmp_path / "drive", form, DRIVE)
    (bag / "metadata.yaml").unlink()
    for number, source in enumerate((bag, *bag.iterdir())):
        import_rosbag(source, tmp_path / f"{number}.mcap", RIG)
        assert [data for _, data in bytes_of(tmp_path / f"{number}.mcap")] == list(map(encode, DRIVE))


def test_a_bag_from_before_definitions_were_stored_is_read_by_the_common_types(tmp_path: Path) -> None:
    with BagMaker(tmp_path / "old", "sqlite3") as maker:
        for message in DRIVE:
            at = message.stamp_ns + ORIGIN_NS
            match message:
                case Frame():
                    maker.image("/image", message, at, at)
                case Ticks():
                    maker.number("/left_ticks", at, message.left)
                    maker.number("/right_ticks", at, message.right)
                    maker.counts("/own", message, at)
    with sqlite3.connect(maker.path / "old.db3") as base:
        base.executescript("DROP TABLE schema; DROP TABLE message_definitions")
    given = import_rosbag(maker.path, tmp_path / "out.mcap", RIG)  # /own is not understood any more, and not missed
    back = [message for _, message in Recording(tmp_path / "out.mcap").messages()]
    assert list(map(encode, back)) == [encode(m) for m in DRIVE if not isinstance(m, Scan)]
    assert any("carry no stamp" in note for note in given.notes)


def test_messages_that_are_still_in_a_log_beside_the_bag_are_told(tmp_path: Path) -> None:
    bag = written(tmp_path / "drive", "sqlite3", DRIVE)
    (bag / "drive.db3-wal").write_bytes(bytes(100))
    notes = RosBag(bag, RIG, Named(), False, None).notes
    assert any("drive.db3-wal holds messages" in note for note in notes)


# ---------------------------------------------------------------- the rig


def test_the_rig_is_the_configurations_with_size_and_rate_of_the_pictures(tmp_path: Path) -> None:
    base = with_rig(RIG, {"camera": {"width_px": 320, "height_px": 240, "frame_rate_hz": 7.0}}, "test")
    given = RosBag(written(tmp_path / "drive", "mcap", DRIVE), base, Named(), False, None)
    camera = given.config.camera
    assert (camera.width_px, camera.height_px, camera.frame_rate_hz) == (64, 48, 10.0)
    assert (given.config.robot, given.config.encoder, given.config.ring) == (base.robot, base.encoder, base.ring)
    assert any("64 x 48 pixels, the configuration says 320 x 240" in note for note in given.notes)


def test_scans_keep_every_echo_in_range_and_nothing_else(tmp_path: Path) -> None:
    range_m = np.array([0.01, 0.05, 3.0, 30.0, 31.0, np.nan, np.inf, -1.0], dtype=np.float32)
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        maker.drive(message for message in DRIVE if not isinstance(message, Scan))
        maker.scan("/scan", Scan(ORIGIN_NS + 5, *SWEEP, range_m))
    (scan,) = [m for m in RosBag(maker.path, RIG, Named(), False, None).messages() if isinstance(m, Scan)]
    assert scan.range_m.tolist() == [0.0, np.float32(0.05), 3.0, 30.0, 0.0, 0.0, 0.0, 0.0]
    assert (scan.angle_min_rad, scan.angle_increment_rad) == SWEEP


def test_of_several_lasers_none_is_taken_unless_it_is_named(tmp_path: Path) -> None:
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        maker.drive(DRIVE)
        maker.scan("/rear", Scan(ORIGIN_NS + 5, *SWEEP, np.ones(3, np.float32)))
    given = RosBag(maker.path, RIG, Named(), False, None)
    assert "Scan" not in given.counts
    assert any("--scan-topic /rear takes them" in note for note in given.notes)
    assert RosBag(maker.path, RIG, Named(scan_topic="/rear"), False, None).counts["Scan"] == 1


def test_memory_does_not_grow_with_the_pictures(tmp_path: Path) -> None:
    """Pictures are in memory one by one: of 30 MB never more than a few."""
    import tracemalloc

    with BagMaker(tmp_path / "drive", "sqlite3") as maker:
        grey = np.random.default_rng(1).integers(0, 256, 1_000_000, dtype=np.uint8)
        for k in range(30):
            at = ORIGIN_NS + k * 100_000_000
            maker.pixels("/image", at, at, 1000, 1000, "mono8", 1000, grey)
            maker.counts("/wheels", Ticks(at, k, k), at)
    tracemalloc.start()
    try:
        given = import_rosbag(maker.path, tmp_path / "out.mcap", with_rig(RIG, {"ring": {"r_max_px": 400.0}}, "test"))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert given.counts["Frame"] == 30
    assert peak < 22e6
