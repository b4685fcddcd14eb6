"""What encoders speak: every whole reading is taken and no spoilt one, whatever comes over the line."""

import random
from binascii import crc_hqx
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.config import Encoder
from omnivert.drivers import protocols
from omnivert.drivers.counters import BREAK
from omnivert.drivers.encoder import AWAY, EncoderLine
from omnivert.drivers.protocols.create2 import Create2
from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.roboclaw import RoboClaw, crc16
from omnivert.drivers.protocols.ros_arduino import RosArduino
from omnivert.drivers.protocols.sample import Sample
from omnivert.messages import Ticks
from tests.drivers.devices import (
    MS,
    PROTOCOLS,
    SECOND,
    Create2Device,
    RoboClawDevice,
    RosArduinoDevice,
    Wheels,
    Wire,
    config_of,
    device_of,
)

AT_ROLLOVER = (2**31 - 4000, 2**32 - 9000)  # signed and unsigned counters of 32 bits roll over within seconds
CLAW = bytes((128, 78))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_clean_line_gives_every_reading_with_its_time(protocol: str) -> None:
    wire = Wire(config_of(protocol), device_of(protocol, AT_ROLLOVER), seed=1, spoilt=0.0)
    outcome = wire.drive(20.0)
    assert outcome.taken == outcome.intact == outcome.ticks >= 1000
    assert outcome.wrong == outcome.inexact == outcome.restarts == 0
    assert wire.line.refused == {}
    # A stream without time is stamped as it comes, up to 4 ms late here; all others know better.
    assert outcome.worst_stamp_ns < (6 if protocol == "create2" else 0.5) * MS


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_of_a_line_that_spoils_one_byte_in_a_hundred_all_whole_readings_are_taken_and_no_wrong_one(
    protocol: str,
) -> None:
    device = device_of(protocol, AT_ROLLOVER)
    wire = Wire(config_of(protocol), device, seed=5, spoilt=0.01)
    outcome = wire.drive(150.0)
    resets = device.resets if isinstance(device, RosArduinoDevice) else 0  # an e that has become an r
    assert outcome.wrong == 0
    assert outcome.restarts == resets
    assert outcome.taken >= outcome.intact - 4 * resets > 3000
    assert outcome.inexact <= (3 if protocol == "ros_arduino_bridge" else 0)
    assert len(wire.line.refused) >= 2


@pytest.mark.parametrize("protocol", ["omnivert", "ros_arduino_bridge", "roboclaw"])
def test_what_an_adapter_holds_back_does_not_get_into_the_stamps(protocol: str) -> None:
    wire = Wire(config_of(protocol), device_of(protocol), seed=2, spoilt=0.0, late_ms=4.0)
    outcome = wire.drive(60.0)
    assert outcome.taken == outcome.intact == outcome.ticks > 2000
    assert outcome.wrong == 0
    assert outcome.worst_stamp_ns < 4 * MS  # readings come up to 40 ms late
    assert "ms, p99" in wire.line.clock


def test_a_stream_that_an_adapter_hands_on_in_bursts_loses_nothing() -> None:
    line, at = EncoderLine(config_of("create2")), Wheels(fastest=1100.0)
    device = Create2Device(at)
    for byte in line.question(0):
        device.hear(byte, 0)
    ticks: list[Ticks] = []
    for k in range(1, 200):
        now_ns = k * 40 * MS + (k % 3) * 9 * MS
        device.live(now_ns)
        ticks += line.step(b"".join(said.data for said in device.out), now_ns)
        device.out.clear()
    assert line.refused == {}
    assert len(ticks) == 199 * 40 // 15 + 1
    assert all(after.stamp_ns > before.stamp_ns for before, after in pairwise(ticks))
    off_ms = [min(abs(tick.stamp_ns - k * 15 * MS) for k in range(600)) / MS for tick in ticks]
    assert max(off_ms) < 8.0


def talk(line: EncoderLine, device: RosArduinoDevice | RoboClawDevice | Create2Device, now_ns: int) -> list[Ticks]:
    """One question and what comes of it, at once."""
    for byte in line.question(now_ns):
        device.hear(byte, now_ns)
    device.live(now_ns)
    said = b"".join(said.data for said in device.out)
    device.out.clear()
    return line.step(said, now_ns + 5 * MS)


