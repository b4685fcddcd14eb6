"""The simulated robot as a process on real zenoh: a bridge's streams in real time, by hand, never beside a bridge."""

import fcntl
import json
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from omnivert.config import Config, parsed
from omnivert.drivers.image_file import frame_from_file
from omnivert.messages import Bearings, Drive, Frame, Message, Scan, Ticks
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.bus import Bus, Router
from omnivert.wire.channels import BEARINGS, DRIVE, FRAME, SCAN, TICKS
from omnivert.wire.codec import encode
from omnivert.wire.received import Received

M = TypeVar("M", bound=Message)
DEADLINE_S = 60.0  # also where the machine has to compile first
PERIOD_NS = 400_000_000  # from frame to frame
SCALE = Config().encoder.metres_per_tick


@pytest.fixture
def config(folder: Path) -> Config:
    given = {
        "bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"},
        "storage": {"path": str(folder / "store.db")},
        "camera": {"frame_rate_hz": 2.5},
    }
    return parsed(given, "the test")


@pytest.fixture
def file(config: Config, folder: Path) -> Path:
    path = folder / "config.json"
    path.write_text(json.dumps(config.model_dump(mode="json")), encoding="utf-8")
    return path


def simulator(file: Path, *more: str) -> AbstractContextManager["subprocess.Popen[bytes]"]:
    return service("simulator", file, "--world", "office", *more)


def vision(file: Path) -> AbstractContextManager["subprocess.Popen[bytes]"]:
    return service("vision", file)


@contextmanager
def service(name: str, file: Path, *more: str) -> Iterator["subprocess.Popen[bytes]"]:
    command = [sys.executable, "-P", "-m", f"services.{name}", "--config", str(file), "--supervised", *more]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.terminate()


Ears = Iterator[Received | None]


def ears(bus: Bus) -> Ears:
    """Everything that comes from now on."""
    return bus.listen(TICKS, FRAME, SCAN, BEARINGS, DRIVE, period_s=0.1, every=True)


def heard(
    listening: Ears, holds: Callable[[list[Message]], bool], while_waiting: Callable[[], None] = lambda: None
) -> list[Message]:
    """Everything that comes until it `holds` for what has come."""
    messages: list[Message] = []
    deadline = time.monotonic() + DEADLINE_S
    for received in listening:
        if received is not None:
            assert not received.replay
            messages.append(received.message)
            if holds(messages):
                return messages
        while_waiting()
        assert time.monotonic() < deadline, f"{len(messages)} messages"
    raise AssertionError("the bus was stopped")


def of(messages: list[Message], kind: type[M]) -> list[M]:
    return [message for message in messages if isinstance(message, kind)]


def test_it_gives_the_streams_of_a_bridge_in_real_time_until_its_path_ends(
    config: Config, file: Path, folder: Path
) -> None:
    path = folder / "short.toml"
    path.write_text("[[leg]]\nstraight_m = 0.15\n")
    options = ("--path", str(path), "--exit-when-done", "--wait-for", "vision")
    with Router(config), Bus(config, "test", "test") as bus, vision(file), simulator(file, *options) as robot:
        messages = heard(ears(bus), lambda found: len(of(found, Ticks)) >= 160)
        now_ns = time.monotonic_ns()
        assert bus.await_presence(lambda: ("bridge", "front") in bus.present(), DEADLINE_S)
        assert robot.wait(DEADLINE_S) == 0
    ticks, frames = of(messages, Ticks), of(messages, Frame)
    steps = np.diff([m.stamp_ns for m in ticks])
    np.testing.assert_allclose(steps, 20_000_000, atol=1)
    assert 0 <= now_ns - ticks[-1].stamp_ns < 5e9  # this host's clock, as it is now
    assert (ticks[-1].left - ticks[0].left) * SCALE == pytest.approx(0.15, abs=2 * SCALE)
    assert len(frames) > 5
    assert {(frame.stamp_ns - frames[0].stamp_ns) % PERIOD_NS for frame in frames} <= {0, 1, PERIOD_NS - 1}
    assert {m.stamp_ns for m in of(messages, Scan)} >= {frame.stamp_ns for frame in frames[:-1]}
    read = frame_from_file(frames[0].data.tobytes(), 0)
    assert (read.width_px, read.height_px) == (640, 480)
    # What the vision makes of them live are the bytes that it makes of them anywhere; as far as none came too fast.
    front_end, live = FrontEnd(config), of(messages, Bearings)
    pairs = [(frame, lines) for frame, lines in zip(frames, live, strict=False) if frame.stamp_ns == lines.stamp_ns]
    assert len(pairs) >= 3
    for frame, lines in pairs if len(pairs) == len(live) else pairs[:3]:
        assert encode(front_end.step(frame)) == encode(lines)
        assert lines.bearing_rad.size > 10


