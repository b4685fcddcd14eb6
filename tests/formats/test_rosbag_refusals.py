"""A bag that cannot be used is refused in one line that says what to do, and nothing half-written is left."""

import sqlite3
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnivert.config import with_rig
from omnivert.errors import DataError, UseError
from omnivert.formats.rosbag.file import Bag
from omnivert.formats.rosbag.import_ import import_rosbag
from omnivert.formats.rosbag.topics import Named
from omnivert.messages import Frame, PixelFormat, Ticks
from tests.formats.bags import FORMS, ORIGIN_NS, RIG, SUFFIX, BagMaker, small_drive

DRIVE = small_drive()
FRAMES = [message for message in DRIVE if isinstance(message, Frame)]
TICKS = [message for message in DRIVE if isinstance(message, Ticks)]
Fault = Callable[[BagMaker], None]


def refused(path: Path, named: Named | None = None, bag_times: bool = False, code: str = "") -> DataError | UseError:
    """What the import says; the folder is as it was."""
    before = sorted(path.parent.iterdir())
    with pytest.raises((DataError, UseError)) as refusal:
        import_rosbag(path, path.parent / "out.mcap", RIG, named, bag_times)
    assert sorted(path.parent.iterdir()) == before
    assert "\n" not in str(refusal.value)
    assert not code or refusal.value.code == code
    assert isinstance(refusal.value, DataError | UseError)
    return refusal.value


def pictures(maker: BagMaker, shift_ns: int = 0) -> None:
    for message in FRAMES:
        maker.image("/image", message, stamp_ns=message.stamp_ns + ORIGIN_NS + shift_ns)


def wheels(maker: BagMaker, shift_ns: int = 0) -> None:
    for message in TICKS:
        maker.counts("/wheels", message, message.stamp_ns + ORIGIN_NS + shift_ns)


def odometries(maker: BagMaker) -> None:
    pictures(maker)
    for topic in ("/odom", "/odometry/filtered"):
        maker.odometry(topic, ORIGIN_NS + 7, (0.0, 0.0, 0.0))


def two_cameras(maker: BagMaker) -> None:
    wheels(maker)
    maker.image("/left/image", FRAMES[0], ORIGIN_NS)
    maker.pixels("/right/image", ORIGIN_NS, ORIGIN_NS, 64, 48, "mono8", 64, np.zeros(64 * 48, np.uint8))


def no_pictures(maker: BagMaker) -> None:
    wheels(maker)


def no_wheels(maker: BagMaker) -> None:
    pictures(maker)
    maker.number("/battery", ORIGIN_NS, 12)


def unstamped_pictures(maker: BagMaker) -> None:
    wheels(maker)
    for message in FRAMES:
        maker.image("/image", message, bag_ns=message.stamp_ns + ORIGIN_NS, stamp_ns=0)


def unstamped_wheels(maker: BagMaker) -> None:
    pictures(maker)
    for message in TICKS:
        maker.counts("/wheels", message, 0, message.stamp_ns + ORIGIN_NS)


def pictures_backwards(maker: BagMaker) -> None:
    wheels(maker)
    for number, message in enumerate(FRAMES):
        back_ns = 300_000_000 if number == 7 else 0
        maker.image("/image", message, message.stamp_ns + ORIGIN_NS, message.stamp_ns + ORIGIN_NS - back_ns)


def wheels_backwards(maker: BagMaker) -> None:
    pictures(maker)
    for number, message in enumerate(TICKS):
        at = message.stamp_ns + ORIGIN_NS
        maker.counts("/wheels", message, at - (500_000_000 if number == 50 else 0), at)


def long_pause(maker: BagMaker) -> None:
    pictures(maker)
    wheels(maker)
    wheels(maker, 5000 * 10**9)


def other_clock(maker: BagMaker) -> None:
    pictures(maker)
    wheels(maker, -ORIGIN_NS + 10**9)


def other_drive(maker: BagMaker) -> None:
    pictures(maker)
    wheels(maker, 100 * 10**9)


def another_size(maker: BagMaker) -> None:
    wheels(maker)
    pictures(maker)
    data = cv2.imencode(".png", np.zeros((24, 32), np.uint8))[1].reshape(-1)
    maker.image("/image", Frame(0, PixelFormat.PNG, 32, 24, data), stamp_ns=ORIGIN_NS + 5 * 10**9)


def distances(maker: BagMaker) -> None:
    wheels(maker)
    at = ORIGIN_NS
    maker.pixels("/depth", at, at, 64, 48, "32FC1", 256, np.zeros(256 * 48, np.uint8))


def no_numbers(maker: BagMaker) -> None:
    pictures(maker)
    maker.odometry("/odom", ORIGIN_NS, (float("nan"), 0.0, 0.0))


def no_headings(maker: BagMaker) -> None:
    pictures(maker)
    for message in TICKS:
        at = message.stamp_ns
        maker.odometry("/odom", at + ORIGIN_NS, (at * 1e-9, 0.0, 0.0), length=0.0)


def far_away(maker: BagMaker) -> None:
    pictures(maker)
    for number, message in enumerate(TICKS):
        maker.odometry("/odom", message.stamp_ns + ORIGIN_NS, (1e306 * number, 0.0, 0.0))


