"""Cameras: folders, video files, and live ones that vanish and come back."""

import shutil
import subprocess
import sys
from itertools import islice
from pathlib import Path
from threading import Event, Thread
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.config import Camera
from omnivert.drivers.camera import CameraEvent, Described, camera_events
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.image_file import frame_from_file, frame_from_pixels
from omnivert.drivers.newest import Newest
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.image import grey_from_frame

RNG = np.random.default_rng(5)
PICTURE = RNG.integers(0, 256, (48, 64, 3), np.uint8)


def encoded(suffix: str, pixels: np.ndarray = PICTURE) -> bytes:
    return cv2.imencode(suffix, pixels)[1].tobytes()


def frames(events: list[CameraEvent]) -> list[Frame]:
    return [event for event in events if isinstance(event, Frame)]


class Clock:
    """A clock that the test moves."""

    def __init__(self) -> None:
        self.ns = 50 * 10**9

    def __call__(self) -> int:
        self.ns += 1_000_000
        return self.ns


# ---------------------------------------------------------------- images


@pytest.mark.parametrize(("suffix", "form"), [(".jpg", PixelFormat.JPEG), (".png", PixelFormat.PNG)])
def test_compressed_files_pass_through_as_their_bytes(suffix: str, form: PixelFormat) -> None:
    frame = frame_from_file(encoded(suffix), 7)
    assert (frame.format, frame.width_px, frame.height_px, frame.stamp_ns) == (form, 64, 48, 7)
    assert frame.data.tobytes() == encoded(suffix)


@pytest.mark.parametrize("suffix", [".bmp", ".tiff", ".ppm"])
def test_other_files_become_pixels_row_by_row(suffix: str) -> None:
    colour = frame_from_file(encoded(suffix), 0)
    assert colour.format is PixelFormat.BGR8
    assert np.array_equal(colour.data.reshape(48, 64, 3), PICTURE)
    grey = frame_from_file(encoded(".pgm", PICTURE[:, :, 0]), 0)
    assert grey.format is PixelFormat.GREY8
    assert np.array_equal(grey.data.reshape(48, 64), PICTURE[:, :, 0])


def test_sixteen_bits_and_a_fourth_plane_are_brought_to_the_forms_of_a_frame() -> None:
    deep = frame_from_pixels(PICTURE[:, :, 0].astype(np.uint16) * 257, 0)
    assert np.array_equal(deep.data.reshape(48, 64), PICTURE[:, :, 0])
    four = frame_from_pixels(np.dstack([PICTURE, PICTURE[:, :, :1]]), 0)
    assert np.array_equal(four.data.reshape(48, 64, 3), PICTURE)
    with pytest.raises(ValueError, match="float64"):
        frame_from_pixels(np.zeros((4, 4)), 0)


def test_a_jpeg_cut_off_anywhere_is_refused() -> None:
    whole = encoded(".jpg")
    for length in range(0, len(whole) - 1, 7):
        with pytest.raises(ValueError):
            frame_from_file(whole[:length], 0)
    assert frame_from_file(whole + b"\0" * 500, 0).width_px == 64


def test_a_png_cut_off_is_refused() -> None:
    with pytest.raises(ValueError, match="PNG"):
        frame_from_file(encoded(".png")[:-30], 0)


# ---------------------------------------------------------------- a folder


def test_a_folder_is_played_in_order_of_its_numbers_at_its_rate(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        (tmp_path / f"Omni{number}.png").write_bytes(encoded(".png", np.full((40, 40), number, np.uint8)))
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "Omni5.jpg").write_bytes(b"torn")
    config = Camera(source=str(tmp_path), frame_rate_hz=1000.0)
    events = list(camera_events(config, Event()))
    assert events[0] == Opened()
    assert events[-1] == Finished()
    assert [event for event in events if isinstance(event, Refused)] == [
        Refused("Omni5.jpg: OpenCV cannot read it as an image")
    ]
    shown = frames(events)
    greys = [np.asarray(cv2.imdecode(frame.data, cv2.IMREAD_GRAYSCALE)) for frame in shown]
    assert [int(grey[0, 0]) for grey in greys] == [1, 9, 10]
    assert np.diff([frame.stamp_ns for frame in shown]).tolist() == [2_000_000, 1_000_000]  # one place was torn


def test_an_empty_folder_is_named_and_waited_for(tmp_path: Path) -> None:
    config = Camera(source=str(tmp_path), frame_rate_hz=1000.0, reopen_s=0.01)
    events = camera_events(config, Event())
    assert next(events) == Lost("holds no image")
    (tmp_path / "one.png").write_bytes(encoded(".png"))
    assert next(events) == Opened()
    assert len(frames(list(events))) == 1


def show(folder: Path, *names: str) -> None:
    """The folder appears with these images."""
    making = folder.with_name("making")
    making.mkdir()
    for name in names:
        (making / name).write_bytes(encoded(".png"))
    making.rename(folder)


