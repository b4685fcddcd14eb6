"""Everything on the robot's bus into a recording, sensors and results; what is written survives a `kill -9`."""

import argparse
import logging
import sys
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Frame, Health, Scan, Ticks
from omnivert.wire.bus import Bus
from omnivert.wire.channels import CHANNELS
from omnivert.wire.envelope import missing_between
from omnivert.wire.received import Received
from omnivert.wire.sources import Admission, Sources
from services import _start
from services._parts import Parts, is_split

_log = logging.getLogger("omnivert.recorder")
_CHUNK_S = 1.0
_MAX_PUBLISHERS = 1000


@dataclass(slots=True)
class Recorded:
    """What a recorder has written so far.

    paths     of its files, in order
    bytes     of all of them
    messages  of each stream, health aside
    lost      messages that were sent and never came here, or came faster than the disk takes them
    """

    paths: list[Path] = field(default_factory=list)
    bytes: int = 0
    messages: Counter[str] = field(default_factory=Counter)
    lost: int = 0


def run(bus: Bus, config: Config, path: Path, told: Callable[[Recorded], None] = lambda so_far: None) -> Recorded:
    """Records until the bus stops.

    told    called once a second with what has been written so far
    raises  DataError when the file cannot be written any further; what was written before is good
    """
    sources = Sources(bus.alive)
    recorded, numbers = Recorded(), _Numbers()
    try:
        with Parts(path, config) as parts:
            recorded.paths = parts.paths
            closed_s = time.monotonic()
            for received in bus.listen(*CHANNELS, period_s=_CHUNK_S, every=True):
                if received is not None and admitted(bus, sources, received):
                    parts.put(received.key, received.message, received.data)
                    bus.done(received)
                    if not isinstance(received.message, Health):
                        recorded.messages[received.channel.stream] += 1
                        recorded.lost += numbers.missing_before(received)
                if time.monotonic() - closed_s >= _CHUNK_S:
                    parts.flush()
                    recorded.bytes = parts.size
                    if recorded.lost:
                        bus.note(f"{recorded.lost} messages are lost: the disk or the link is too slow", "lost")
                    told(recorded)
                    closed_s = time.monotonic()
        recorded.bytes = parts.size
        files = ", ".join(map(str, parts.paths))
        _log.info("saved %s: %d messages, %d lost", files, recorded.messages.total(), recorded.lost)
    except OSError as error:
        because, file = error.strerror or str(error), recorded.paths[-1] if recorded.paths else path
        if not file.exists():
            what, help = f"cannot write {file}", "name another place"
        else:
            what, help = f"{file} cannot be written any further", "free some space, or name another disk"
            because = f"{because}; what was recorded before is good"
        raise DataError("OV304", what, because, help) from error
    return recorded


class _Numbers:
    """Tells from the numbers that each publisher gives its messages how many have not come."""

    def __init__(self) -> None:
        self._last: OrderedDict[tuple[str, bytes], int] = OrderedDict()

    def missing_before(self, received: Received) -> int:
        """How many between the one before it and this one."""
        who = (received.key, received.publisher)
        last = self._last.pop(who, received.sequence - 1)
        missing = missing_between(last, received.sequence)
        self._last[who] = last if missing is None else max(last, received.sequence)
        if len(self._last) > _MAX_PUBLISHERS:
            self._last.popitem(last=False)
        return missing or 0


def admitted(bus: Bus, sources: Sources, received: Received) -> bool:
    """Whether it belongs to the drive: of sensors, what vision and calibration take from them; counted when not."""
    if not isinstance(received.message, Frame | Ticks | Scan):
        return True
    if sources.admission(received) is not Admission.REFUSED:
        return True
    bus.refuse(f"{received.key}: from another source than the one that is heard")
    return False


def unused(path: Path) -> Path:
    """`path`, or the same with a number when there is such a file: a recorder that comes back overwrites nothing."""
    numbered = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in range(2, 10_000))
    return path if not path.exists() else next(name for name in numbered if not name.exists())


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", type=Path, required=True)


def _run(bus: Bus, config: Config, given: argparse.Namespace) -> None:
    try:
        run(bus, config, given.output if is_split(config) else unused(given.output))
    except DataError as error:  # the end of it, and nothing that another start would mend
        _start.refusal("recorder", error)


def main() -> int:
    return _start.start("recorder", _run, _arguments)


if __name__ == "__main__":
    sys.exit(main())