def only_speeds(maker: BagMaker) -> None:
    pictures(maker)
    nothing = np.zeros(0)
    said = {"name": ["wheel_left", "wheel_right"], "position": nothing, "velocity": np.ones(2), "effort": nothing}
    maker.write("/joints", ORIGIN_NS, "sensor_msgs/JointState", header=maker.header(ORIGIN_NS), **said)


def broken_message(maker: BagMaker) -> None:
    wheels(maker)
    data = maker.serialized(
        "sensor_msgs/CompressedImage", header=maker.header(ORIGIN_NS), format="png", data=FRAMES[0].data
    )
    maker.write_bytes("/image", ORIGIN_NS, "sensor_msgs/CompressedImage", data[:40])


def nothing_at_all(maker: BagMaker) -> None:
    pass


def topics_without_messages(maker: BagMaker) -> None:
    maker.connect("/image", "sensor_msgs/Image")
    maker.connect("/odom", "nav_msgs/Odometry")


FAULTS: list[tuple[Fault, str, tuple[str, ...], str]] = [
    (odometries, "OV332", ("2 odometry topics", "/odom (", "/odometry/filtered ("), "--odom-topic /odom"),
    (two_cameras, "OV332", ("2 image topics", "/left/image (", "/right/image ("), "--image-topic /left/image"),
    (no_pictures, "OV332", ("holds no image topic", "/wheels (robot_msgs/WheelTicks"), "omnivert explain OV332"),
    (no_wheels, "OV332", ("nothing of its wheels", "/battery (std_msgs/Int32"), "--ticks-topic NAME"),
    (unstamped_pictures, "OV333", ("/image, message 1", "stamp is zero"), "--bag-times"),
    (unstamped_wheels, "OV333", ("/wheels, message 1", "stamp is zero"), "--bag-times"),
    (pictures_backwards, "OV333", ("/image, message 8", "runs backwards, by 0.2 s"), "--bag-times"),
    (wheels_backwards, "OV333", ("/wheels, message 51", "runs backwards, by 0.48 s"), "--bag-times"),
    (long_pause, "OV333", ("/wheels, message 102", "jumps by 4998 s"), "--bag-times"),
    (other_clock, "OV333", ("/wheels, message 101", "before the first image", "not of one clock"), "--bag-times"),
    (other_drive, "OV333", ("/wheels, message 1:", "after the last image", "not of one drive"), "--bag-times"),
    (another_size, "OV333", ("/image, message 21", "32 x 24 pixels, the first one 64 x 48"), "omnivert explain OV333"),
    (distances, "OV333", ("/depth, message 1", "'32FC1'", "mono, bgr, rgb"), "omnivert explain OV333"),
    (no_numbers, "OV333", ("/odom, message 1", "the pose = nan"), "omnivert explain OV333"),
    (no_headings, "OV333", ("/odom, message 1", "orientation is zero"), "omnivert explain OV333"),
    (far_away, "OV333", ("/odom, message", "which no wheel does"), "omnivert explain OV333"),
    (only_speeds, "OV333", ("/joints, message 1", "wheel_left has no position"), "--odom-topic NAME"),
    (broken_message, "OV331", ("/image, message 1", "no sensor_msgs/CompressedImage"), "omnivert explain OV331"),
    (nothing_at_all, "OV332", ("holds no image topic", "it is empty"), "omnivert explain OV332"),
    (topics_without_messages, "OV332", ("holds no image topic", "0 messages"), "omnivert explain OV332"),
]


@pytest.mark.parametrize("form", ["ros1", "mcap"])
@pytest.mark.parametrize(("fault", "code", "says", "help"), FAULTS, ids=[fault[0].__name__ for fault in FAULTS])
def test_a_fault_is_one_line_with_its_place_and_the_way_out(
    tmp_path: Path, form: str, fault: Fault, code: str, says: tuple[str, ...], help: str
) -> None:
    with BagMaker(tmp_path / f"drive{SUFFIX[form]}", form) as maker:
        fault(maker)
    refusal = refused(maker.path, code=code)
    assert refusal.exit_code == 1
    assert all(word in str(refusal) for word in says), str(refusal)
    assert help in refusal.help


@pytest.mark.parametrize("fault", [unstamped_pictures, unstamped_wheels, pictures_backwards])
def test_the_time_of_recording_helps_where_only_stamps_are_wrong(tmp_path: Path, fault: Fault) -> None:
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        fault(maker)
    given = import_rosbag(maker.path, tmp_path / "out.mcap", RIG, bag_times=True)
    assert given.counts == {"Frame": 20, "Ticks": 101}


