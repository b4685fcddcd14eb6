"""Encoders' devices as their makers describe them, and a wire to them that takes its time and spoils bytes.

Written from the makers' texts, not from the parsers: two readings of one protocol must agree.
"""

import math
import random
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from omnivert.config import Encoder
from omnivert.drivers.counters import BREAK
from omnivert.drivers.encoder import EncoderLine
from omnivert.messages import Ticks

SECOND = 10**9
MS = 10**6


def crc_table() -> list[int]:
    """Of CRC-16 with polynomial 0x1021, a byte at a time."""
    table = []
    for value in range(256):
        crc = value << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return table


TABLE = crc_table()


def crc16(data: bytes, start: int) -> int:
    crc = start
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ TABLE[crc >> 8 ^ byte]
    return crc


@dataclass(frozen=True)
class Wheels:
    """Where both wheels are; in counts, at any time."""

    fastest: float = 4500.0  # counts a second; forward, a third of it backward
    start: tuple[int, int] = (0, 0)

    def at(self, ns: int) -> tuple[int, int]:
        t = ns * 1e-9
        left = self.fastest * (t / 3.0 - (math.cos(0.7 * t) - 1.0) * 2.0 / 3.0 / 0.7)
        right = self.fastest * (t / 3.0 - (math.cos(0.9 * t) - 1.0) * 2.0 / 3.0 / 0.9)
        return self.start[0] + math.floor(left), self.start[1] + math.floor(right)


@dataclass(frozen=True)
class Said:
    """What a device sends at once, and which reading of its counters stands in it."""

    ready_ns: int
    data: bytes
    read_ns: int | None = None
    counts: tuple[int, int] = (0, 0)  # raw, before they are cut to the counter's width


class Device:
    """What all of them share: hears bytes, says some."""

    def __init__(self, wheels: Wheels) -> None:
        self._wheels = wheels
        self.out: deque[Said] = deque()

    def hear(self, byte: int, now_ns: int) -> None: ...

    def live(self, now_ns: int) -> None:
        """Time has passed."""


