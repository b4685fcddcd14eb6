"""Frames in, tracked bearings out."""

import argparse
import sys
from collections import Counter

from omnivert.config import Config
from omnivert.messages import Frame
from omnivert.timeline import LoneStream
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.bus import Bus
from omnivert.wire.channels import BEARINGS, FRAME
from omnivert.wire.sources import Admission, Sources
from services import _start


def run(bus: Bus, config: Config, arguments: argparse.Namespace | None = None) -> None:
    """Publishes until the bus stops; a frame whose stamp does not fit the others moves no track."""
    front_end, frames = FrontEnd(config), LoneStream(Frame, config.timeline)
    sources = Sources(bus.alive)
    for received in bus.listen(FRAME):
        if received is None or not isinstance(received.message, Frame):
            continue
        match sources.admission(received):
            case Admission.REFUSED:
                bus.refuse(f"{received.key}: from another source than the one that is heard")
                continue
            case Admission.FRESH:
                front_end, frames = FrontEnd(config), LoneStream(Frame, config.timeline)
        refused = Counter(frames.refused)
        believed = frames.push(received.message)
        for reason, times in (frames.refused - refused).items():
            bus.refuse(reason, times)
        for frame in believed:
            if isinstance(frame, Frame):
                bus.publish(BEARINGS, front_end.step(frame), cause=received)
        if believed:
            bus.done(received)


def main() -> int:
    return _start.start("vision", run)


if __name__ == "__main__":
    sys.exit(main())
