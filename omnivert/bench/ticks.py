"""From the last byte of an encoder's line to its ticks received: real router, real bridge, a pseudo-terminal as port.

Once without a camera, and once while the same bridge reads one at 30 Hz, whose frames another process receives.
"""

import os
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

import cv2

from omnivert.bench.processes import START_S, await_services, private_bus, process
from omnivert.bench.spread import Spread
from omnivert.config import Config, parsed
from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.sample import Sample
from omnivert.errors import DataError
from omnivert.messages import Frame, Health, PixelFormat, Ticks
from omnivert.vision.image import grey_from_frame
from omnivert.wire.bus import Bus
from omnivert.wire.channels import FRAME, HEALTH, TICKS
from omnivert.wire.codec import encode
from omnivert.wire.raw import raw_rounds
from omnivert.wire.recording import Recording

LINE_S = 0.01  # a line every 10 ms
CAMERA_HZ = 30.0
WARM_UP = 50  # lines
LOST_S = 2.0  # after that no ticks come any more


@dataclass(frozen=True, slots=True)
class TickTimes:
    """Durations from a line's last byte, written, to its ticks, received."""

    alone: Spread
    with_camera: Spread
    raw_round: Spread  # as many bytes as ticks have, there and 2 kB back through the same router, beside the camera
    longest_ms: float  # with the camera
    frames: int  # that the camera gave meanwhile
    lost: int  # lines whose ticks never came, after the first that did; in both runs


def tick_times(recording: Recording, config: Config, lines: int, moved: Callable[[], None] = lambda: None) -> TickTimes:
    """Measure on a private router, with frames of this recording.

    lines   to send in each of the two runs
    moved   called after each line
    raises  DataError when a service does not come up, or no ticks come
    """
    alone = _run(None, config, lines, moved)
    camera = _run(recording, config, lines, moved)
    return TickTimes(
        alone=Spread.of_seconds(alone.took_s),
        with_camera=Spread.of_seconds(camera.took_s),
        raw_round=Spread.of_seconds(camera.raw_s),
        longest_ms=1e3 * max(camera.took_s),
        frames=camera.frames,
        lost=alone.lost + camera.lost,
    )


@dataclass(frozen=True, slots=True)
class _Run:
    """One run's durations in seconds, after the first few."""

    took_s: list[float]
    raw_s: list[float]
    lost: int
    frames: int


def _run(camera: Recording | None, config: Config, lines: int, moved: Callable[[], None]) -> _Run:
    with tempfile.TemporaryDirectory(prefix="omnivert-") as name, ExitStack() as running:
        folder = Path(name)
        master, port = running.enter_context(_terminal())
        given = config.model_dump(mode="json")
        given["encoder"] |= {"protocol": "omnivert", "port": port, "swap_sides": False, "left_sign": 1, "right_sign": 1}
        given["camera"] |= {"source": str(folder / "images"), "frame_rate_hz": CAMERA_HZ}
        private, file = private_bus(parsed(given, "the bench"), folder)
        if camera is not None:
            _write_images(camera, folder / "images", round(CAMERA_HZ * (lines * LINE_S + START_S)))
        for module in ("services.router", "services.bridge", "omnivert.bench.sink", "omnivert.bench.echo"):
            running.enter_context(process(module, file))
        bus = running.enter_context(Bus(private, "bench", "bench", patience_s=START_S))
        await_services(bus, {"bridge", "sink", "echo"})
        took = dict(_rounds(bus, master, lines, moved))
        if len(took) <= WARM_UP:
            raise DataError("OV422", "hardly any ticks came over the bus", help="omnivert demo")
        raw = raw_rounds(bus, encode(Ticks(0, lines, lines)), lines)
        frames = _published(bus, private) if camera is not None else 0
    return _Run(list(took.values())[WARM_UP:], raw[WARM_UP:] or raw, lines - min(took) - len(took), frames)


def _rounds(bus: Bus, master: int, lines: int, moved: Callable[[], None]) -> Iterator[tuple[int, float]]:
    """Writes a line every `LINE_S`, its number as count, and takes the time until that number comes; number, s."""
    written_s: dict[int, float] = {}
    done = threading.Event()

    def write() -> None:
        due_s = time.perf_counter()
        for number in range(lines):
            line = line_from_sample(Sample(round(time.monotonic() * 1e6) % 2**32, number, number))
            written_s[number] = time.perf_counter()
            os.write(master, line)
            due_s += LINE_S
            if done.wait(max(due_s - time.perf_counter(), 0.0)):
                return

    stream = bus.listen(TICKS, period_s=0.1)
    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    heard_s, heard = time.perf_counter(), False
    for received in stream:
        now_s = time.perf_counter()
        if received is not None and isinstance(received.message, Ticks):
            heard_s, heard = now_s, True
            yield received.message.left, now_s - written_s[received.message.left]
            moved()
            if received.message.left == lines - 1:
                break
        elif now_s - heard_s > (LOST_S if heard else START_S):
            break
    done.set()
    writer.join()


def _published(bus: Bus, config: Config) -> int:
    """Frames that the bridge has published, by its next health message."""
    key = FRAME.key(config)
    for received in bus.listen(HEALTH, period_s=LOST_S):
        if received is None:
            return 0
        if isinstance(received.message, Health) and received.message.service == "bridge":
            return received.message.published.get(key, 0)
    return 0


def _write_images(recording: Recording, folder: Path, number: int) -> None:
    """The camera's folder: the recording's frames over and over; those after the first round are links."""
    hidden = folder.with_suffix(".new")
    hidden.mkdir()
    files = []
    for k, frame in enumerate(islice(_frames(recording), 100)):
        files.append(hidden / f"{k}.{_suffix(frame)}")
        if frame.format in (PixelFormat.JPEG, PixelFormat.PNG):
            files[-1].write_bytes(frame.data.tobytes())
        else:
            cv2.imwrite(str(files[-1]), grey_from_frame(frame))
    for k, file in zip(range(len(files), number), cycle(files), strict=False):
        os.link(file, hidden / f"{k}{file.suffix}")
    hidden.rename(folder)


def _frames(recording: Recording) -> Iterator[Frame]:
    return (message for _, message in recording.messages(types=(Frame,)) if isinstance(message, Frame))


def _suffix(frame: Frame) -> str:
    return "png" if frame.format is PixelFormat.PNG else "jpg"


@contextmanager
def _terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: what to write to, and its name as a port."""
    master, slave = os.openpty()
    try:
        tty.setraw(master)
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)
