"""Frames in, tracked bearings out."""

import argparse
import sys
from collections import Counter

from omnivert.config import Config
from omnivert.messages import Bearings, Frame
from omnivert.timeline import LoneStream
from omnivert.vision.account import ABOUT, Account, is_unusable
from omnivert.vision.frontend import FrontEnd
from omnivert.vision.warm_up import warm_up
from omnivert.wire.bus import Bus
from omnivert.wire.channels import BEARINGS, FRAME
from omnivert.wire.sources import Admission, Sources
from services import _start

_PERIOD_NS = 10**9


def run(bus: Bus, config: Config, arguments: argparse.Namespace | None = None) -> None:
    """Publishes until the bus stops; a frame whose stamp does not fit the others moves no track."""
    warm_up(config)  # before others are told that this service is here, or their first frames would wait for it
    front_end, frames, report = FrontEnd(config), LoneStream(Frame, config.timeline), _Report(bus, config)
    sources = Sources(bus.alive)
    for received in bus.listen(FRAME):
        if received is None or not isinstance(received.message, Frame):
            continue
        match sources.admission(received):
            case Admission.REFUSED:
                bus.refuse(f"{received.key}: from another source than the one that is heard")
                continue
            case Admission.FRESH:
                front_end, frames, report = FrontEnd(config), LoneStream(Frame, config.timeline), _Report(bus, config)
        refused = Counter(frames.refused)
        believed = frames.push(received.message)
        for reason, times in (frames.refused - refused).items():
            bus.refuse(reason, times)
        for frame in believed:
            if isinstance(frame, Frame):
                bearings = front_end.step(frame)
                bus.publish(BEARINGS, bearings, cause=received)
                report.step(bearings)
        if believed:
            bus.done(received)


class _Report:
    """Puts into the health message what the frames say: at the first one, then once a second of their own time."""

    def __init__(self, bus: Bus, config: Config) -> None:
        self._bus, self._account = bus, Account(config)
        self._told_ns: int | None = None

    def step(self, bearings: Bearings) -> None:
        self._account.step(bearings)
        if is_unusable(bearings):
            for reason in bearings.reasons:
                self._bus.refuse(reason)
        now = bearings.stamp_ns
        if self._told_ns is None or abs(now - self._told_ns) >= _PERIOD_NS:
            self._told_ns = now
            notes = self._account.notes()
            for about in ABOUT:
                self._bus.note(notes.get(about), about)


def main() -> int:
    return _start.start("vision", run)


if __name__ == "__main__":
    sys.exit(main())
