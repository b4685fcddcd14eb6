"""From a frame published to its bearings received: real router, real vision process; beside it raw zenoh."""

import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from omnivert.bench.processes import START_S, await_services, private_bus, process
from omnivert.bench.spread import Spread
from omnivert.config import Config
from omnivert.messages import Frame
from omnivert.wire.bus import Bus
from omnivert.wire.channels import BEARINGS, FRAME
from omnivert.wire.codec import encode
from omnivert.wire.raw import raw_rounds
from omnivert.wire.recording import Recording

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
        private, file = private_bus(config, Path(folder))
        for module in ("services.router", "services.vision", "omnivert.bench.echo"):
            running.enter_context(process(module, file))
        bus = running.enter_context(Bus(private, "bench", "bench", patience_s=START_S))
        await_services(bus, {"vision", "echo"})
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
