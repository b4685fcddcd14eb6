"""What the vision service does around its front end; the front end is replaced by one that only takes notes."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest

from omnivert.config import Config
from omnivert.messages import Bearings, Frame, Message, PixelFormat
from omnivert.wire.channels import FRAME, Channel
from omnivert.wire.received import Received
from services import vision

MS = 1_000_000


class NotingFrontEnd:
    """Bearings without lines; remembers the stamps of the frames that it was given.

    says  the reasons of the frames with these stamps; they have a line where the text begins with "lines"
    """

    made: list["NotingFrontEnd"]
    says: ClassVar[dict[int, tuple[str, ...]]] = {}

    def __init__(self, config: Config) -> None:
        self.stamps: list[int] = []
        self.made.append(self)

    def step(self, frame: Frame) -> Bearings:
        self.stamps.append(frame.stamp_ns)
        reasons = self.says.get(frame.stamp_ns, ())
        one = np.full(int(any(reason.startswith("lines") for reason in reasons)), 0.5)
        whole = one.astype(np.int64), one, one, one.astype(np.int32), one.astype("f4")
        return Bearings(frame.stamp_ns, *whole, reasons=reasons)


class QuietBus:
    """Gives what it was made with, and takes down what the service says."""

    def __init__(self, *given: Received) -> None:
        self.given = given
        self.published: list[int] = []
        self.refused: dict[str, int] = {}
        self.answered: list[int] = []
        self.notes: dict[str, str | None] = {}
        self.noted: list[str | None] = []  # about frames, as it came

    def listen(self, channel: Channel) -> Iterator[Received | None]:
        yield None
        yield from self.given

    def publish(self, channel: Channel, message: Message, cause: Received) -> None:
        self.published.append(message.stamp_ns)

    def refuse(self, reason: str, times: int = 1) -> None:
        self.refused[reason] = self.refused.get(reason, 0) + times

    def note(self, text: str | None, about: str) -> None:
        self.notes[about] = text
        if about == "frames":
            self.noted.append(text)

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


S = 10**9
LOST, SLOW = "ring not in the picture", "lines are 12 of 30"


def test_the_reasons_of_the_last_frames_are_counted_in_a_note_and_gone_with_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    says = {k * S // 2: (LOST, SLOW) if k % 2 else (LOST,) for k in range(1, 7)}
    monkeypatch.setattr(NotingFrontEnd, "says", says)
    bus, _ = served(monkeypatch, *frames(*(k * S // 2 for k in range(40))))
    assert bus.noted[0] is None
    assert bus.noted[3] == f"last 7 frames: {LOST} (6), {SLOW} (3)"
    assert bus.noted[11] == f"last 21 frames: {LOST} (5), {SLOW} (2)"
    assert bus.noted[14] is None
    assert bus.notes == {"frames": None, "ring": None, "mirror": None}


def test_frames_without_a_line_are_counted_by_their_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    says = {1 * MS: (LOST,), 2 * MS: (LOST, "no lines"), 3 * MS: (SLOW,)}
    monkeypatch.setattr(NotingFrontEnd, "says", says)
    bus, _ = served(monkeypatch, *frames(*(k * MS for k in range(5))))
    assert bus.refused == {LOST: 2, "no lines": 1}


def test_another_playback_begins_without_the_notes_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NotingFrontEnd, "says", {k * MS: (LOST,) for k in range(3)})
    first, second = frames(0, 1 * MS, 2 * MS, replay=True), frames(9 * MS, run=b"run-2", replay=True)
    assert served(monkeypatch, *first)[0].notes["frames"] is not None
    assert served(monkeypatch, *first, *second)[0].notes["frames"] is None