def test_a_create_that_streams_is_not_stopped_and_one_that_sleeps_is_started() -> None:
    line, device = EncoderLine(config_of("create2")), Create2Device(Wheels(fastest=1100.0), awake=False)
    assert line.question(0) == bytes((148, 2, 43, 44))
    assert line.question(900 * MS) == b""
    assert talk(line, device, 1100 * MS) == []
    assert device.starts == 1
    assert [len(talk(line, device, (1120 + 15 * k) * MS)) for k in range(3)] == [1, 1, 1]
    assert line.question(1200 * MS) == b""
    assert line.question(3000 * MS) == bytes((148, 2, 43, 44))  # lost again: perhaps only the stream was paused


def test_a_roboclaw_answers_to_its_own_address_alone() -> None:
    device = RoboClawDevice(Wheels(), address=130)
    mine, other = EncoderLine(config_of("roboclaw", address=130)), EncoderLine(config_of("roboclaw"))
    assert len(talk(mine, device, 0)) == 1
    assert talk(other, device, SECOND) == []


def test_an_answer_that_comes_late_is_not_taken_for_that_to_the_next_question() -> None:
    def answer(left: int) -> bytes:
        counts = left.to_bytes(4, "big") + bytes(4)
        return counts + crc_hqx(CLAW + counts, 0).to_bytes(2, "big")

    line = EncoderLine(config_of("roboclaw"))
    assert line.question(0) == CLAW
    assert [t.left for t in line.step(answer(1), 5 * MS)] == [1]
    assert line.question(20 * MS) == CLAW
    assert line.question(80 * MS) == b""  # may still come
    assert line.question(125 * MS) == CLAW
    assert line.step(answer(2), 127 * MS) == []  # whose is it?
    assert line.question(145 * MS) == CLAW
    assert [t.left for t in line.step(answer(4), 150 * MS)] == [4]
    assert line.refused == {"no answer": 1}


@pytest.mark.parametrize("protocol", ["ros_arduino_bridge", "roboclaw"])
def test_a_device_is_asked_at_the_rate_that_is_set(protocol: str) -> None:
    device = device_of(protocol)
    assert isinstance(device, RosArduinoDevice | RoboClawDevice)
    line, now_ns, ticks = EncoderLine(config_of(protocol, poll_rate_hz=80.0)), 0, 0
    while now_ns < 10 * SECOND:
        now_ns += max(round(line.idle_s(now_ns) * SECOND), MS)
        ticks += len(talk(line, device, now_ns))
        now_ns += 5 * MS
    assert 790 <= ticks <= 810


@pytest.mark.parametrize("protocol", ["ros_arduino_bridge", "roboclaw"])
def test_nobody_is_asked_before_the_last_answer_is_there_or_given_up(protocol: str) -> None:
    line = EncoderLine(config_of(protocol))
    assert line.question(0)
    assert [at for at in range(1, 240) if line.question(at * MS)] == [101, 202]
    assert line.refused == {}  # whoever has never answered is silent, and that is said elsewhere


def test_a_device_that_talks_on_without_an_end_is_asked_again_and_counted() -> None:
    """A Create's stream, for one: a packet every 15 ms, and never the end of a line."""
    line = EncoderLine(config_of("ros_arduino_bridge"))
    packets = Create2Device(Wheels())
    for byte in (148, 2, 43, 44):
        packets.hear(byte, 0)
    asked = 0
    for now_ns in range(0, 5 * SECOND, 15 * MS):
        asked += bool(line.question(now_ns))
        packets.live(now_ns)
        while packets.out:
            assert line.step(packets.out.popleft().data.replace(b"\n", b"."), now_ns + MS) == []
    assert 4 <= asked <= 6
    assert line.refused == {"answer cut off": asked - 1}


def test_a_device_without_a_clock_is_believed_nothing_across_a_replug() -> None:
    line, device = EncoderLine(config_of("roboclaw")), RoboClawDevice(Wheels())
    before = talk(line, device, 0)[0]
    line.reopened()
    after = talk(line, device, 200 * MS)[0]
    assert after.left - before.left == BREAK
    assert line.refused == {AWAY: 1}


