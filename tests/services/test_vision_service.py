"""What the vision service does around its front end; the front end is replaced by one that only takes notes."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from omnivert.config import Config
from omnivert.messages import Bearings, Frame, Message, PixelFormat
from omnivert.wire.channels import FRAME, Channel
from omnivert.wire.received import Received
from services import vision

MS = 1_000_000


class NotingFrontEnd:
    """Bearings without lines; remembers the stamps of the frames that it was given."""

    made: list["NotingFrontEnd"]

    def __init__(self, config: Config) -> None:
        self.stamps: list[int] = []
        self.made.append(self)

    def step(self, frame: Frame) -> Bearings:
        self.stamps.append(frame.stamp_ns)
        none = np.zeros(0)
        return Bearings(frame.stamp_ns, none.astype(np.int64), none, none, none.astype(np.int32), none.astype("f4"))


class QuietBus:
    """Gives what it was made with, and takes down what the service says."""

    def __init__(self, *given: Received) -> None:
        self.given = given
        self.published: list[int] = []
        self.refused: dict[str, int] = {}
        self.answered: list[int] = []

    def listen(self, channel: Channel) -> Iterator[Received | None]:
        yield None
        yield from self.given

    def publish(self, channel: Channel, message: Message, cause: Received) -> None:
        self.published.append(message.stamp_ns)

    def refuse(self, reason: str, times: int = 1) -> None:
        self.refused[reason] = self.refused.get(reason, 0) + times

    def done(self, received: Received) -> None:
        self.answered.append(received.message.stamp_ns)

    def alive(self, incarnation: bytes) -> bool:
        return False


def frames(*stamps_ns: int, run: bytes = b"run-1", replay: bool = False) -> list[Received]:
    pixels = np.zeros(16, np.uint8)
    return [
        Received(FRAME, "v1/camera/front/frame", Frame(ns, PixelFormat.GREY8, 4, 4, pixels), 0, replay, run, run, i)
        for i, ns in enumerate(stamps_ns)
    ]


def served(monkeypatch: pytest.MonkeyPatch, *given: Received) -> tuple[QuietBus, list[NotingFrontEnd]]:
    NotingFrontEnd.made = []
    monkeypatch.setattr(vision, "FrontEnd", NotingFrontEnd)
    bus: Any = QuietBus(*given)
    vision.run(bus, Config())
    return bus, NotingFrontEnd.made


def test_a_frame_whose_stamp_does_not_fit_is_counted_and_moves_no_track(monkeypatch: pytest.MonkeyPatch) -> None:
    stamps = (1000 * MS, 1000 * MS, 500 * MS, 2**61, 1033 * MS, 1033 * MS, 1066 * MS)
    bus, made = served(monkeypatch, *frames(*stamps))
    assert [stamp for front_end in made for stamp in front_end.stamps] == [1000 * MS, 1033 * MS, 1066 * MS]
    assert bus.published == bus.answered == [1000 * MS, 1033 * MS, 1066 * MS]
    assert bus.refused == {"Frame: repeated stamp": 2, "Frame: reversed stamp": 1, "Frame: stamp far ahead": 1}


def test_a_camera_whose_clock_has_changed_is_heard_again(monkeypatch: pytest.MonkeyPatch) -> None:
    later, earlier = [5000 * MS, 5033 * MS], [k * 33 * MS for k in range(1, 9)]
    bus, _ = served(monkeypatch, *frames(*later, *earlier))
    assert bus.published == [*later, *earlier]
    assert bus.refused == {}


def test_another_playback_may_begin_at_any_stamp(monkeypatch: pytest.MonkeyPatch) -> None:
    first = frames(5000 * MS, 5033 * MS, run=b"run-1", replay=True)
    second = frames(0, 33 * MS, run=b"run-2", replay=True)
    bus, made = served(monkeypatch, *first, *second)
    assert [front_end.stamps for front_end in made if front_end.stamps] == [[5000 * MS, 5033 * MS], [0, 33 * MS]]
    assert bus.refused == {}
