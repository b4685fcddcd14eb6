import contextlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.messages import Frame, PixelFormat
from omnivert.vision.image import grey_from_frame


def _frame(form: PixelFormat, data: NDArray[np.uint8], width: int = 40, height: int = 30) -> Frame:
    return Frame(0, form, width, height, data)


def _encoded(extension: str, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.imencode(extension, picture)[1], dtype=np.uint8).ravel()


PICTURE = np.random.default_rng(0).integers(0, 256, (30, 40), dtype=np.uint8)


def test_raw_grey_and_png_give_the_picture_itself() -> None:
    assert np.array_equal(grey_from_frame(_frame(PixelFormat.GREY8, PICTURE.ravel())), PICTURE)
    assert np.array_equal(grey_from_frame(_frame(PixelFormat.PNG, _encoded(".png", PICTURE))), PICTURE)


def test_colour_becomes_grey_raw_or_compressed() -> None:
    colour = np.zeros((30, 40, 3), dtype=np.uint8)
    colour[..., 1] = 200  # green weighs 0.587
    for form, data in (
        (PixelFormat.BGR8, colour.ravel()),
        (PixelFormat.PNG, _encoded(".png", colour)),
        (PixelFormat.JPEG, _encoded(".jpg", colour)),
    ):
        grey = grey_from_frame(_frame(form, data))
        assert grey.shape == (30, 40)
        assert np.max(np.abs(grey.astype(int) - 117)) <= 2


@pytest.mark.parametrize("form", [PixelFormat.GREY8, PixelFormat.BGR8])
@pytest.mark.parametrize("change", [-1, 1, -1000])
def test_raw_bytes_that_do_not_fill_the_picture_are_refused(form: PixelFormat, change: int) -> None:
    count = 1200 * (3 if form is PixelFormat.BGR8 else 1) + change
    with pytest.raises(ValueError, match="bytes, not"):
        grey_from_frame(_frame(form, np.zeros(count, dtype=np.uint8)))


def test_a_file_of_another_size_than_the_message_says_is_refused() -> None:
    with pytest.raises(ValueError, match="says 41x30, holds 40x30"):
        grey_from_frame(_frame(PixelFormat.PNG, _encoded(".png", PICTURE), width=41))


def test_a_jpeg_that_was_cut_off_is_refused_not_half_shown() -> None:
    whole = _encoded(".jpg", PICTURE)
    with pytest.raises(ValueError, match="cut off"):
        grey_from_frame(_frame(PixelFormat.JPEG, whole[: whole.size // 2]))


def test_a_jpeg_padded_by_the_camera_is_read() -> None:
    padded = np.append(_encoded(".jpg", PICTURE), np.zeros(100, dtype=np.uint8))
    assert grey_from_frame(_frame(PixelFormat.JPEG, padded)).shape == (30, 40)


@given(data=st.binary(max_size=200), form=st.sampled_from(list(PixelFormat)))
def test_any_bytes_give_a_picture_or_a_value_error(data: bytes, form: PixelFormat) -> None:
    frame = _frame(form, np.frombuffer(data, dtype=np.uint8))
    with contextlib.suppress(ValueError):
        assert grey_from_frame(frame).shape == (30, 40)


@pytest.mark.parametrize("extension", [".png", ".jpg"])
def test_a_header_that_tells_of_a_huge_picture_is_refused_before_room_is_made_for_it(extension: str) -> None:
    form = PixelFormat.PNG if extension == ".png" else PixelFormat.JPEG
    data = _encoded(extension, PICTURE)
    at = 18 if extension == ".png" else int(np.flatnonzero((data[:-1] == 0xFF) & (data[1:] == 0xC0))[0]) + 5
    data[at] = 0x75  # 30 000 and more
    with pytest.raises(ValueError, match="says 40x30, holds"):
        grey_from_frame(_frame(form, data))


def test_a_png_whose_part_is_longer_than_the_file_is_refused() -> None:
    data = _encoded(".png", PICTURE)
    data[33] ^= 0x80  # the length of its second part
    with pytest.raises(ValueError, match="cannot be decoded"):
        grey_from_frame(_frame(PixelFormat.PNG, data))
