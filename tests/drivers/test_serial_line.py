"""A real pseudo-terminal as the serial port: garbage, a partial line, pulled out and plugged in again."""

import os
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest

from omnivert.config import Encoder
from omnivert.drivers.device import Lost, Opened
from omnivert.drivers.encoder import EncoderLine
from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.sample import Sample
from omnivert.drivers.serial_line import pieces
from omnivert.messages import Ticks


class Device:
    """An encoder on a pseudo-terminal, whose name is there while it is plugged in."""

    def __init__(self, port: Path) -> None:
        self._port = port
        self._master: int | None = None
        self._slave: int | None = None

    def plug_in(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self._port.symlink_to(os.ttyname(self._slave))

    def send(self, data: bytes) -> None:
        assert self._master is not None
        os.write(self._master, data)

    def pull_out(self) -> None:
        self._port.unlink(missing_ok=True)
        for end in (self._master, self._slave):
            if end is not None:
                os.close(end)
        self._master = self._slave = None


@pytest.fixture
def device(tmp_path: Path) -> Iterator[Device]:
    there = Device(tmp_path / "ttyUSB0")
    yield there
    there.pull_out()


@pytest.fixture
def config(tmp_path: Path) -> Encoder:
    return Encoder(port=str(tmp_path / "ttyUSB0"), reopen_s=0.02)


def ticks_until(count: int, stream: Iterator[bytes | Opened | Lost], line: EncoderLine) -> list[Ticks]:
    """Reads until as many ticks have come; anything but bytes is an error."""
    ticks: list[Ticks] = []
    while len(ticks) < count:
        piece = next(stream)
        assert isinstance(piece, bytes), piece
        ticks += line.step(piece, time.monotonic_ns())
    return ticks


def sent(k: int) -> bytes:
    return line_from_sample(Sample(20_000 * k, 10 * k, 12 * k))


def test_lines_among_garbage_and_a_partial_line_come_through(device: Device, config: Encoder) -> None:
    device.plug_in()
    stop, line = Event(), EncoderLine(config)
    stream = pieces(config, stop, line)
    assert next(stream) == Opened()
    device.send(sent(1)[9:] + sent(2) + b"\xff\x00\x11garbage\r\n" + sent(3)[:12])
    assert ticks_until(1, stream, line)[0].left == 20
    device.send(sent(3)[12:] + sent(4))
    assert [(t.left, t.right) for t in ticks_until(2, stream, line)] == [(30, 36), (40, 48)]
    assert line.refused == {"not a line of the protocol": 2}
    stop.set()
    assert list(stream) == []


class Pauses(Event):
    """Remembers how long was waited for it."""

    def __init__(self) -> None:
        super().__init__()
        self.pauses_s: list[float | None] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.pauses_s.append(timeout)
        return super().wait(timeout)


def test_an_unplugged_port_is_named_and_read_again_after_one_pause(device: Device, config: Encoder) -> None:
    stop, line = Pauses(), EncoderLine(config)
    stream = pieces(config, stop, line)
    assert next(stream) == Lost("does not open: No such file or directory")
    device.plug_in()
    assert next(stream) == Opened()
    device.send(sent(1) + sent(2)[:7])
    assert ticks_until(1, stream, line)[0].left == 10
    device.pull_out()
    pulled_out = next(piece for piece in stream if not isinstance(piece, bytes))
    assert isinstance(pulled_out, Lost)
    assert pulled_out.reason.startswith("is gone: ")
    assert next(stream) == Lost("does not open: No such file or directory")
    device.plug_in()
    stop.pauses_s.clear()
    assert next(stream) == Opened()
    assert stop.pauses_s == [config.reopen_s]  # one pause is all that lies between
    line.reopened()
    device.send(sent(3) + sent(4))
    assert [t.left for t in ticks_until(2, stream, line)] == [30, 40]
    assert line.refused == {"line cut off": 1}
    stop.set()
    assert list(stream) == []


def test_a_port_that_another_program_reads_is_refused(device: Device, config: Encoder) -> None:
    device.plug_in()
    stop, line = Event(), EncoderLine(config)
    first, second = pieces(config, stop, line), pieces(config, stop, line)
    assert next(first) == Opened()
    assert next(second) == Lost("does not open: another program reads it")
    stop.set()
    assert list(first) == list(second) == []


@pytest.mark.parametrize(
    ("port", "why"),
    [
        ("/dev/null", "it is no serial port"),
        ("socket://127.0.0.1:1", "Connection refused"),
        ("rfc2217://127.0.0.1:1", "Connection refused"),
        ("socket://somewhere", "it is no address like socket://HOST:PORT"),
        ("socket://127.0.0.1:999999", "it is no address like socket://HOST:PORT"),
        ("nothing://somewhere", "invalid URL, protocol 'nothing' not known"),
    ],
)
def test_why_a_port_does_not_open_is_said_in_words(port: str, why: str) -> None:
    config = Encoder(port=port)
    assert next(pieces(config, Event(), EncoderLine(config))) == Lost(f"does not open: {why}")


def test_the_default_pause_between_attempts_keeps_the_second() -> None:
    assert Encoder().reopen_s <= 0.9
