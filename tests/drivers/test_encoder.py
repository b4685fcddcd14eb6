"""Bytes -> Ticks: rollover undone, jumps refused, the device's clock on the bridge's."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.config import Encoder
from omnivert.drivers.counters import BREAK, CounterPair, Jump
from omnivert.drivers.encoder import RESTARTED, EncoderLine
from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.sample import Sample
from omnivert.messages import Ticks
from omnivert.odometry import Odometer

MS = 1_000_000
FAST = Encoder(max_speed_m_s=5.0)  # 212 counts in 20 ms
UNWIRED = Encoder(baud=4_000_000)  # a line takes no time on the wire


def read(line: EncoderLine, sample: Sample, arrival_ms: float) -> list[tuple[int, int]]:
    return [(t.left, t.right) for t in line.step(line_from_sample(sample), round(arrival_ms * MS))]


@given(
    bits=st.integers(8, 63),
    unsigned=st.booleans(),
    signs=st.tuples(st.sampled_from((1, -1)), st.sampled_from((1, -1))),
    start=st.tuples(st.integers(-(2**62), 2**62), st.integers(-(2**62), 2**62)),
    steps=st.lists(st.tuples(st.integers(-120, 120), st.integers(-120, 120)), max_size=40),
)
def test_counts_add_up_over_any_rollover(
    bits: int,
    unsigned: bool,
    signs: tuple[int, int],
    start: tuple[int, int],
    steps: list[tuple[int, int]],
) -> None:
    def raw(count: int) -> int:
        span = 1 << bits
        return count % span if unsigned else (count + span // 2) % span - span // 2

    config = Encoder.model_validate(
        {"counter_bits": bits, "left_sign": signs[0], "right_sign": signs[1], "max_speed_m_s": 5.0}
    )
    pair = CounterPair(config)
    truth = np.array(start, dtype=object)
    first = pair.step(raw(truth[0]), raw(truth[1]), 0.0)
    assert not isinstance(first, Jump)
    assert max(map(abs, first)) <= 2**51
    assert bits > 52 or (first[0] - signs[0] * start[0]) % (1 << bits) == 0
    for moved in steps:
        truth = truth + np.array(moved, dtype=object)
        total = pair.step(raw(truth[0]), raw(truth[1]), 0.02)
        assert not isinstance(total, Jump)
        assert total[0] - first[0] == signs[0] * (truth[0] - start[0])
        assert total[1] - first[1] == signs[1] * (truth[1] - start[1])


def test_counts_go_on_smoothly_when_only_the_bridge_is_restarted() -> None:
    before, after = CounterPair(FAST), CounterPair(FAST)
    assert before.step(2**32 - 70, 500, 0.0) == (-70, 500)
    assert after.step(2**32 - 60, 510, 0.0) == (-60, 510)


def test_one_impossible_count_is_refused_and_the_next_taken() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(0, 0, 0), 1) == [(0, 0)]
    assert read(line, Sample(20_000, 100, 100), 21) == [(100, 100)]
    assert read(line, Sample(40_000, 9_000, 200), 41) == []
    assert read(line, Sample(60_000, 300, 300), 61) == [(300, 300)]
    assert line.refused == {"count jumps": 1}


def test_a_count_beyond_the_configured_width_is_refused() -> None:
    line = EncoderLine(Encoder(counter_bits=16))
    assert read(line, Sample(0, 65_536, 0), 1) == []
    assert line.refused == {"count beyond the counter's width": 1}


def test_repeated_and_reversed_device_times_are_refused() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(100_000, 0, 0), 1) == [(0, 0)]
    for _ in range(20):
        assert read(line, Sample(100_000, 0, 0), 2) == []
    assert read(line, Sample(90_000, 0, 0), 3) == []
    assert read(line, Sample(120_000, 5, 5), 21) == [(5, 5)]
    assert line.refused == {"device time repeated": 20, "device time reversed": 1}


def test_the_device_time_rolls_over() -> None:
    line = EncoderLine(FAST)
    first = line.step(line_from_sample(Sample(2**32 - 10_000, 0, 0)), 500 * MS)
    second = line.step(line_from_sample(Sample(10_000, 7, 7)), 520 * MS)
    assert second[0].stamp_ns - first[0].stamp_ns == 20 * MS


def test_a_device_that_begins_anew_is_taken_up_out_of_reach_of_where_it_was() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(50_000_000, 70_000, 71_000), 1000) == [(70_000, 71_000)]
    out = [read(line, Sample(20_000 * k, 10 * k, 10 * k), 3000 + 20 * k) for k in range(7)]
    far = (70_000 + BREAK, 71_000 + BREAK)
    assert out == [[], [], [], [], [far], [(far[0] + 10, far[1] + 10)], [(far[0] + 20, far[1] + 20)]]
    assert line.refused == {"device time reversed": 5, RESTARTED: 1}


def test_a_lasting_jump_of_the_counts_is_taken_as_a_new_beginning() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(0, 0, 0), 0) == [(0, 0)]
    out = [read(line, Sample(20_000 * k, 50_000 + 10 * k, 10 * k), 20 * k) for k in range(1, 7)]
    assert out[-2:] == [[(BREAK, BREAK)], [(BREAK + 10, BREAK + 10)]]
    assert line.refused == {"count jumps": 5, RESTARTED: 1}


def test_after_a_replug_a_device_that_went_on_loses_no_count() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(0, 0, 0), 100) == [(0, 0)]
    line.step(b"$T,10000,5", 110 * MS)
    line.reopened()
    assert read(line, Sample(3_000_000, 900, 800), 3105) == [(900, 800)]
    assert line.refused == {"line cut off": 1}


def test_after_a_replug_a_device_that_began_anew_is_known_by_its_clock() -> None:
    line = EncoderLine(FAST)
    assert read(line, Sample(1_000_000, 50, 50), 100) == [(50, 50)]
    line.reopened()
    assert read(line, Sample(1_200_000, 3, 3), 5100) == [(BREAK + 50, BREAK + 50)]
    assert read(line, Sample(1_220_000, 5, 5), 5120) == [(BREAK + 52, BREAK + 52)]
    assert line.refused == {RESTARTED: 1}
    line.reopened()
    assert read(line, Sample(40_000, 0, 0), 9000) == [(52, 52)]  # back again: it does not creep out of range


def test_nobody_takes_the_way_across_a_restart_for_known() -> None:
    line, odometer = EncoderLine(FAST), Odometer(FAST, wheel_base_m=0.4)
    stamps = []
    for k in range(1, 40):
        begun_anew = k >= 20
        sample = Sample(20_000 * (k - 19) if begun_anew else 50_000_000 + 20_000 * k, 50 * k, 50 * k)
        for ticks in line.step(line_from_sample(sample), (1000 + 20 * k) * MS):
            odometer.push(ticks)
            stamps.append(ticks.stamp_ns)
    assert odometer.samples(stamps[0], stamps[-1]) is None
    assert odometer.samples(stamps[0], stamps[15]) is not None
    assert odometer.samples(stamps[-5], stamps[-1]) is not None


def test_a_backlog_after_a_stall_is_not_taken_for_a_restart() -> None:
    line = EncoderLine(FAST)
    stall = [read(line, Sample(20_000 * k, 10 * k, 10 * k), 20 * k + 1) for k in range(50)]
    # Read after a pause of 10 s: what the port still held, then what came after its buffer had run over.
    late = [read(line, Sample(20_000 * k, 10 * k, 10 * k), 11_000) for k in [*range(50, 90), *range(530, 550)]]
    assert all(stall)
    assert all(late)
    assert line.refused == {}


@dataclass(frozen=True)
class Way:
    """A device clock and the way of its lines."""

    skew: float
    offset_s: float
    least_delay_s: float
    jitter_s: float


def received(way: Way, seconds: float, seed: int) -> tuple[list[Ticks], np.ndarray]:
    """Ticks of a device read at 50 Hz, and when it really read them."""
    rng = np.random.default_rng(seed)
    line = EncoderLine(UNWIRED)
    read_s = np.arange(0.0, seconds, 0.02) + 100.0
    device_us = np.round((read_s + way.offset_s) * (1.0 + way.skew) * 1e6).astype(np.int64)
    delay_s = way.least_delay_s + rng.exponential(way.jitter_s, len(read_s)) + (rng.random(len(read_s)) < 0.01) * 0.05
    arrival_s = np.maximum.accumulate(read_s + delay_s)
    ticks = [
        ticks
        for us, s in zip(device_us, arrival_s, strict=True)
        for ticks in line.step(line_from_sample(Sample(int(us) % 2**32, 0, 0)), round(s * 1e9))
    ]
    assert len(ticks) == len(read_s)
    return ticks, read_s


@pytest.mark.parametrize("skew", [0.0, 5e-5, -5e-5, 5e-3, -5e-3])
def test_stamps_are_the_readings_times_without_the_jitter_of_the_way(skew: float) -> None:
    way = Way(skew, offset_s=4000.0, least_delay_s=0.001, jitter_s=0.004)
    ticks, read_s = received(way, 90.0, seed=3)
    stamp_s = np.array([t.stamp_ns for t in ticks]) * 1e-9
    error_s = stamp_s - read_s - way.least_delay_s
    settled = read_s > read_s[0] + 10.0
    assert np.abs(error_s[settled]).max() < 0.0015  # arrivals scatter by 4 ms, and by 50 ms at times
    assert np.std(np.diff(stamp_s)[settled[1:]]) < 0.0003
    assert np.abs(error_s).max() < 0.020


@settings(max_examples=30)
@given(
    skew=st.floats(-0.009, 0.009),
    offset_s=st.floats(0, 4294),
    jitter_s=st.floats(0, 0.05),
    seed=st.integers(0, 2**32 - 1),
)
def test_stamps_always_grow_and_never_lie_after_the_arrival(
    skew: float, offset_s: float, jitter_s: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    line, device_s, arrival_ns, before_ns = EncoderLine(Encoder()), offset_s, 10**9, -1
    for _ in range(200):
        elapsed_s = float(rng.uniform(0.001, 0.05))
        device_s += elapsed_s * (1.0 + skew)
        arrival_ns += round(1e9 * (elapsed_s + rng.uniform(0, jitter_s)))
        for ticks in line.step(line_from_sample(Sample(round(device_s * 1e6) % 2**32, 0, 0)), arrival_ns):
            assert before_ns < ticks.stamp_ns <= arrival_ns
            before_ns = ticks.stamp_ns
