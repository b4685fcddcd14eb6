"""Any source of `cv2.VideoCapture`, or a folder of images -> frames, and what happens to it."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import cv2
import numpy as np

from omnivert.config import Camera
from omnivert.drivers.camera_facts import CameraFacts, Capture, Stamp, facts_of
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.image_file import frame_from_pixels
from omnivert.drivers.image_folder import folder_frames
from omnivert.drivers.stream_clock import StreamClock
from omnivert.messages import Frame

NETWORK_MS = 5000  # without an answer for so long, a sender is gone
FRESH_NS = 10**9  # a driver's stamp that is older than this is of another clock


@dataclass(frozen=True, slots=True)
class Described:
    """What a live source tells of itself; again when it changes."""

    facts: CameraFacts


CameraEvent = Frame | Opened | Described | Lost | Refused | Finished


def opencv_capture(source: int | str) -> Capture:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # a broken stream makes FFmpeg talk at every frame
    if isinstance(source, str) and "://" in source:
        # Without a limit a sender that has vanished is waited for half a minute.
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, NETWORK_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, NETWORK_MS]
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
    return cv2.VideoCapture(source)


def can_wait(config: Camera) -> bool:
    """Whether the source is the name of a folder or a file, which loses nothing when it is read later."""
    live = config.source.isdecimal() or config.source.startswith("/dev/") or "://" in config.source
    return not live and "!" not in config.source  # a pipeline of GStreamer's


def stored_facts(config: Camera) -> str:
    """Who stamps the frames of a folder or a file, in the words of `CameraFacts`."""
    own = Path(config.source).is_dir()
    return "stamped by " + (f"a rhythm of {config.frame_rate_hz:.4g} Hz" if own else "the video's own time")


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
            yield from _grabbed(opened, config, stop, now_ns, None if is_device else StreamClock(config.source))
        finally:
            opened.release()
        if not stop.is_set():
            reason = "gives no more frames"
            yield Lost(reason)
            stop.wait(config.reopen_s)


def _grabbed(
    opened: Capture, config: Camera, stop: Event, now_ns: Callable[[], int], clock: StreamClock | None
) -> Iterator[Frame | Refused | Described]:
    """Frames until the source gives no more; with the first one, what it tells of itself.

    clock  of the network's stream; None: a device of this machine
    """
    facts: CameraFacts | None = None
    last_ns = -1
    while not stop.is_set() and opened.grab():
        stamp_ns, stamp = _stamped(opened, now_ns(), clock)
        if facts is None or facts.stamp is not stamp:
            facts = facts_of(opened, config, stamp) if facts is None else facts.stamped(stamp)
            yield Described(facts)
        if stamp_ns <= last_ns:  # where the better stamp was found to lie earlier than the frame's arrival
            yield Refused("frame stamped before the one before it")
            continue
        last_ns = stamp_ns
        yield _frame(opened, max(0, stamp_ns - round(config.stamp_delay_s * 1e9)), config.colour)


def _stamped(opened: Capture, grabbed_ns: int, clock: StreamClock | None) -> tuple[int, Stamp]:
    """The best stamp that the source offers for the frame just grabbed, and whose it is."""
    place_ms = opened.get(cv2.CAP_PROP_POS_MSEC)
    if clock is not None:
        sent_ns = clock.step(place_ms, grabbed_ns)
        return sent_ns, clock.stamp
    kernel_ns = round(place_ms * 1e6)  # Video4Linux: of the monotonic clock
    fresh = grabbed_ns - FRESH_NS < kernel_ns <= grabbed_ns
    return (kernel_ns, Stamp.KERNEL) if fresh else (grabbed_ns, Stamp.ARRIVAL)


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
            yield _frame(opened, stamp_ns, config.colour)
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


def _frame(opened: Capture, stamp_ns: int, colour: bool) -> Frame | Refused:
    try:
        there, pixels = opened.retrieve()
        if not there:
            return Refused("frame cannot be decoded")
        return frame_from_pixels(np.asarray(pixels), stamp_ns, colour=colour)
    except (cv2.error, ValueError) as error:
        return Refused(f"frame cannot be used: {error}")