def test_commands_drive_it_and_when_they_cease_it_stops(config: Config, file: Path) -> None:
    with Router(config), Bus(config, "test", "test") as bus, simulator(file):
        heard(ears(bus), lambda found: len(of(found, Ticks)) > 5)

        def forward() -> None:
            bus.publish(DRIVE, Drive(time.monotonic_ns(), 0.2, 0.0))

        def has_driven(messages: list[Message]) -> bool:
            ticks = of(messages, Ticks)
            return len(ticks) > 1 and (ticks[-1].left - ticks[0].left) * SCALE > 0.1

        heard(ears(bus), has_driven, forward)  # the bus gives a frame, ticks or nothing ten times a second and more
        began = time.monotonic_ns()
        messages = heard(ears(bus), lambda found: stands(of(found, Ticks)))
        moving = [
            b.stamp_ns
            for a, b in zip(of(messages, Ticks)[:-1], of(messages, Ticks)[1:], strict=True)
            if a.left != b.left
        ]
        assert (moving[-1] - began) * 1e-9 < 1.5 if moving else True


def stands(ticks: list[Ticks]) -> bool:
    """The last second without a count."""
    return len(ticks) > 50 and len({(t.left, t.right) for t in ticks[-50:]}) == 1


def test_it_does_not_come_beside_a_bridge(config: Config, file: Path) -> None:
    with Router(config), Bus(config, "bridge", "front") as bridge:
        bridge.ready()
        with simulator(file) as robot:
            assert robot.wait(DEADLINE_S) == 2
            assert robot.stderr is not None
            assert b"OV402" in robot.stderr.read()


def test_a_bridge_does_not_come_beside_it(config: Config, file: Path) -> None:
    """On the bus it is a bridge with the same camera."""
    with Router(config), Bus(config, "bridge", "front") as robot:
        robot.ready()
        with service("bridge", file) as bridge:
            assert bridge.wait(DEADLINE_S) == 2
            assert bridge.stderr is not None
            assert b"OV402" in bridge.stderr.read()


# ------------------------------------------------------------------ by hand


class Terminal:
    """`omnivert drive` on a terminal of its own."""

    def __init__(self, file: Path) -> None:
        self._ours, theirs = pty.openpty()
        self._theirs = theirs
        self.before = termios.tcgetattr(self._ours)
        command = [sys.executable, "-c", "from omnivert.cli import main; main()", "drive", "--config", str(file)]
        self.process = subprocess.Popen(
            command,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        self.shown = ""

    def read(self) -> None:
        while select.select([self._ours], [], [], 0.0)[0]:
            self.shown += os.read(self._ours, 65536).decode(errors="replace")

    def until(self, holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < deadline, self.shown
            select.select([self._ours], [], [], 0.1)
            self.read()

    def types(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    def restored(self) -> bool:
        return termios.tcgetattr(self._ours) == self.before

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.fixture
def terminal(config: Config, file: Path) -> Iterator[Terminal]:
    with Router(config), Bus(config, "bridge", "front") as bus:
        bus.ready()
        opened = Terminal(file)
        try:
            yield opened
        finally:
            opened.close()


def test_keys_steer_and_the_terminal_is_given_back(config: Config, terminal: Terminal) -> None:
    with Bus(config, "test", "test") as bus:
        listening = ears(bus)  # once, before the first key: what ends is said once

        def wanted(keys: bytes, forward: int, turn: int) -> Callable[[list[Message]], bool]:
            terminal.types(keys)

            def holds(messages: list[Message]) -> bool:
                last = messages[-1]
                return isinstance(last, Drive) and (np.sign(last.forward_m_s), np.sign(last.turn_rad_s)) == (
                    forward,
                    turn,
                )

            return holds

        terminal.until(lambda: "waiting" in terminal.shown)
        assert not terminal.restored()
        for keys, forward, turn in ((b"\x1b[A", 1, 0), (b"a", 0, 1), (b"\x1b[C", 0, -1), (b"s", -1, 0), (b"q", 1, 1)):
            heard(listening, wanted(keys, forward, turn), terminal.read)
        heard(listening, wanted(b" ", 0, 0), terminal.read)
        terminal.until(lambda: "stands" in terminal.shown)
        heard(listening, wanted(b"w", 1, 0), terminal.read)
        heard(listening, wanted(b"x", 0, 0), terminal.read)  # and stops when it ends
        terminal.until(lambda: terminal.process.poll() is not None)
    assert terminal.process.returncode == 0
    assert terminal.restored()


def test_a_second_driver_is_refused(file: Path, terminal: Terminal) -> None:
    terminal.until(lambda: "waiting" in terminal.shown)
    second = Terminal(file)
    try:
        second.until(lambda: second.process.poll() is not None)
        second.read()
        assert second.process.returncode == 2
        assert "drive cannot run beside another drive" in second.shown
        assert second.restored()
    finally:
        second.close()


def test_a_signal_gives_the_terminal_back_too(terminal: Terminal) -> None:
    terminal.until(lambda: "waiting" in terminal.shown)
    assert not terminal.restored()
    terminal.process.send_signal(signal.SIGTERM)
    terminal.until(lambda: terminal.process.poll() is not None)
    assert terminal.restored()
    assert "Traceback" not in terminal.shown
