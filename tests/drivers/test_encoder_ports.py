"""Every protocol over a real port, byte by byte, spoilt, unplugged; and over the network."""

import os
import random
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from threading import Event

import pytest
import serial
import serial.rfc2217
from serial.urlhandler import protocol_socket

from omnivert.config import Encoder
from omnivert.drivers.device import Lost, Opened
from omnivert.drivers.encoder import EncoderLine
from omnivert.drivers.serial_line import pieces
from omnivert.messages import Ticks
from tests.drivers.devices import PROTOCOLS, Device, Noise, RosArduinoDevice, config_of, device_of, pieces_of

DEADLINE_S = 8.0


class Plugged:
    """A device at a pseudo-terminal, in a thread of its own: it hears and says byte by byte, while it is plugged in."""

    def __init__(self, port: Path, device: Device, spoilt: float = 0.0) -> None:
        self.device = device
        self._port = port
        self._noise = Noise(3, spoilt)
        self._random = random.Random(5)
        self._stop = Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self._port.symlink_to(os.ttyname(self._slave))
        self._thread.start()

    def pull_out(self) -> None:
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join(DEADLINE_S)
            self._port.unlink()
            os.close(self._master)
            os.close(self._slave)

    def _run(self) -> None:
        while not self._stop.is_set():
            ready, _, _ = select.select([self._master], [], [], 0.001)
            now_ns = time.monotonic_ns()
            for byte in self._noise.spoilt(os.read(self._master, 100)) if ready else b"":
                self.device.hear(byte, now_ns)
            self.device.live(now_ns)
            while self.device.out:
                said = self._noise.spoilt(self.device.out.popleft().data)
                for piece in pieces_of(said, self._random.randrange(1000)):
                    os.write(self._master, piece)


class Clocked(Device):
    """A device whose time begins now; its wheels do not have to turn for as long as the machine is up."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._begun_ns = time.monotonic_ns()
        self.out = device.out

    def hear(self, byte: int, now_ns: int) -> None:
        self._device.hear(byte, now_ns - self._begun_ns)

    def live(self, now_ns: int) -> None:
        self._device.live(now_ns - self._begun_ns)


@pytest.fixture
def plug_in(tmp_path: Path) -> Iterator[Callable[..., Plugged]]:
    plugged: list[Plugged] = []

    def plug(protocol: str, spoilt: float = 0.0) -> Plugged:
        plugged.append(Plugged(tmp_path / "ttyUSB0", Clocked(device_of(protocol)), spoilt))
        return plugged[-1]

    yield plug
    for one in plugged:
        one.pull_out()


def config_at(port: str, protocol: str) -> Encoder:
    return config_of(protocol, port=port)


def ticks_until(
    enough: Callable[[list[Ticks]], bool], stream: Iterator[bytes | Opened | Lost], line: EncoderLine
) -> list[Ticks]:
    """Steps the line with what the port sends, until there is enough; tells it of the port as the bridge does."""
    ticks: list[Ticks] = []
    deadline = time.monotonic() + DEADLINE_S
    while not enough(ticks):
        assert time.monotonic() < deadline, f"only {len(ticks)} ticks; refused {line.refused}"
        match next(stream):
            case Opened():
                line.reopened()
            case bytes(piece):
                ticks += line.step(piece, time.monotonic_ns())
            case Lost():
                pass
    return ticks


@contextmanager
def opened(config: Encoder) -> Iterator[tuple[Iterator[bytes | Opened | Lost], EncoderLine]]:
    stop, line = Event(), EncoderLine(config)
    stream = pieces(config, stop, line)
    too_late = threading.Timer(DEADLINE_S, stop.set)
    too_late.start()
    yield stream, line
    too_late.cancel()
    stop.set()
    assert list(stream) == []  # the port is closed


def moves_as_the_wheels(ticks: list[Ticks], config: Encoder) -> bool:
    """Whether counts grow as the simulated wheels begin: forward, and never faster than they can."""
    fastest = config.max_speed_m_s / config.metres_per_tick
    return all(
        abs(after.left - before.left) <= fastest * ((after.stamp_ns - before.stamp_ns) * 1e-9 + 0.02) + 2
        for before, after in pairwise(ticks)
    )


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_over_a_pseudo_terminal_byte_by_byte_everything_is_read(
    protocol: str, plug_in: Callable[..., Plugged], tmp_path: Path
) -> None:
    plug_in(protocol)
    config = config_at(str(tmp_path / "ttyUSB0"), protocol)
    with opened(config) as (stream, line):
        ticks = ticks_until(lambda ticks: len(ticks) >= 25, stream, line)
    assert sum(line.refused.values()) <= 1  # the line that was half over when the port was opened
    assert ticks[-1].left > ticks[0].left
    assert moves_as_the_wheels(ticks, config)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_over_a_pseudo_terminal_that_spoils_bytes_reading_goes_on(
    protocol: str, plug_in: Callable[..., Plugged], tmp_path: Path
) -> None:
    plug_in(protocol, spoilt=0.03)
    config = config_at(str(tmp_path / "ttyUSB0"), protocol)
    with opened(config) as (stream, line):
        ticks = ticks_until(lambda ticks: len(ticks) >= 12 and sum(line.refused.values()) >= 3, stream, line)
    assert moves_as_the_wheels([t for t in ticks if abs(t.left) < 2**39], config)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_device_that_is_plugged_in_again_is_read_within_a_second(
    protocol: str, plug_in: Callable[..., Plugged], tmp_path: Path
) -> None:
    first = plug_in(protocol)
    config = config_at(str(tmp_path / "ttyUSB0"), protocol)  # its pauses as by default
    with opened(config) as (stream, line):
        ticks_until(lambda ticks: len(ticks) >= 3, stream, line)
        first.pull_out()
        began_s = time.monotonic()
        assert isinstance(next(piece for piece in stream if not isinstance(piece, bytes)), Lost)
        found_s = time.monotonic() - began_s
        assert isinstance(next(stream), Lost)  # "is gone", then "does not open"
        plug_in(protocol)
        began_s = time.monotonic()
        ticks_until(lambda ticks: len(ticks) >= 1, stream, line)
        back_s = time.monotonic() - began_s
    assert found_s < 1.0
    assert back_s < 1.0


class Unled(serial.Serial):  # type: ignore[misc]  # pyserial has no types
    """A pseudo-terminal, which has no lines beside those for data."""

    cts = dsr = ri = cd = True

    def _update_rts_state(self) -> None: ...

    def _update_dtr_state(self) -> None: ...

    def _update_break_state(self) -> None: ...


class Network:
    """A server that hands a serial port on, as a socket or by RFC 2217; one client at a time."""

    def __init__(self, port: str, by_rfc2217: bool) -> None:
        self._serial = Unled(port, 115200, timeout=0.0)
        self._by_rfc2217 = by_rfc2217
        self._stop = Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listening.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join(DEADLINE_S)
        self._listening.close()
        self._serial.close()

    def _run(self) -> None:
        client, _ = self._listening.accept()
        with client:
            manager = serial.rfc2217.PortManager(self._serial, Writing(client)) if self._by_rfc2217 else None
            while not self._stop.is_set():
                ready, _, _ = select.select([client, self._serial.fileno()], [], [], 0.01)
                if client in ready:
                    data = client.recv(1000)
                    if not data:
                        return
                    self._serial.write(b"".join(manager.filter(data)) if manager else data)
                if data := self._serial.read(1000):
                    client.sendall(b"".join(manager.escape(data)) if manager else data)


class Writing:
    """The side of a client that pyserial's server writes to."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client

    def write(self, data: bytes) -> None:
        self._client.sendall(data)