@pytest.mark.parametrize(
    ("named", "code", "says"),
    [
        (Named(image_topic="/nope"), "OV332", "there is no such topic"),
        (Named(image_topic="/wheels"), "OV332", "robot_msgs/WheelTicks, not sensor_msgs/Image"),
        (Named(odom_topic="/image"), "OV332", "not nav_msgs/Odometry"),
        (Named(left_topic="/wheels"), "OV205", "--right-topic is missing"),
        (Named(left_topic="/wheels", right_topic="/image"), "OV332", "no std_msgs/Int32"),
        (Named(ticks_topic="/wheels", odom_topic="/odom"), "OV205", "--odom-topic and --ticks-topic"),
    ],
)
def test_what_is_named_wrongly_is_wrong_use(tmp_path: Path, named: Named, code: str, says: str) -> None:
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        pictures(maker)
        wheels(maker)
    refusal = refused(maker.path, named, code=code)
    assert refusal.exit_code == 2
    assert says in str(refusal)


def test_a_message_without_sides_is_no_pair_of_counts(tmp_path: Path) -> None:
    with BagMaker(tmp_path / "drive", "mcap", {"my_msgs/msg/Two": "int32 port_ticks\nint32 starboard_ticks"}) as maker:
        pictures(maker)
        maker.write("/two", ORIGIN_NS, "my_msgs/Two", port_ticks=1, starboard_ticks=2)
    refusal = refused(maker.path, Named(ticks_topic="/two"), code="OV332")
    assert "its whole numbers are port_ticks, starboard_ticks" in str(refusal)


def test_a_type_that_the_bag_does_not_define_is_not_guessed_at(tmp_path: Path) -> None:
    with BagMaker(tmp_path / "drive", "sqlite3") as maker:
        pictures(maker)
        wheels(maker)
    with sqlite3.connect(maker.path / "drive.db3") as base:
        base.executescript("DROP TABLE schema; DROP TABLE message_definitions")
    assert "says nothing of its wheels" in str(refused(maker.path, code="OV332"))
    refusal = refused(maker.path, Named(ticks_topic="/wheels"), code="OV332")
    assert "does not hold the definition of robot_msgs/msg/WheelTicks" in str(refusal)


def test_a_ring_that_is_not_in_these_pictures_is_to_be_configured(tmp_path: Path) -> None:
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        pictures(maker)
        wheels(maker)
    far = with_rig(RIG, {"camera": {"width_px": 1024, "height_px": 768}, "ring": {"center_px": [500.0, 400.0]}}, "test")
    with pytest.raises(DataError, match="outside the picture of 64 x 48") as refusal:
        import_rosbag(maker.path, tmp_path / "out.mcap", far)
    assert "set [ring] in the configuration" in refusal.value.help


# ---------------------------------------------------------------- files that are no bag, or not whole


def whole(folder: Path, form: str) -> Path:
    """The file that holds the messages."""
    with BagMaker(folder / f"drive{SUFFIX[form]}", form) as maker:
        maker.drive(DRIVE)
    return maker.path if form == "ros1" else next(maker.path.glob("drive.*"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.99, 0.9999])
def test_a_bag_that_is_cut_off_is_refused_with_the_tool_that_mends_it(tmp_path: Path, form: str, share: float) -> None:
    file = whole(tmp_path, form)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    refusal = refused(tmp_path / f"drive{SUFFIX[form]}", code="OV331")
    assert "cannot be read as a bag" in str(refusal)
    assert "mends what a killed recorder left" in refusal.help


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_with_wrong_bytes_inside_is_refused_or_read(tmp_path: Path, form: str) -> None:
    """Wherever zeros stand in place of a hundred bytes: one line, or all of it; never another error."""
    file = whole(tmp_path, form)
    data = file.read_bytes()
    refusals = 0
    for at in range(0, len(data), len(data) // 7):
        file.write_bytes(data[:at] + bytes(100) + data[at + 100 :])
        with suppress(DataError, UseError):
            import_rosbag(tmp_path / f"drive{SUFFIX[form]}", tmp_path / "out.mcap", RIG)
            continue
        refusals += 1
    assert refusals


@pytest.mark.parametrize("name", ["drive.bag", "drive.db3", "drive.mcap", "drive.txt", "drive"])
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str) -> None:
    assert "no such file" in str(refused(tmp_path / name, code="OV331"))
    (tmp_path / name).write_bytes(b"something else\n" * 50)
    refused(tmp_path / name, code="OV331")
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()
    refused(tmp_path / name, code="OV331")


@pytest.mark.parametrize("text", ["", "{", "rosbag2_bagfile_information: {version: 99}", "a: 1", "[1, 2]"])
def test_metadata_that_say_nothing_right_are_refused(tmp_path: Path, text: str) -> None:
    whole(tmp_path, "mcap")
    (tmp_path / "drive" / "metadata.yaml").write_text(text)
    refused(tmp_path / "drive", code="OV331")


def test_any_bytes_of_a_message_are_read_or_refused(tmp_path: Path) -> None:
    random = np.random.default_rng(11)
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        for k in range(15):
            kind = ("sensor_msgs/JointState", "sensor_msgs/Image", "nav_msgs/Odometry")[k % 3]
            maker.write_bytes(f"/t{k}", ORIGIN_NS, kind, b"\0\1\0\0" + random.bytes(int(random.integers(0, 120))))
    bag = Bag(maker.path)
    refusals = 0
    for topic in bag.topics.values():
        with suppress(DataError):
            assert len(list(bag.messages(topic))) == 1
            continue
        refusals += 1
    assert refusals > 8