@pytest.mark.parametrize("names", [("0.png", "1.png", "2.png"), ("7.png", "8.png", "9.png")])
def test_a_folder_that_vanishes_while_it_plays_is_waited_for_and_begun_again(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    folder, clock = tmp_path / "images", Clock()
    show(folder, "0.png", "1.png", "2.png")
    events = camera_events(Camera(source=str(folder), frame_rate_hz=1000.0, reopen_s=0.01), Event(), clock)
    before = list(islice(events, 2))
    assert [type(event) for event in before] == [Opened, Frame]
    shutil.rmtree(folder)
    assert next(events) == Lost("cannot be read: No such file or directory")
    show(folder, *names)
    after = list(events)
    assert [type(event) for event in after] == [Opened, Frame, Frame, Frame, Finished]
    assert frames(after)[0].stamp_ns > frames(before)[-1].stamp_ns


def test_a_folder_whose_images_vanish_before_it_is_waited_for(tmp_path: Path) -> None:
    for name in ("0.png", "1.png"):
        (tmp_path / name).write_bytes(encoded(".png"))
    events = camera_events(Camera(source=str(tmp_path), frame_rate_hz=1000.0, reopen_s=0.01), Event())
    assert [type(event) for event in islice(events, 2)] == [Opened, Frame]
    for name in ("0.png", "1.png"):
        (tmp_path / name).unlink()
    assert next(events) == Lost("holds no image")
    (tmp_path / "one.png").write_bytes(encoded(".png"))
    assert [type(event) for event in events] == [Opened, Frame, Finished]


def test_one_image_that_vanishes_is_refused_and_the_folder_goes_on(tmp_path: Path) -> None:
    for name in ("0.png", "1.png", "2.png"):
        (tmp_path / name).write_bytes(encoded(".png"))
    events = camera_events(Camera(source=str(tmp_path), frame_rate_hz=1000.0), Event())
    assert [type(event) for event in islice(events, 2)] == [Opened, Frame]
    (tmp_path / "1.png").unlink()
    assert [type(event) for event in events] == [Refused, Frame, Finished]


def test_images_that_come_while_a_folder_plays_are_played_after_the_others(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(encoded(".png"))
    events = camera_events(Camera(source=str(tmp_path), frame_rate_hz=1000.0), Event())
    seen = list(islice(events, 2))
    (tmp_path / "1.png").write_bytes(encoded(".png"))
    seen += list(events)
    assert [type(event) for event in seen] == [Opened, Frame, Frame, Finished]
    assert np.diff([frame.stamp_ns for frame in frames(seen)]).tolist() == [1_000_000]


def test_a_stop_ends_a_folder_at_once(tmp_path: Path) -> None:
    for number in range(3):
        (tmp_path / f"{number}.png").write_bytes(encoded(".png"))
    stop = Event()
    events = camera_events(Camera(source=str(tmp_path), frame_rate_hz=0.001), stop)
    assert len(frames(list(islice(events, 2)))) == 1
    stop.set()
    assert list(events) == []


def test_a_source_that_is_not_there_yet_is_waited_for(tmp_path: Path) -> None:
    config = Camera(source=str(tmp_path / "images"), reopen_s=0.01)
    events = camera_events(config, Event())
    assert next(events) == Lost("is not there")
    (tmp_path / "making").mkdir()
    (tmp_path / "making" / "one.png").write_bytes(encoded(".png"))
    (tmp_path / "making").rename(tmp_path / "images")
    assert [type(event) for event in events] == [Opened, Frame, Finished]


@pytest.mark.parametrize(("folder", "number", "size"), [("vmr", 6, (1024, 768)), ("kaidan", 9, (640, 480))])
def test_photographs_pass_through_as_they_are(
    shared_data: Path, folder: str, number: int, size: tuple[int, int]
) -> None:
    photographs = shared_data / "real" / folder
    if not photographs.is_dir():
        pytest.skip(f"needs {folder}'s photographs, which are not here")
    events = list(camera_events(Camera(source=str(photographs), frame_rate_hz=1000.0), Event()))
    shown = frames(events)
    assert len(shown) == number == len(events) - 2
    assert {(frame.width_px, frame.height_px, frame.format) for frame in shown} == {(*size, PixelFormat.JPEG)}
    names = sorted(photographs.glob("*.jpg"))
    assert [frame.data.tobytes() for frame in shown] == [name.read_bytes() for name in names]


# ---------------------------------------------------------------- captures


class FakeCapture:
    """A camera that gives so many frames and then vanishes."""

    def __init__(self, pictures: list[Any], position_ms: float = 0.0) -> None:
        self._pictures = iter(pictures)
        self._picture: Any = None
        self._position_ms = position_ms
        self.asked: dict[int, float] = {}
        self.released = False

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def grab(self) -> bool:
        self._picture = next(self._pictures, None)
        return self._picture is not None

    def retrieve(self) -> tuple[bool, Any]:
        return self._picture is not False, self._picture

    def get(self, propId: int) -> float:
        return self._position_ms if propId == cv2.CAP_PROP_POS_MSEC else 0.0

    def set(self, propId: int, value: float) -> bool:
        self.asked[propId] = value
        return True

    def release(self) -> None:
        self.released = True


class Closed(FakeCapture):
    def isOpened(self) -> bool:  # noqa: N802
        return False


def test_a_camera_that_vanishes_is_named_and_opened_again() -> None:
    first, second = FakeCapture([PICTURE, False, PICTURE]), FakeCapture([PICTURE[:32]])
    captures = iter([Closed([]), Closed([]), first, Closed([]), second])
    config = Camera(source="0", reopen_s=0.01, width_px=64, height_px=48)
    stop = Event()
    events = camera_events(config, stop, Clock(), lambda _: next(captures))
    seen: list[CameraEvent] = list(islice((event for event in events if not isinstance(event, Described)), 9))
    assert [type(event) for event in seen] == [Lost, Opened, Frame, Refused, Frame, Lost, Lost, Opened, Frame]
    assert seen[0] == seen[6] == Lost("does not open")
    assert seen[5] == Lost("gives no more frames")
    assert first.released
    assert (first.asked[cv2.CAP_PROP_FRAME_WIDTH], first.asked[cv2.CAP_PROP_FRAME_HEIGHT]) == (64, 48)
    assert (frames(seen)[2].width_px, frames(seen)[2].height_px) == (64, 32)  # as it is, whatever was asked for
    stop.set()
    assert list(events) == []
    assert second.released


def test_the_kernels_stamp_is_taken_when_it_is_of_this_clock() -> None:
    def stamp(source: str, position_ms: float, delay_s: float = 0.0) -> int:
        config = Camera(source=source, stamp_delay_s=delay_s)
        events = camera_events(config, Event(), Clock(), lambda _: FakeCapture([PICTURE], position_ms))
        return frames(list(islice(events, 3)))[0].stamp_ns

    grabbed_ns = 50_001_000_000
    assert stamp("0", 49_990.0) == 49_990_000_000
    assert stamp("/dev/video7", 49_990.0, delay_s=0.010) == 49_980_000_000
    assert stamp("0", 3.0) == grabbed_ns  # a place in a stream, not a time of this clock
    assert stamp("0", 50_500.0) == grabbed_ns  # the future
    assert stamp("http://robot/stream", 49_990.0) == grabbed_ns


def test_a_video_file_is_stamped_by_its_own_time_and_ends(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48))
    assert video.isOpened()
    for grey in range(5):
        video.write(np.full((48, 64, 3), grey * 40, np.uint8))
    video.release()
    events = list(camera_events(Camera(source=str(path)), Event()))
    assert (events[0], events[-1]) == (Opened(), Finished())
    assert [round(float(frame.data.mean()) / 40) for frame in frames(events)] == [0, 1, 2, 3, 4]
    stamps_ms = np.array([frame.stamp_ns for frame in frames(events)]) * 1e-6
    assert np.allclose(np.diff(stamps_ms), 20.0, atol=0.01)


def test_a_file_that_is_no_video_is_named(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    path.write_bytes(b"no video")
    events = list(camera_events(Camera(source=str(path)), Event()))
    assert events == [Lost("is no video that OpenCV can read"), Finished()]


def test_a_missing_camera_of_the_machine_is_named_not_raised() -> None:
    program = (
        "from itertools import islice; from threading import Event\n"
        "from omnivert.config import Camera; from omnivert.drivers.camera import camera_events\n"
        "print(next(camera_events(Camera(source='/dev/video97'), Event())))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert "does not open" in done.stdout


def test_a_video_is_grey_unless_its_colours_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "drive.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 500.0, (64, 48))
    video.write(PICTURE)
    video.release()
    (grey,) = frames(list(camera_events(Camera(source=str(path)), Event())))
    (colour,) = frames(list(camera_events(Camera(source=str(path), colour=True), Event())))
    assert (grey.format, colour.format) == (PixelFormat.GREY8, PixelFormat.BGR8)
    assert np.array_equal(grey_from_frame(grey), grey_from_frame(colour))  # what vision sees is the same
    assert colour.data.size == 3 * grey.data.size


# ---------------------------------------------------------------- the newest only


def test_only_the_newest_is_kept_and_the_displaced_are_counted() -> None:
    room = Newest[int]()
    for number in range(5):
        room.put(number)
    assert (room.take(0.0), room.take(0.0), room.displaced) == (4, None, 4)


def test_a_source_that_can_wait_loses_nothing() -> None:
    room = Newest[int]()

    def put_all() -> None:
        for number in range(50):
            room.put(number, patient=True)

    thread = Thread(target=put_all)
    thread.start()
    assert [room.take(10.0) for _ in range(50)] == list(range(50))
    thread.join()
    assert room.displaced == 0
    room.put(1)
    waiting = Thread(target=room.put, args=(2,), kwargs={"patient": True})
    waiting.start()
    room.close()
    waiting.join(10.0)
    assert not waiting.is_alive()
