"""What recording costs, and how well a playback keeps its pace: raw frames through real processes, to a real disk."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.bench.processes import START_S, await_services, private_bus, process
from omnivert.bench.spread import Spread
from omnivert.bench.yardstick import sobel_pair_s
from omnivert.config import Config, parsed
from omnivert.errors import DataError
from omnivert.formats.recut import cut
from omnivert.messages import Frame, Health, PixelFormat, Playback, Ticks
from omnivert.wire.bus import Bus
from omnivert.wire.channels import FRAME, HEALTH, PLAYBACK, TICKS
from omnivert.wire.recording import Recording

WIDTH, HEIGHT, FRAMES_HZ, TICKS_HZ = 640, 480, 30, 100
PATIENCE_S = 60.0  # for a disk that has fallen behind
_HURRY_S = 0.02
_PICTURES = 30  # distinct ones
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class RecordingTimes:
    """
    frames, ticks    sent
    drive_s          that they would take live
    lost             of them not in the file
    file_bytes       size of the recording
    cpu_s            that the recorder took for all of it
    cpu_share        of one core, live
    memory_mb        of the recorder: its lowest in the second and in the last tenth of the drive, which what only waits
                     for the disk does not raise, and its highest
    sobel_pairs      time of the recorder for one frame, in pairs of Sobel filters over it
    pace             error of each message of a playback at speed 1, against its stamp
    sleep            the same error of a process that does nothing but sleep until then
    """

    frames: int
    ticks: int
    drive_s: float
    lost: int
    file_bytes: int
    cpu_s: float
    cpu_share: float
    memory_mb: tuple[float, float, float]
    sobel_pairs: float
    pace: Spread
    sleep: Spread

    def json(self) -> dict[str, Any]:
        body = {name: getattr(self, name) for name in self.__slots__}
        return {**body, "pace": self.pace.json(), "sleep": self.sleep.json()}


def recording_times(
    config: Config, folder: Path, seconds: float, speed: float, play_s: float, moved: Callable[[], None] = lambda: None
) -> RecordingTimes:
    """Records a drive that is sent `speed` times as fast as live, and plays the beginning of it.

    folder  where the recording is written for that time
    moved   called after each second of the drive, and of the playback
    raises  DataError when a service does not come up, or the disk has no room for it
    """
    _check_room(folder, seconds)
    pictures = _pictures()
    with tempfile.TemporaryDirectory(prefix="omnivert-bench-", dir=folder) as there, ExitStack() as running:
        bus_folder = running.enter_context(tempfile.TemporaryDirectory(prefix="omnivert-"))  # a socket's path is short
        private, file = private_bus(_rig(config), Path(bus_folder))
        running.enter_context(process("services.router", file))
        path = Path(there) / "drive.mcap"
        with process("services.recorder", file, "--output", str(path)) as recorder, Bus(private, "bridge", "x") as bus:
            await_services(bus, {"recorder"})
            began_s = _cpu_s(recorder.pid)
            memory_mb = _sent(bus, pictures, seconds, speed, recorder.pid, moved)
            frames, ticks = round(seconds * FRAMES_HZ), round(seconds * TICKS_HZ)
            _await_heard(bus, frames, ticks)
            cpu_s = _cpu_s(recorder.pid) - began_s
        recording = Recording(path)
        kept = recording.counts[FRAME.key(private)] + recording.counts[TICKS.key(private)]
        file_bytes = path.stat().st_size
        part = Path(there) / "part.mcap"  # to open hours for a few seconds would be waited for
        cut(recording, part, None, play_s)
        pace = Spread.of_seconds(_paced(private, file, part, moved))
    sobel_s = float(np.median([sobel_pair_s(picture) for picture in pictures]))
    return RecordingTimes(
        frames=frames,
        ticks=ticks,
        drive_s=seconds,
        lost=frames + ticks - kept,
        file_bytes=file_bytes,
        cpu_s=cpu_s,
        cpu_share=cpu_s / seconds,
        memory_mb=_memory_of(memory_mb),
        sobel_pairs=cpu_s / frames / sobel_s,
        pace=pace,
        sleep=Spread.of_seconds(_slept(min(play_s, seconds))),
    )


# ------------------------------------------------------------------ the drive


def _rig(config: Config) -> Config:
    given = config.model_dump(mode="json")
    given["camera"] |= {"width_px": WIDTH, "height_px": HEIGHT, "frame_rate_hz": float(FRAMES_HZ)}
    given["ring"] = {}
    return parsed(given, "the bench")


def _pictures() -> list[NDArray[np.uint8]]:
    """Bars that turn about the middle of a ring, under the noise of a sensor: they compress about as pictures do."""
    noise = np.random.default_rng(0)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    radius, angle = np.hypot(u - WIDTH / 2, v - HEIGHT / 2), np.arctan2(v - HEIGHT / 2, u - WIDTH / 2)
    inside = (radius > 0.13 * HEIGHT) & (radius < 0.47 * HEIGHT)
    pictures = []
    for turn in np.arange(_PICTURES) * 0.01:
        bars = np.where(np.sin(12.0 * (angle + turn)) > 0.0, 160.0, 90.0)
        pictures.append(np.where(inside, bars, 15.0) + noise.normal(0.0, 2.0, v.shape))
    return [np.clip(picture, 0, 255).astype(np.uint8) for picture in pictures]


def _messages(pictures: list[NDArray[np.uint8]], seconds: float) -> Iterator[Frame | Ticks]:
    data = [picture.reshape(-1) for picture in pictures]
    frame = tick = 0
    while frame < round(seconds * FRAMES_HZ) or tick < round(seconds * TICKS_HZ):
        frame_ns, tick_ns = frame * _NS // FRAMES_HZ, tick * _NS // TICKS_HZ
        if tick_ns <= frame_ns and tick < round(seconds * TICKS_HZ):
            yield Ticks(tick_ns, tick, tick)
            tick += 1
        else:
            yield Frame(frame_ns, PixelFormat.GREY8, WIDTH, HEIGHT, data[frame % len(data)])
            frame += 1


def _sent(
    bus: Bus, pictures: list[NDArray[np.uint8]], seconds: float, speed: float, pid: int, moved: Callable[[], None]
) -> list[float]:
    """Sends the drive; returns the recorder's memory at each frame, MB."""
    due_s, before_s, told = time.monotonic(), 0.0, 0
    memory_mb: list[float] = []
    for message in _messages(pictures, seconds):
        at_s = message.stamp_ns / _NS
        # Who has been held up does not hurry: no robot does, and a burst would be lost on the way.
        due_s = max(due_s + (at_s - before_s) / speed, time.monotonic() - _HURRY_S)
        before_s = at_s
        bus.wait_stopped(max(due_s - time.monotonic(), 0.0))
        if bus.stopped:
            raise KeyboardInterrupt
        bus.publish(FRAME if isinstance(message, Frame) else TICKS, message)
        if isinstance(message, Frame):
            memory_mb.append(_memory_mb(pid))
        while told < at_s:
            told += 1
            moved()
    return memory_mb


