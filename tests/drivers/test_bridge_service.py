"""The bridge on a real bus: camera and encoder each on its own, whatever happens to the other."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.config import Config, parsed
from omnivert.drivers.device import Lost
from omnivert.drivers.newest import Newest
from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.sample import Sample
from omnivert.errors import UseError
from omnivert.messages import Frame, Health, Message, Ticks
from omnivert.pictures.notes import is_harmless
from omnivert.wire import rivals
from omnivert.wire.bus import Bus, Received, Router
from omnivert.wire.channels import FRAME, HEALTH, TICKS
from services import bridge
from tests.processes import own

PROJECT = Path(__file__).resolve().parents[2]
PICTURE = np.random.default_rng(3).integers(0, 256, (48, 64), np.uint8)


@pytest.fixture
def config(tmp_path: Path) -> Config:
    """Neither device is there yet."""
    return parsed(
        {
            "bus": {"endpoint": f"unixsock-stream/{tmp_path / 'z.sock'}"},
            "encoder": {"port": str(tmp_path / "ttyUSB0"), "reopen_s": 0.02, "silent_after_s": 0.3},
            "camera": {
                "source": str(tmp_path / "images"),
                "frame_rate_hz": 20.0,
                "width_px": 64,
                "height_px": 48,
                "reopen_s": 0.02,
            },
            "ring": {"center_px": [32, 24], "r_min_px": 5.0, "r_max_px": 22.0},
        },
        "",
    )


class Encoder:
    """A device that can be plugged in, and sends a line whenever it is asked to."""

    def __init__(self, port: str) -> None:
        self._port = Path(port)
        self._ends: tuple[int, int] | None = None
        self._numbers = count()

    def plug_in(self) -> None:
        self._ends = os.openpty()
        tty.setraw(self._ends[0])
        self._port.symlink_to(os.ttyname(self._ends[1]))

    def pull_out(self) -> None:
        self._port.unlink(missing_ok=True)
        for end in self._ends or ():
            os.close(end)
        self._ends = None

    def send(self) -> None:
        if self._ends is not None:
            k = next(self._numbers)
            os.write(self._ends[0], line_from_sample(Sample(20_000 * k, k, 2 * k)))


@pytest.fixture
def encoder(config: Config) -> Iterator[Encoder]:
    device = Encoder(config.encoder.port)
    yield device
    device.pull_out()


def show_images(config: Config, number: int, picture: np.ndarray = PICTURE) -> None:
    """The camera appears, all at once."""
    hidden = Path(f"{config.camera.source}.hidden")
    hidden.mkdir()
    for k in range(number):
        cv2.imwrite(str(hidden / f"{k}.jpg"), picture)
    hidden.rename(config.camera.source)


class Bridged:
    """A bridge that begins when told to, and another's door to the bus."""

    def __init__(self, config: Config, bus: Bus, other: Bus) -> None:
        self._bus = bus
        self.other = other
        self.thread = threading.Thread(target=bridge.run, args=(bus, config), daemon=True)

    def begin(self) -> None:
        self.thread.start()

    def end(self) -> None:
        self._bus.stop()
        self.thread.join(10.0)
        assert not self.thread.is_alive()


@pytest.fixture
def bridged(config: Config) -> Iterator[Bridged]:
    with Router(config), Bus(config, "bridge", "front") as bus, Bus(config, "vision", "front") as other:
        pair = Bridged(config, bus, other)
        yield pair
        pair.end()


def heard(
    stream: Iterator[Received | None], is_it: Callable[[Message], bool], again: Callable[[], None] = lambda: None
) -> Message:
    """The first message that is the one waited for; `again` is done while it is not there."""
    deadline = time.monotonic() + 20.0
    for received in stream:
        again()
        if received is not None and is_it(received.message):
            return received.message
        assert time.monotonic() < deadline, "it has not come"
    raise AssertionError("the bus has stopped")


def note(text: str) -> Callable[[Message], bool]:
    return lambda message: isinstance(message, Health) and any(text in said for said in message.notes)


def no_note(text: str) -> Callable[[Message], bool]:
    return lambda m: isinstance(m, Health) and m.service == "bridge" and not any(text in said for said in m.notes)


def is_frame(message: Message) -> bool:
    return isinstance(message, Frame)


def is_ticks(message: Message) -> bool:
    return isinstance(message, Ticks)