def test_an_arduino_that_was_reset_is_taken_up_out_of_reach() -> None:
    line, device = EncoderLine(config_of("ros_arduino_bridge")), RosArduinoDevice(Wheels(start=(9000, 9000)))
    before = talk(line, device, 0)
    for byte in b"r\r":
        device.hear(byte, 10 * MS)
    device.out.clear()
    after = [talk(line, device, (20 + 25 * k) * MS) for k in range(6)]
    assert [len(ticks) for ticks in after] == [0, 0, 0, 0, 1, 1]
    assert after[4][0].left > before[0].left + BREAK // 2


@given(
    left=st.integers(-(2**31), 2**31 - 1),
    right=st.integers(-(2**31), 2**31 - 1),
    moved=st.tuples(st.integers(0, 6), st.integers(-6, 0)),
    which=st.integers(0, 2),
    place=st.integers(0, 40),
    byte=st.integers(0, 255),
)
def test_one_spoilt_byte_in_three_answers_gives_no_count_that_the_wheel_did_not_have(
    left: int, right: int, moved: tuple[int, int], which: int, place: int, byte: int
) -> None:
    parser = RosArduino(reach=20.0)
    assert parser.request() == b"e\re\re\r"
    counts = [(left + k * moved[0] // 2, right + k * moved[1] // 2) for k in range(3)]
    answers = [bytearray(f"{a} {b}\r\n".encode()) for a, b in counts]
    answers[which][place % len(answers[which])] = byte
    for sample in parser.feed(b"".join(answers)):
        assert counts[0][0] <= sample.left <= counts[2][0]
        assert counts[2][1] <= sample.right <= counts[0][1]


def test_of_three_answers_two_alike_or_one_between_is_believed() -> None:
    def read(*answers: bytes) -> list[tuple[int, int]]:
        parser = RosArduino(reach=20.0)
        parser.request()
        return [(s.left, s.right) for s in parser.feed(b"".join(answers))]

    assert read(b"5 -7\r\n", b"6 -8\r\n", b"8 -8\r\n") == [(6, -8)]
    assert read(b"5 -7\r\n", b"5 -7\r\n", b"8 -8\r\n") == [(5, -7)]
    assert read(b"5 -7\r\n", b"Invalid Command\r\n", b"5 -7\r\n") == [(5, -7)]
    assert read(b"OK\r\n", b"5 -7\r\n", b"5 -7\r\n") == [(5, -7)]
    assert read(b"OK\r\n", b"5 -7\r\n", b"6 -7\r\n") == []
    assert read(b"5 -7\r\n", b"9 -7\r\n", b"6 -7\r\n") == []
    assert read(b"5 -7\r\n", b"60 -7\r\n", b"100 -7\r\n") == []  # farther than a wheel can go meanwhile
    assert read(b"05 -7\r\n", b"05 -7\r\n", b"05 -7\r\n") == []
    assert read(b"5 -7\n", b"5 -7\n", b"5 -7\n") == []


@pytest.mark.parametrize("protocol", PROTOCOLS)
@settings(max_examples=60)
@given(pieces=st.lists(st.binary(max_size=60), max_size=30))
def test_any_bytes_at_all_raise_nothing_and_give_no_tick(protocol: str, pieces: list[bytes]) -> None:
    line = EncoderLine(config_of(protocol))
    for k, piece in enumerate(pieces):
        line.question(k * 30 * MS)
        assert line.step(piece, k * 30 * MS + 5 * MS) == []


def sent(protocol: str, number: int) -> list[bytes]:
    """What a device sends in turn, of robots that drive on."""
    device, all_said = device_of(protocol), []
    for k in range(number):
        now_ns = (k + 1) * 20 * MS
        for byte in {"ros_arduino_bridge": b"e\r", "roboclaw": CLAW}.get(protocol, bytes((148, 2, 43, 44))):
            device.hear(byte, now_ns)
        device.live(now_ns)
    while device.out:
        all_said.append(device.out.popleft().data)
    return all_said


@pytest.mark.parametrize("protocol", ["omnivert", "create2"])
@settings(max_examples=60)
@given(data=st.data())
def test_garbage_in_a_stream_costs_only_what_it_lies_in(protocol: str, data: st.DataObject) -> None:
    whole = sent(protocol, 8)
    expected = [sample for said in whole for sample in protocols.parser(config_of(protocol)).feed(said)]
    at = data.draw(st.integers(1, 6))
    garbage = data.draw(st.binary(max_size=120))
    cut = data.draw(st.integers(0, len(whole[at])))
    stream = b"".join(whole[:at]) + whole[at][:cut] + garbage + b"".join(whole[at + 1 :])
    parser, found = protocols.parser(config_of(protocol)), []
    places = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    for a, b in pairwise([0, *places, len(stream)]):
        found += parser.feed(stream[a:b])
    strays = [sample for sample in found if sample not in expected]
    assert strays == []
    assert set(expected) - set(found) <= set(expected[at : at + 2])  # two where garbage makes a remark of the next


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_in_any_pieces_the_same_is_read_and_refused(protocol: str) -> None:
    rand = random.Random(7)
    for _ in range(30):
        stream = bytearray(b"".join(sent(protocol, 3)))
        for _ in range(rand.randrange(3)):
            stream[rand.randrange(len(stream))] = rand.randrange(256)
        outcomes = []
        for size in (1, 4, len(stream)):
            parser, samples = protocols.parser(config_of(protocol)), []
            if not isinstance(parser, protocols.OmnivertLine):
                parser.request()
            for at in range(0, len(stream), size):
                samples += parser.feed(bytes(stream[at : at + size]))
            parser.reset()
            outcomes.append((samples, parser.refused))
        assert outcomes[0] == outcomes[1] == outcomes[2]


def test_checksums_are_those_of_the_makers() -> None:
    assert crc16(b"123456789") == 0x31C3  # the usual check value of polynomial 0x1021, start 0
    assert sum((19, 5, 29, 2, 25, 13, 0, 163)) % 256 == 0  # iRobot's example of a stream
    packet = bytes((19, 6, 43, 1, 2, 44, 3, 4))
    good = packet + bytes((256 - sum(packet) % 256,))
    assert Create2().feed(good) == [Sample(None, 0x0102, 0x0304)]
    assert Create2().feed(good[:-1] + bytes((good[-1] ^ 1,))) == []


def test_a_roboclaw_that_says_too_little_is_counted_and_what_nobody_asked_for_is_not_read() -> None:
    parser = RoboClaw(128)
    counts = bytes((0, 0, 1, 0, 255, 255, 255, 254))
    good = counts + crc_hqx(CLAW + counts, 0).to_bytes(2, "big")
    assert parser.feed(good) == []
    assert parser.request() == CLAW
    assert parser.feed(good[:4]) == []
    assert parser.request() == CLAW
    assert parser.feed(good) == [Sample(None, 256, 2**32 - 2)]
    assert parser.refused == {"answer cut off": 1}


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("swapped", [False, True])
def test_sides_and_signs_are_put_right(signs: tuple[int, int], swapped: bool) -> None:
    config = Encoder.model_validate({"left_sign": signs[0], "right_sign": signs[1], "swap_sides": swapped})
    line, told = EncoderLine(config), []
    for k in range(3):
        forward = (signs[0] * 10 * k, signs[1] * 4 * k)  # of the robot's wheels, as their counters see it
        first, second = reversed(forward) if swapped else forward
        told += line.step(line_from_sample(Sample(20_000 * k, first, second)), (1 + 20 * k) * MS)
    assert [(t.left, t.right) for t in told] == [(0, 0), (10, 4), (20, 8)]


def test_every_protocol_that_can_be_configured_is_listed_in_one_line() -> None:
    assert set(protocols.PROTOCOLS) == set(PROTOCOLS)
    assert all(len(words) < 110 and "\n" not in words for words in protocols.PROTOCOLS.values())
    for protocol in protocols.PROTOCOLS:
        assert config_of(protocol).protocol == protocol
