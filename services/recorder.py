"""Everything on the robot's bus into a recording, sensors and results; what is written survives a `kill -9`."""

import argparse
import logging
import sys
import time
from collections import Counter
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Frame, Health, Scan, Ticks
from omnivert.wire.bus import Bus
from omnivert.wire.channels import CHANNELS
from omnivert.wire.received import Received
from omnivert.wire.recording import RecordingWriter
from omnivert.wire.sources import Admission, Sources
from services import _start

_log = logging.getLogger("omnivert.recorder")
_CHUNK_S = 1.0


def run(bus: Bus, config: Config, path: Path) -> Counter[str]:
    """Records until the bus stops; returns how many messages of each stream, health aside, were written.

    raises  DataError when the file cannot be written any further; what was written before is good
    """
    sources = Sources(bus.alive)
    written: Counter[str] = Counter()
    try:
        with RecordingWriter(path, config) as writer:
            closed_s = time.monotonic()
            for received in bus.listen(*CHANNELS, period_s=_CHUNK_S, every=True):
                if received is not None and admitted(bus, sources, received):
                    writer.write(received.key, received.message)
                    bus.done(received)
                    if not isinstance(received.message, Health):
                        written[received.channel.stream] += 1
                if time.monotonic() - closed_s >= _CHUNK_S:
                    writer.flush()
                    closed_s = time.monotonic()
        _log.info("saved %s: %d messages", path, sum(writer.counts.values()))
    except OSError as error:
        raise DataError(
            "OV304",
            f"{path} cannot be written any further" if path.exists() else f"cannot write {path}",
            f"{error.strerror or error}; what was recorded before is good",
            "free some space, or name another disk",
        ) from error
    return written


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
        run(bus, config, unused(given.output))
    except DataError as error:  # the end of it, and nothing that another start would mend
        _start.refusal("recorder", error)


def main() -> int:
    return _start.start("recorder", _run, _arguments)


if __name__ == "__main__":
    sys.exit(main())
