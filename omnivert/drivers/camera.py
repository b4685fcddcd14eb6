"""Any source of `cv2.VideoCapture`, or a folder of images -> frames."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import Any, Protocol

import cv2
import numpy as np

from omnivert.config import Camera
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.image_file import frame_from_pixels
from omnivert.drivers.image_folder import folder_frames
from omnivert.messages import Frame

FRESH_NS = 10**9  # a driver's stamp that is older than this is of another clock
CameraEvent = Frame | Opened | Lost | Refused | Finished


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def isOpened(self) -> bool: ...  # noqa: N802
    def grab(self) -> bool: ...
    def retrieve(self) -> tuple[bool, Any]: ...
    def get(self, propId: int) -> float: ...
    def set(self, propId: int, value: float) -> bool: ...
    def release(self) -> None: ...


def opencv_capture(source: int | str) -> Capture:
    return cv2.VideoCapture(source)


def can_wait(config: Camera) -> bool:
    """Whether the source is the name of a folder or a file, which loses nothing when it is read later."""
    live = config.source.isdecimal() or config.source.startswith("/dev/") or "://" in config.source
    return not live and "!" not in config.source  # a pipeline of GStreamer's


def camera_events(
    config: Camera,
    stop: Event,
    now_ns: Callable[[], int] = time.monotonic_ns,
    capture: Callable[[int | str], Capture] = opencv_capture,
) -> Iterator[CameraEvent]:
    """Frames as they come, until `stop`, or until a folder or a video file ends; in between what happens to the source.

    now_ns   the bridge's monotonic clock
    capture  opens a source
    """
    return _stored(config, stop, now_ns, capture) if can_wait(config) else _live(config, stop, now_ns, capture)


def _stored(
    config: Camera, stop: Event, now_ns: Callable[[], int], capture: Callable[[int | str], Capture]
) -> Iterator[CameraEvent]:
    """A folder or a file, as soon as it is there."""
    source = Path(config.source)
    if not source.exists():
        yield Lost("is not there")
    while not source.exists():
        if stop.wait(config.reopen_s):
            return
    if source.is_dir():
        yield from folder_frames(config, stop, now_ns)
    else:
        yield from _video_file(config, stop, now_ns, capture)


def _live(
    config: Camera, stop: Event, now_ns: Callable[[], int], capture: Callable[[int | str], Capture]
) -> Iterator[CameraEvent]:
    """A camera or a stream of the network: opened again whenever it ends."""
    source = int(config.source) if config.source.isdecimal() else config.source
    is_device = isinstance(source, int) or source.startswith("/dev/")
    reason = ""
    while not stop.is_set():
        opened = _opened(source, capture)
        if opened is None:
            if reason != "does not open":
                reason = "does not open"
                yield Lost(reason)
            stop.wait(config.reopen_s)
            continue
        try:
            if is_device:
                _ask(opened, config)
            reason = ""
            yield Opened()
            while not stop.is_set() and opened.grab():
                grabbed_ns = now_ns()
                stamp_ns = _driver_stamp_ns(opened, grabbed_ns) if is_device else grabbed_ns
                yield _frame(opened, max(0, stamp_ns - round(config.stamp_delay_s * 1e9)))
        finally:
            opened.release()
        if not stop.is_set():
            reason = "gives no more frames"
            yield Lost(reason)
            stop.wait(config.reopen_s)


def _video_file(
    config: Camera, stop: Event, now_ns: Callable[[], int], capture: Callable[[int | str], Capture]
) -> Iterator[CameraEvent]:
    """A video at its own pace, stamped by its own time."""
    opened = _opened(config.source, capture)
    if opened is None:
        yield Lost("is no video that OpenCV can read")
        yield Finished()
        return
    try:
        yield Opened()
        rate_hz = opened.get(cv2.CAP_PROP_FPS)
        period_ms = 1000.0 / (rate_hz if 0.0 < rate_hz <= 1000.0 else config.frame_rate_hz)
        start_ns, place_ms = now_ns(), -period_ms
        while opened.grab():
            said_ms = opened.get(cv2.CAP_PROP_POS_MSEC)
            # Some files do not say where they are, or say it late.
            place_ms = said_ms if place_ms < said_ms < place_ms + 1000.0 else place_ms + period_ms
            stamp_ns = start_ns + round(place_ms * 1e6)
            if stop.wait(max(0.0, (stamp_ns - now_ns()) * 1e-9)):
                return
            yield _frame(opened, stamp_ns)
        yield Finished()
    finally:
        opened.release()


def _opened(source: int | str, capture: Callable[[int | str], Capture]) -> Capture | None:
    try:
        opened = capture(source)
    except cv2.error:
        return None
    if opened.isOpened():
        return opened
    opened.release()
    return None


def _ask(opened: Capture, config: Camera) -> None:
    """What a camera cannot do it ignores; a frame of another size is published as it is."""
    opened.set(cv2.CAP_PROP_FRAME_WIDTH, config.width_px)
    opened.set(cv2.CAP_PROP_FRAME_HEIGHT, config.height_px)
    opened.set(cv2.CAP_PROP_FPS, config.frame_rate_hz)
    opened.set(cv2.CAP_PROP_BUFFERSIZE, 1)


def _driver_stamp_ns(opened: Capture, grabbed_ns: int) -> int:
    """The kernel's stamp of the frame where it is of the monotonic clock (Video4Linux), else when it was grabbed."""
    kernel_ns = round(opened.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
    return kernel_ns if grabbed_ns - FRESH_NS < kernel_ns <= grabbed_ns else grabbed_ns


def _frame(opened: Capture, stamp_ns: int) -> Frame | Refused:
    try:
        there, pixels = opened.retrieve()
        return frame_from_pixels(np.asarray(pixels), stamp_ns) if there else Refused("frame cannot be decoded")
    except (cv2.error, ValueError) as error:
        return Refused(f"frame cannot be used: {error}")