def test_ticks_flow_without_a_camera_and_health_names_it(bridged: Bridged, encoder: Encoder, config: Config) -> None:
    stream = bridged.other.listen(TICKS, FRAME, HEALTH, period_s=0.02)
    encoder.plug_in()
    bridged.begin()
    ticks = heard(stream, is_ticks, encoder.send)
    assert isinstance(ticks, Ticks)
    assert ticks.right == 2 * ticks.left
    assert abs(ticks.stamp_ns - time.monotonic_ns()) < 10 * 10**9
    heard(stream, note("images is not there"), encoder.send)
    show_images(config, 2)
    heard(stream, is_frame, encoder.send)
    heard(stream, no_note("images is not there"), encoder.send)


def test_frames_flow_without_an_encoder_and_health_names_it(bridged: Bridged, config: Config) -> None:
    stream = bridged.other.listen(TICKS, FRAME, HEALTH, period_s=0.02)
    show_images(config, 3)
    bridged.begin()
    frame = heard(stream, is_frame)
    assert isinstance(frame, Frame)
    assert frame.data.tobytes() == (Path(config.camera.source) / "0.jpg").read_bytes()
    heard(stream, note("ttyUSB0 does not open: No such file or directory"))


def test_an_encoder_pulled_out_comes_back_while_frames_go_on(
    bridged: Bridged, encoder: Encoder, config: Config
) -> None:
    stream = bridged.other.listen(TICKS, FRAME, HEALTH, period_s=0.02)
    show_images(config, 400)
    encoder.plug_in()
    bridged.begin()
    heard(stream, is_ticks, encoder.send)
    encoder.pull_out()
    heard(stream, is_frame)
    heard(stream, note("ttyUSB0"))
    heard(stream, is_frame)
    encoder.plug_in()
    back = heard(stream, is_ticks, encoder.send)
    assert isinstance(back, Ticks)
    heard(stream, no_note("ttyUSB0"), encoder.send)


def test_a_silent_encoder_and_one_that_sends_rubbish_are_named(bridged: Bridged, encoder: Encoder) -> None:
    stream = bridged.other.listen(HEALTH, period_s=0.02)
    encoder.plug_in()
    bridged.begin()
    heard(stream, note("is open and has given nothing usable"))
    heard(stream, no_note("nothing usable"), encoder.send)


def test_health_tells_of_the_encoders_clock_and_nobody_need_worry(bridged: Bridged, encoder: Encoder) -> None:
    stream = bridged.other.listen(HEALTH, period_s=0.02)
    encoder.plug_in()
    bridged.begin()
    health = heard(stream, note("clock of the encoder: runs"), encoder.send)
    assert isinstance(health, Health)
    said = next(text for text in health.notes if text.startswith("clock"))
    assert re.fullmatch(r"clock of the encoder: runs \d+ ppm (fast|slow); lines come .* ms, p99 .* ms after .*", said)
    assert is_harmless(said)