@pytest.mark.parametrize("protocol", ["omnivert", "roboclaw"])
@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial 3.5
def test_a_device_behind_the_network_is_read_and_asked(
    protocol: str, scheme: str, plug_in: Callable[..., Plugged], tmp_path: Path
) -> None:
    plug_in(protocol)
    server = Network(str(tmp_path / "ttyUSB0"), by_rfc2217=scheme == "rfc2217")
    config = config_at(f"{scheme}://{server.address}", protocol)
    try:
        with opened(config) as (stream, line):
            ticks = ticks_until(lambda ticks: len(ticks) >= 10, stream, line)
    finally:
        server.close()
    assert ticks[-1].left > ticks[0].left


@contextmanager
def sending(data: bytes) -> Iterator[tuple[str, Event]]:
    """A server that sends this to whoever connects first, once it is told to begin; its address."""
    begin = Event()
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            client, _ = listening.accept()
            with client, suppress(OSError):
                begin.wait(DEADLINE_S)
                client.sendall(data)
                while client.recv(1000):  # until the other side closes
                    pass

        threading.Thread(target=serve, daemon=True).start()
        yield f"127.0.0.1:{listening.getsockname()[1]}", begin


def test_of_the_network_all_that_waits_is_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """One byte at a time, a jam of some seconds would hardly ever clear."""
    reads: list[int] = []
    read = protocol_socket.Serial.read

    def counted(port: object, size: int) -> bytes:
        reads.append(size)
        return bytes(read(port, size))

    monkeypatch.setattr(protocol_socket.Serial, "read", counted)
    sizes: list[int] = []
    with (
        sending(bytes(100_000)) as (address, begin),
        opened(config_at(f"socket://{address}", "omnivert")) as (stream, _),
    ):
        assert next(stream) == Opened()  # what came before is not read
        begin.set()
        while sum(sizes) < 100_000:
            piece = next(stream)
            assert isinstance(piece, bytes)
            sizes.append(len(piece))
    assert len(reads) < 1000


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial 3.5
def test_what_is_not_of_rfc_2217_ends_no_thread_in_a_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    sound = threading.excepthook
    ended: list[str] = []
    threading.excepthook = lambda given: ended.append(str(given.exc_value))
    try:
        with (
            sending(b"\xff\xf0\xff\xf0") as (address, begin),
            opened(config_at(f"rfc2217://{address}?timeout=0.3", "omnivert")) as (stream, _),
        ):
            begin.set()
            lost = next(stream)
    finally:
        threading.excepthook = sound
    assert isinstance(lost, Lost)
    assert lost.reason.startswith("does not open: ")
    assert (ended, capfd.readouterr().err) == ([], "")


def test_a_device_that_takes_nothing_is_not_waited_for_without_end(tmp_path: Path) -> None:
    """Nobody reads at the other end; what is asked does not fill the way there."""
    master, slave = os.openpty()
    try:
        tty.setraw(master)
        with opened(config_at(os.ttyname(slave), "ros_arduino_bridge")) as (stream, line):
            began_s = time.monotonic()
            for _ in range(8):
                next(stream)
            assert time.monotonic() - began_s < 5.0
            assert line.refused == {}
    finally:
        os.close(master)
        os.close(slave)


def test_the_firmware_that_is_simulated_answers_as_the_real_one_does() -> None:
    """Letters before the last are forgotten, arguments passed over, and nothing is said before the end of a line."""
    device = RosArduinoDevice(device_of("ros_arduino_bridge")._wheels)
    for byte in b"xe\rm 3 4\rq\re":
        device.hear(byte, 0)
    assert [said.data for said in device.out] == [b"0 0\r\n", b"OK\r\n", b"Invalid Command\r\n"]
