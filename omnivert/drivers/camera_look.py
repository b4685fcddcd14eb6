"""A short look through the configured camera, for whoever checks or sets up a robot; never waits for ever."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from queue import Empty, SimpleQueue

from omnivert.config import Camera
from omnivert.drivers.camera import (
    CameraEvent,
    Described,
    camera_events,
    can_wait,
    opencv_capture,
    stored_facts,
)
from omnivert.drivers.camera_facts import Capture
from omnivert.drivers.device import Finished, Lost, Refused
from omnivert.messages import Frame


@dataclass(frozen=True, slots=True)
class Look:
    """What was seen in it."""

    frames: int
    width_px: int = 0
    height_px: int = 0
    rate_hz: float | None = None  # by the stamps; None: fewer than two frames
    longest_gap_s: float | None = None
    told: str = ""  # stamp, rate and exposure as the source tells them
    reason: str = ""  # why there is no frame, or what was wrong with some


def look(
    config: Camera,
    for_s: float = 2.0,
    patience_s: float = 10.0,
    capture: Callable[[int | str], Capture] = opencv_capture,
) -> Look:
    """So many seconds of the camera's frames, or the reason why there are none."""
    stamps_ns: list[int] = []
    size = (0, 0)
    told, reason = stored_facts(config) if can_wait(config) else "", ""
    for event in patient_events(config, patience_s, capture):
        match event:
            case Frame():
                stamps_ns.append(event.stamp_ns)
                size = event.width_px, event.height_px
                if stamps_ns[-1] - stamps_ns[0] >= for_s * 1e9:
                    break
            case Described(facts):
                told = str(facts)
            case Lost(why) | Refused(why):
                reason = why
            case Finished():
                break
    gaps = [1e-9 * (after - before) for before, after in pairwise(stamps_ns)]
    if not stamps_ns:
        return Look(0, told=told, reason=reason or "it is open and gives nothing")
    return Look(
        len(stamps_ns), *size, len(gaps) / sum(gaps) if gaps else None, max(gaps) if gaps else None, told, reason
    )


def patient_events(
    config: Camera, patience_s: float, capture: Callable[[int | str], Capture] = opencv_capture
) -> Iterator[CameraEvent]:
    """What the camera tells, until no frame has come for so long: a driver may wait for ever."""
    told: SimpleQueue[CameraEvent] = SimpleQueue()
    stop = threading.Event()

    def listen() -> None:
        for event in camera_events(config, stop, capture=capture):
            told.put(event)

    threading.Thread(target=listen, name="camera", daemon=True).start()
    until_s = time.monotonic() + patience_s
    try:
        while True:
            event = told.get(timeout=max(until_s - time.monotonic(), 0.0))
            if isinstance(event, Frame):
                until_s = time.monotonic() + patience_s
            yield event
    except Empty:
        return
    finally:
        stop.set()
