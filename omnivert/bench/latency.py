"""From a frame published to its bearings received: real router, real vision process; beside it raw zenoh."""

import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from omnivert.bench.spread import Spread
from omnivert.config import Config, parsed
from omnivert.errors import DataError
from omnivert.messages import Frame
from omnivert.wire.bus import Bus
from omnivert.wire.channels import BEARINGS, FRAME
from omnivert.wire.codec import encode
from omnivert.wire.raw import raw_rounds
from omnivert.wire.recording import Recording

START_S = 20.0  # for a service to come up on a busy machine
ROUND_S = 1.0  # a frame without an answer for so long is sent again
WARM_UP = 3


@dataclass(frozen=True, slots=True)
class Latency:
    """Durations of rounds with one frame on its way at a time."""

    frame_to_bearings: Spread
    raw_round: Spread  # the same bytes of frame there, 2 kB back, through the same router
    frame_bytes: int  # of the median frame as it is sent


def latency(recording: Recording, config: Config, frames: int, moved: Callable[[], None] = lambda: None) -> Latency:
    """Measure on a private router.

    moved   called after each frame
    raises  DataError when a service does not come up
    """
    sent = [message for _, message in islice(recording.messages(types=(Frame,)), frames) if isinstance(message, Frame)]
    with tempfile.TemporaryDirectory(prefix="omnivert-") as folder, ExitStack() as running:
        private = _private(config, Path(folder))
        file = Path(folder) / "bench.json"
        file.write_text(json.dumps(private.model_dump(mode="json")), encoding="utf-8")
        for module in ("services.router", "services.vision", "omnivert.bench.echo"):
            running.enter_context(_process(module, file))
        bus = running.enter_context(Bus(private, "bench", "bench", patience_s=START_S))
        _await(bus, {"vision", "echo"})
        rounds = list(_rounds(bus, sent, moved))
        sizes = sorted((len(encode(frame)), encode(frame)) for frame in sent)
        size, payload = sizes[len(sizes) // 2]
        raw = raw_rounds(bus, payload, len(sent))
    return Latency(Spread.of_seconds(rounds[WARM_UP:] or rounds), Spread.of_seconds(raw[WARM_UP:] or raw), size)


def _rounds(bus: Bus, frames: list[Frame], moved: Callable[[], None]) -> Iterator[float]:
    """Seconds from publishing each frame to receiving its bearings."""
    waiting = iter(frames)
    frame = next(waiting)
    listening = bus.listen(BEARINGS, period_s=ROUND_S)
    began = time.perf_counter()
    bus.publish(FRAME, frame)
    for received in listening:
        if received is not None and received.message.stamp_ns == frame.stamp_ns:
            yield time.perf_counter() - began
            moved()
            following = next(waiting, None)
            if following is None:
                return
            frame = following
        elif received is not None:
            continue
        else:
            frame = dataclasses.replace(frame, stamp_ns=frame.stamp_ns + 1)  # vision takes no stamp twice
        began = time.perf_counter()
        bus.publish(FRAME, frame)


def _private(config: Config, folder: Path) -> Config:
    given = config.model_dump(mode="json")
    given["bus"]["endpoint"] = f"unixsock-stream/{folder}/bus.sock"
    given["bus"]["listen"] = []
    return parsed(given, "the bench")


def _await(bus: Bus, services: set[str]) -> None:
    if not bus.await_presence(lambda: services <= {name for name, _ in bus.present()}, START_S):
        lacking = ", ".join(sorted(services - {name for name, _ in bus.present()}))
        raise DataError("OV422", f"{lacking} did not come up within {START_S:.0f} s", help="omnivert demo")


@contextmanager
def _process(module: str, config: Path) -> Iterator[None]:
    """A process that ends with the block."""
    command = [sys.executable, "-m", module, "--config", str(config)]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