class OmnivertDevice(Device):
    """A line every 20 ms, by a clock that is 100 ppm fast."""

    period_ns = 20 * MS

    def __init__(self, wheels: Wheels) -> None:
        super().__init__(wheels)
        self._next_ns = 0

    def live(self, now_ns: int) -> None:
        while self._next_ns <= now_ns:
            at_ns = self._next_ns
            self._next_ns += self.period_ns
            left, right = self._wheels.at(at_ns)
            device_us = (4_000_000_000 + round(at_ns * 1.0001) // 1000) % 2**32
            text = f"T,{device_us},{_signed(left, 32)},{_signed(right, 32)}".encode()
            line = b"$" + text + b"*%04X\r\n" % crc16(text, 0xFFFF)
            self.out.append(Said(at_ns, line, at_ns, (left, right)))


class RosArduinoDevice(Device):
    """The firmware's loop: a letter, arguments after blanks, carriage return."""

    def __init__(self, wheels: Wheels) -> None:
        super().__init__(wheels)
        self._command = 0
        self._argument = 0
        self._zero = (0, 0)
        self.resets = 0

    def hear(self, byte: int, now_ns: int) -> None:
        if byte == 13:
            self._run(now_ns + 50_000)
            self._command = self._argument = 0
        elif byte == ord(" "):
            self._argument += 1
        elif self._argument == 0:
            self._command = byte

    def _run(self, now_ns: int) -> None:
        match chr(self._command):
            case "e":
                at = self._wheels.at(now_ns)
                left, right = at[0] - self._zero[0], at[1] - self._zero[1]
                text = f"{_signed(left, 32)} {_signed(right, 32)}\r\n"
                self.out.append(Said(now_ns, text.encode(), now_ns, (left, right)))
            case "r":
                self._zero = self._wheels.at(now_ns)
                self.resets += 1
                self.out.append(Said(now_ns, b"OK\r\n"))
            case "b":
                self.out.append(Said(now_ns, b" 57600\r\n"))
            case "a" | "d" | "p" | "t":
                self.out.append(Said(now_ns, b"512\r\n"))
            case "m" | "u" | "c" | "w" | "x":
                self.out.append(Said(now_ns, b"OK\r\n"))
            case _:
                self.out.append(Said(now_ns, b"Invalid Command\r\n"))


class RoboClawDevice(Device):
    """Packet serial: two bytes, or a packet that is dropped 10 ms after its last byte."""

    def __init__(self, wheels: Wheels, address: int = 128) -> None:
        super().__init__(wheels)
        self._address = address
        self._packet = bytearray()
        self._heard_ns = 0

    def hear(self, byte: int, now_ns: int) -> None:
        if now_ns - self._heard_ns > 10 * MS:
            self._packet.clear()
        self._heard_ns = now_ns
        self._packet.append(byte)
        if self._packet[0] != self._address or len(self._packet) != 2:
            return
        left, right = self._wheels.at(now_ns + 100_000)
        match self._packet[1]:
            case 78:
                counts = struct.pack(">II", left % 2**32, right % 2**32)
                self._answer(counts, now_ns + 100_000, (left, right))
            case 16:
                self._answer(struct.pack(">IB", left % 2**32, 0), now_ns)
            case 17:
                self._answer(struct.pack(">IB", right % 2**32, 0), now_ns)
            case _:
                return  # the rest of another command would follow
        self._packet.clear()

    def _answer(self, data: bytes, now_ns: int, counts: tuple[int, int] | None = None) -> None:
        data += crc16(bytes(self._packet) + data, 0).to_bytes(2, "big")
        self.out.append(Said(now_ns, data, now_ns if counts else None, counts or (0, 0)))


class Create2Device(Device):
    """Off until START, then a stream of whatever packets were asked for; only the encoders' are known here."""

    period_ns = 15 * MS

    def __init__(self, wheels: Wheels, awake: bool = True) -> None:
        super().__init__(wheels)
        self.awake = awake
        self.starts = 0
        self._streams = False
        self._heard = bytearray()
        self._next_ns = 0

    def hear(self, byte: int, now_ns: int) -> None:
        self._heard.append(byte)
        match list(self._heard):
            case [128]:
                self.awake = True
                self.starts += 1
            case [148] | [148, _] | [148, _, _]:
                return
            case [148, 2, 43, 44]:
                if self.awake and not self._streams:
                    self._streams, self._next_ns = True, now_ns + self.period_ns
        self._heard.clear()

    def live(self, now_ns: int) -> None:
        while self._streams and self._next_ns <= now_ns:
            at_ns = self._next_ns
            self._next_ns += self.period_ns
            left, right = self._wheels.at(at_ns)
            packet = struct.pack(">BBBHBH", 19, 6, 43, left % 2**16, 44, right % 2**16)
            self.out.append(Said(at_ns, packet + bytes((256 - sum(packet) % 256 & 0xFF,)), at_ns, (left, right)))


def _signed(count: int, bits: int) -> int:
    half = 1 << bits - 1
    return (count + half) % (2 * half) - half


class Noise:
    """Turns bytes into others, one in so many."""

    def __init__(self, seed: int, share: float) -> None:
        self._random = random.Random(seed)
        self._share = share
        self._left = self._gap()

    def _gap(self) -> int:
        if self._share == 0.0:
            return 2**62
        return int(math.log(1.0 - self._random.random()) / math.log(1.0 - self._share))

    def spoilt(self, data: bytes) -> bytes:
        if self._left >= len(data):
            self._left -= len(data)
            return data
        changed = bytearray(data)
        at = self._left
        while at < len(data):
            changed[at] = (changed[at] + self._random.randrange(1, 256)) % 256
            at += 1 + self._gap()
        self._left = at - len(data)
        return bytes(changed)


@dataclass
class Outcome:
    """What came of a drive."""

    ticks: int = 0
    intact: int = 0  # readings whose question and answer were not spoilt, and that do not follow a lost answer
    taken: int = 0  # of these, those that gave a tick
    wrong: int = 0  # ticks that the wheels did not have between the first and the last reading of an exchange
    inexact: int = 0  # ticks that stand between two readings of an exchange, but are none of them
    restarts: int = 0
    worst_stamp_ns: int = 0


class Wire:
    """A line to a device, in simulated time: bytes take their time, come in pieces, late, and some of them spoilt."""

    def __init__(self, config: Encoder, device: Device, seed: int, spoilt: float, late_ms: float = 0.3) -> None:
        self.line = EncoderLine(config)
        self.device = device
        self.outcome = Outcome()
        self._random = random.Random(seed + 1)
        self._noise = Noise(seed, spoilt)
        self._byte_ns = 10 * SECOND // config.baud
        self._late_ns = late_ms * MS
        self._now_ns = 0
        self._sent_ns = 0  # the device's last byte has left
        self._offset: tuple[int, int] | None = None
        self._before: Ticks | None = None
        self._answers = 3 if config.protocol == "ros_arduino_bridge" else 1
        self._recent: deque[Said] = deque(maxlen=3 if self._answers == 3 else 1)
        self._question_intact = True
        self._ends = 0  # of lines, in the last answer
        self._answered = self._after_answer = True

    def drive(self, seconds: float) -> Outcome:
        end_ns = self._now_ns + round(seconds * SECOND)
        while self._now_ns < end_ns:
            self._now_ns += round(self.line.idle_s(self._now_ns) * SECOND)
            question = self.line.question(self._now_ns)
            if question:
                self._ask(question)
            self.device.live(self._now_ns)
            if not self.device.out:
                self._now_ns += 2 * MS
                self._check(self.line.step(b"", self._now_ns), [])
            elif self._answers == 1 or not question:
                self._receive([self.device.out.popleft()])
            else:
                said = list(self.device.out)
                self.device.out.clear()
                self._receive(said)
        return self.outcome

    def _ask(self, question: bytes) -> None:
        self._after_answer, self._answered = self._answered, False
        arriving = self._noise.spoilt(question)
        self._question_intact = arriving == question
        for k, byte in enumerate(arriving):
            self.device.hear(byte, self._now_ns + (k + 1) * self._byte_ns)

    def _receive(self, said: list[Said]) -> None:
        """Every message in one or two pieces; the last one's ticks are held against what was read."""
        whole = True
        ticks: list[Ticks] = []
        self._ends = 0
        for message in said:
            data = self._noise.spoilt(message.data)
            whole &= data == message.data and message.read_ns is not None
            self._recent.append(message)
            self._ends += data.count(b"\n")
            cut = self._random.randrange(len(data) + 1)
            begun_ns = max(self._sent_ns, message.ready_ns)
            for piece, upto in ((data[:cut], cut), (data[cut:], len(data))):
                if piece:
                    late_ns = round(self._random.expovariate(1.0) * self._late_ns)
                    self._now_ns = max(self._now_ns, begun_ns + upto * self._byte_ns + late_ns)
                    ticks += self.line.step(piece, self._now_ns)
            self._sent_ns = begun_ns + len(data) * self._byte_ns
        self._answered = self._is_answered(said)
        if whole and self._question_intact and self._after_answer and len(said) == self._answers:
            self.outcome.intact += 1
            self.outcome.taken += bool(ticks)
        self._check(ticks, said)

    def _is_answered(self, said: list[Said]) -> bool:
        """Whether the bridge can know that the answer has ended."""
        if isinstance(self.device, RoboClawDevice):
            return sum(len(message.data) for message in said) >= 10
        return self._ends >= self._answers or not isinstance(self.device, RosArduinoDevice)

    def _check(self, ticks: list[Ticks], said: list[Said]) -> None:
        for tick in ticks:
            self.outcome.ticks += 1
            middle = self._recent[len(self._recent) // 2]
            jumped = self._before is not None and abs(tick.left - self._before.left) > BREAK // 2
            self.outcome.restarts += jumped
            if self._offset is None or jumped:  # held to account by all ticks that follow
                self._offset = (tick.left - middle.counts[0], tick.right - middle.counts[1])
            counts = (tick.left - self._offset[0], tick.right - self._offset[1])
            read = [m for m in self._recent if m.read_ns is not None]
            grows = self._before is None or tick.stamp_ns > self._before.stamp_ns
            between = all(
                min(m.counts[side] for m in read) <= counts[side] <= max(m.counts[side] for m in read)
                for side in range(2)
            )
            self.outcome.wrong += not (between and grows)
            self.outcome.inexact += between and counts not in [m.counts for m in read]
            off_ns = min(abs(tick.stamp_ns - (m.read_ns or 0)) for m in read)
            self.outcome.worst_stamp_ns = max(self.outcome.worst_stamp_ns, off_ns)
            self._before = tick


PROTOCOLS = ("omnivert", "ros_arduino_bridge", "roboclaw", "create2")


def config_of(protocol: str, **other: object) -> Encoder:
    """A robot that has such a device; the rates as usual for it."""
    given: dict[str, object] = {"protocol": protocol, "baud": 57600 if protocol == "ros_arduino_bridge" else 115200}
    if protocol == "create2":
        given |= {"wheel_diameter_m": 0.072, "ticks_per_rev": 508.8, "max_speed_m_s": 0.6}
    return Encoder.model_validate(given | other)


def device_of(protocol: str, start: tuple[int, int] = (0, 0)) -> Device:
    match protocol:
        case "omnivert":
            return OmnivertDevice(Wheels(start=start))
        case "ros_arduino_bridge":
            return RosArduinoDevice(Wheels(start=start))
        case "roboclaw":
            return RoboClawDevice(Wheels(start=start))
        case _:
            return Create2Device(Wheels(fastest=1100.0, start=start))


def pieces_of(data: bytes, seed: int) -> Iterator[bytes]:
    """The bytes in pieces of one to a few."""
    rand, at = random.Random(seed), 0
    while at < len(data):
        size = rand.choice((1, 1, 2, 3, 7))
        yield data[at : at + size]
        at += size