def _memory_of(samples_mb: list[float]) -> tuple[float, float, float]:
    """Lowest in the second and in the last tenth, and highest."""
    tenth = max(len(samples_mb) // 10, 1)
    return min(samples_mb[tenth : 2 * tenth] or samples_mb), min(samples_mb[-tenth:]), max(samples_mb)


def _await_heard(bus: Bus, frames: int, ticks: int) -> None:
    """Until the recorder has heard, or missed, all of it; what it has heard it writes before it ends."""
    keys = {FRAME.key(bus.config): frames, TICKS.key(bus.config): ticks}
    deadline_s = time.monotonic() + PATIENCE_S
    for received in bus.listen(HEALTH, period_s=1.0):
        match received:
            case None:
                pass
            case _ if isinstance(received.message, Health) and received.message.service == "recorder":
                told = received.message
                if all(told.received.get(key, 0) + told.gaps.get(key, 0) >= sent for key, sent in keys.items()):
                    return
        if time.monotonic() > deadline_s:
            return


def _check_room(folder: Path, seconds: float) -> None:
    needs = seconds * FRAMES_HZ * WIDTH * HEIGHT * 1.1
    disk = os.statvfs(folder)
    if disk.f_bavail * disk.f_frsize < needs:
        has = f"{seconds:.0f} s of frames need {needs / 1e9:.1f} GB, it has {disk.f_bavail * disk.f_frsize / 1e9:.1f}"
        raise DataError("OV322", f"there is no room in {folder}", has, "fewer --minutes, or --folder on another disk")


def _cpu_s(pid: int) -> float:
    """Time that a process has run so far, on all cores."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


# ------------------------------------------------------------------ the playback


def _paced(config: Config, file: Path, path: Path, moved: Callable[[], None]) -> list[float]:
    """How far each message of a playback at speed 1 was sent from when its stamp says; s."""
    sent_ns: list[int] = []
    stamps_ns: list[int] = []
    with Bus(config, "listener", "bench", patience_s=START_S) as bus:
        heard = bus.listen(FRAME, TICKS, PLAYBACK, period_s=1.0, every=True)
        with process("services.player", file, "--recording", str(path), "--wait-for", "listener"):
            deadline_s, told = time.monotonic() + PATIENCE_S, 1
            for received in heard:
                if time.monotonic() > deadline_s or bus.stopped:
                    break
                match received:
                    case None:
                        pass
                    case _ if isinstance(received.message, Playback):
                        if received.message.finished:
                            break
                    case _:
                        deadline_s = time.monotonic() + PATIENCE_S
                        sent_ns.append(received.sent_ns)
                        stamps_ns.append(received.message.stamp_ns)
                        while told * _NS <= received.message.stamp_ns:
                            told += 1
                            moved()
    if not sent_ns:
        raise DataError("OV420", "the playback has said nothing", f"not within {PATIENCE_S:g} s", "try it again")
    return _errors_s(np.array(sent_ns), np.array(stamps_ns))


def _slept(seconds: float) -> list[float]:
    """The same of this process alone, which sleeps from message to message of such a drive."""
    stamps_ns = np.arange(round(seconds * TICKS_HZ)) * (_NS // TICKS_HZ)
    began_s, sent_ns = time.monotonic(), []
    for stamp_ns in stamps_ns.tolist():
        time.sleep(max(began_s + stamp_ns / _NS - time.monotonic(), 0.0))
        sent_ns.append(time.monotonic_ns())
    return _errors_s(np.array(sent_ns), stamps_ns)


def _errors_s(sent_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64]) -> list[float]:
    """Distances from the time that most of them keep."""
    late_ns = (sent_ns - sent_ns[0]) - (stamps_ns - stamps_ns[0])
    return [float(late_s) for late_s in np.abs(late_ns - np.median(late_ns)) / _NS]