def test_a_camera_that_is_away_is_not_said_to_be_open(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    notes: dict[str, str | None] = {}
    bus: Any = SimpleNamespace(note=lambda text, about: notes.update({about: text}))
    silence = bridge.Silence(bus, "camera", "images", after_s=-1.0)  # whatever is silent has been so for too long
    silence.step(heard=False)
    assert "images has not answered for" in str(notes["camera silence"])
    monkeypatch.setattr(bridge, "camera_events", lambda *_: [Lost("is not there")])
    bridge.read_camera(bus, config, threading.Event(), Newest(), threading.Event(), silence)
    silence.step(heard=False)
    assert notes == {"camera": "camera: images is not there", "camera silence": None, "camera facts": None}
    silence.device(None)
    silence.step(heard=False)
    assert notes["camera"] is None
    assert "is open and has given nothing usable" in str(notes["camera silence"])
    silence.step(heard=False, expected=False)
    assert notes["camera silence"] is None


def test_who_reads_along_learns_once_why_a_device_is_away(caplog: pytest.LogCaptureFixture) -> None:
    bus: Any = SimpleNamespace(note=lambda text, about: None)
    silence = bridge.Silence(bus, "encoder", "/dev/wheels", after_s=1.0)
    for lost in (None, "does not open", "does not open", "permission denied", None, "permission denied", None, None):
        silence.device(lost)
    silence.step(heard=False, expected=False)
    said = ["does not open", "permission denied", "is there again"]
    assert caplog.messages == [f"encoder: /dev/wheels {text}" for text in said[:2]]  # it opened, and gave nothing
    for _ in range(2):
        silence.step(heard=True)
    assert caplog.messages == [f"encoder: /dev/wheels {text}" for text in said]
    silence.device("is gone")
    silence.step(heard=True)  # on its way meanwhile
    assert caplog.messages[len(said) :] == ["encoder: /dev/wheels is gone"]


def test_images_of_another_size_are_published_as_they_are_and_noted(bridged: Bridged, config: Config) -> None:
    stream = bridged.other.listen(FRAME, HEALTH, period_s=0.02)
    show_images(config, 2, PICTURE[:40])
    bridged.begin()
    frame = heard(stream, is_frame)
    assert isinstance(frame, Frame)
    assert (frame.width_px, frame.height_px) == (64, 40)
    heard(stream, note("frames have 64 x 40 pixels, the configuration says 64 x 48"))


def test_health_tells_who_stamps_the_frames(bridged: Bridged, config: Config) -> None:
    stream = bridged.other.listen(FRAME, HEALTH, period_s=0.02)
    show_images(config, 400)
    bridged.begin()
    heard(stream, note("camera: stamped by a rhythm of 20 Hz"))
    shutil.rmtree(config.camera.source)
    heard(stream, no_note("stamped by"))


def test_a_folder_that_has_ended_leaves_the_bridge_alive(bridged: Bridged, config: Config, encoder: Encoder) -> None:
    stream = bridged.other.listen(TICKS, HEALTH, period_s=0.02)
    show_images(config, 2)
    encoder.plug_in()
    bridged.begin()
    heard(stream, note("camera: source finished"), encoder.send)
    heard(stream, is_ticks, encoder.send)
    assert bridged.thread.is_alive()


def test_a_folder_that_vanishes_and_comes_back_gives_frames_again(bridged: Bridged, config: Config) -> None:
    stream = bridged.other.listen(FRAME, HEALTH, period_s=0.02)
    show_images(config, 400)
    bridged.begin()
    heard(stream, is_frame)
    shutil.rmtree(config.camera.source)
    heard(stream, note("images cannot be read: No such file or directory"))
    away_ns = time.monotonic_ns()
    show_images(config, 2)
    heard(stream, lambda message: is_frame(message) and message.stamp_ns > away_ns)
    heard(stream, note("camera: source finished"))
    heard(stream, no_note("cannot be read"))


def test_it_refuses_to_run_beside_a_player_that_does_not_leave(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rivals, "LEAVE_S", 0.2)
    with Router(config), Bus(config, "player", "front") as player, Bus(config, "bridge", "front") as bus:
        player.ready()
        assert bus.await_presence(lambda: ("player", "front") in bus.present(), 20.0)
        with pytest.raises(UseError, match="cannot run beside"):
            bridge.run(bus, config)


def test_a_reader_that_breaks_ends_the_service(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise RuntimeError("broken on purpose")

    monkeypatch.setattr(bridge, "read_encoder", broken)
    with (
        Router(config),
        Bus(config, "bridge", "front") as bus,
        pytest.raises(RuntimeError, match="broken on purpose"),
    ):
        bridge.run(bus, config)


def test_as_a_process_it_ends_with_its_folder_if_asked_to_and_at_once_on_sigterm(
    config: Config, tmp_path: Path
) -> None:
    show_images(config, 12)
    (tmp_path / "robot.json").write_text(config.model_dump_json())
    command = [sys.executable, "-m", "services.bridge", "--config", str(tmp_path / "robot.json")]
    with Router(config), Bus(config, "vision", "front") as other:
        stream = other.listen(FRAME, period_s=0.02)
        with own(subprocess.Popen([*command, "--exit-when-done"], cwd=PROJECT)) as process:
            stamps_ns = [message.stamp_ns for message in (heard(stream, is_frame) for _ in range(3))]
            assert np.all(np.diff(stamps_ns) % 50_000_000 == 0)
            assert process.wait(30.0) == 0
        begun_ns = time.monotonic_ns()
        with own(subprocess.Popen(command, cwd=PROJECT)) as process:
            heard(stream, lambda message: message.stamp_ns > begun_ns)
            process.send_signal(signal.SIGTERM)
            assert process.wait(30.0) == 0  # by itself: ended by force it would be FORCED
