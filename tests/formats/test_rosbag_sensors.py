"""Every encoding of a picture comes out as the picture that was put in."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from omnivert.errors import DataError
from omnivert.formats.rosbag.drive import RosBag
from omnivert.formats.rosbag.file import Received
from omnivert.formats.rosbag.sensors import frame
from omnivert.formats.rosbag.topics import Named
from omnivert.messages import Frame, PixelFormat, Ticks
from omnivert.vision.image import grey_from_frame
from tests.formats.bags import ORIGIN_NS, RIG, BagMaker

HEIGHT, WIDTH = 48, 64
RANDOM = np.random.default_rng(3)
GREY = RANDOM.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
COLOUR = RANDOM.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)  # blue green red
OPAQUE = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
Pixels = NDArray[Any]


def two_bytes(pixels: Pixels) -> Pixels:
    """As 16 bits, the lower ones any."""
    return pixels.astype(np.uint16) * 256 + 77


def row_bytes(pixels: Pixels, fill: int = 0) -> tuple[int, Pixels]:
    """Bytes of a row, and all of them; each row followed by some that mean nothing."""
    raw = np.frombuffer(pixels.tobytes(), np.uint8).reshape(HEIGHT, -1)
    return raw.shape[1] + fill, np.pad(raw, ((0, 0), (0, fill)), constant_values=99).reshape(-1)


def yuv(first: int) -> Pixels:
    """Grey at every second byte, from the first or the second on; between them colours that say nothing."""
    data = np.full((HEIGHT, WIDTH, 2), 128, np.uint8)
    data[:, :, first] = GREY
    return data


CASES = [
    ("mono8", GREY, GREY),
    ("8UC1", GREY, GREY),
    ("bgr8", COLOUR, COLOUR),
    ("8UC3", COLOUR, COLOUR),
    ("rgb8", COLOUR[:, :, ::-1], COLOUR),
    ("bgra8", np.concatenate([COLOUR, OPAQUE], axis=2), COLOUR),
    ("rgba8", np.concatenate([COLOUR[:, :, ::-1], OPAQUE], axis=2), COLOUR),
    ("mono16", two_bytes(GREY), GREY),
    ("16UC1", two_bytes(GREY), GREY),
    ("bgr16", two_bytes(COLOUR), COLOUR),
    ("rgb16", two_bytes(COLOUR[:, :, ::-1]), COLOUR),
    ("yuv422", yuv(1), GREY),
    ("uyvy", yuv(1), GREY),
    ("yuv422_yuy2", yuv(0), GREY),
    ("yuyv", yuv(0), GREY),
]


def received(**fields: Any) -> Received:
    return Received("/image, message 1", 0, SimpleNamespace(**fields))


def image(pixels: Pixels, encoding: str, fill: int = 0, big: int = 0) -> Received:
    step, data = row_bytes(pixels, fill)
    size = {"width": WIDTH, "height": HEIGHT, "step": step}
    return received(**size, encoding=encoding, is_bigendian=big, data=data)


def mono(width: int, height: int, step: int, size: int) -> Received:
    """A grey picture that says what it likes."""
    said = {"width": width, "height": height, "step": step}
    return received(**said, encoding="mono8", is_bigendian=0, data=np.zeros(size, np.uint8))


@pytest.mark.parametrize("fill", [0, 5])
@pytest.mark.parametrize(("encoding", "given", "expected"), CASES, ids=[case[0] for case in CASES])
def test_an_encoding_is_read_as_the_picture_it_is(encoding: str, given: Pixels, expected: Pixels, fill: int) -> None:
    made = frame(image(given, encoding, fill), 7)
    assert (made.stamp_ns, made.width_px, made.height_px) == (7, WIDTH, HEIGHT)
    assert made.format is (PixelFormat.GREY8 if expected.ndim == 2 else PixelFormat.BGR8)
    assert np.array_equal(made.data.reshape(expected.shape), expected)


def test_bytes_of_16_bits_may_stand_the_other_way_round() -> None:
    made = frame(image(two_bytes(GREY).astype(">u2"), "mono16", big=1), 7)
    assert np.array_equal(made.data.reshape(GREY.shape), GREY)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_pattern_gives_the_grey_of_its_colours(order: str, bits: int) -> None:
    """Of an even red, green and blue: the mosaic of each order must give the grey value of that one colour."""
    value = {"r": 200, "g": 120, "b": 40}
    mosaic = np.zeros((HEIGHT, WIDTH), np.uint8)
    for place, letter in enumerate(order):
        mosaic[place // 2 :: 2, place % 2 :: 2] = value[letter]
    made = frame(image(mosaic if bits == 8 else two_bytes(mosaic), f"bayer_{order}{bits}"), 7)
    grey = round(0.299 * 200 + 0.587 * 120 + 0.114 * 40)
    assert np.abs(made.data.astype(int) - grey).max() <= 1


@settings(max_examples=25)
@given(grey=arrays(np.uint8, (HEIGHT, WIDTH)), fill=st.integers(0, 9))
def test_any_grey_picture_comes_through(grey: Pixels, fill: int) -> None:
    assert np.array_equal(frame(image(grey, "mono8", fill), 1).data.reshape(grey.shape), grey)


def test_the_last_row_need_not_be_filled_up() -> None:
    whole = image(GREY, "mono8", fill=5)
    whole.content.data = whole.content.data[:-5]
    assert np.array_equal(frame(whole, 1).data.reshape(GREY.shape), GREY)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_compressed_pictures_stay_the_bytes_that_they_are(suffix: str) -> None:
    data = cv2.imencode(suffix, COLOUR)[1].reshape(-1)
    made = frame(received(format=f"bgr8; {suffix[1:]} compressed bgr8", data=data), 7)
    assert made.format is (PixelFormat.JPEG if suffix == ".jpg" else PixelFormat.PNG)
    assert np.array_equal(made.data, data)


def test_compressed_pictures_of_another_kind_become_pixels() -> None:
    made = frame(received(format="bmp", data=cv2.imencode(".bmp", GREY)[1].reshape(-1)), 7)
    assert np.array_equal(grey_from_frame(made), GREY)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (image(GREY, "32FC1"), "'32FC1'"),
        (image(GREY, ""), "''"),
        (
            received(width=64, height=48, step=64, encoding="mono8", is_bigendian=0, data=GREY[:40].reshape(-1)),
            "does not fit",
        ),
        (
            received(width=64, height=48, step=10, encoding="mono8", is_bigendian=0, data=GREY.reshape(-1)),
            "does not fit",
        ),
        (received(width=0, height=0, step=0, encoding="mono8", is_bigendian=0, data=GREY.reshape(-1)), "does not fit"),
        (received(width=16385, height=1, step=16385, encoding="mono8", is_bigendian=0, data=np.zeros(16385)), "limit"),
        (received(format="16UC1; compressedDepth png", data=np.zeros(20)), "distances"),
        (received(format="jpeg", data=np.zeros(0)), "empty"),
        (received(format="jpeg", data=np.arange(99)), "cannot read"),
        (received(format="jpeg", data=cv2.imencode(".jpg", GREY)[1].reshape(-1)[:-300]), "ends before"),
    ],
)
def test_what_is_no_picture_is_refused_with_its_place(given: Received, says: str) -> None:
    with pytest.raises(DataError) as refusal:
        frame(given, 7)
    assert (refusal.value.code, refusal.value.what) == ("OV333", "/image, message 1")
    assert says in refusal.value.because


@pytest.mark.parametrize("form", ["ros1", "mcap"])
def test_raw_pictures_come_through_a_bag(tmp_path: Path, form: str) -> None:
    with BagMaker(tmp_path / ("drive.bag" if form == "ros1" else "drive"), form) as maker:
        for k in range(5):
            at = ORIGIN_NS + k * 100_000_000
            step, data = row_bytes(COLOUR[:, :, ::-1], fill=4)
            maker.pixels("/image", at, at, WIDTH, HEIGHT, "rgb8", step, data)
            maker.counts("/wheels", Ticks(0, k, k), at)
    frames = [m for m in RosBag(maker.path, RIG, Named(), False, None).messages() if isinstance(m, Frame)]
    assert [f.stamp_ns for f in frames] == [k * 100_000_000 for k in range(5)]
    assert all(np.array_equal(f.data.reshape(COLOUR.shape), COLOUR) for f in frames)
