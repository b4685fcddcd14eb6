"""Order by stamp: the same whatever the arrival, and never at the mercy of one mad stamp."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.config import Timeline as Settings
from omnivert.messages import Bearings, Message, Scan, Ticks
from omnivert.timeline import LoneStream, Timeline

SECOND = 1_000_000_000
MS = 1_000_000


def ticks(stamp_ns: int) -> Ticks:
    return Ticks(stamp_ns, 0, 0)


def bearings(stamp_ns: int) -> Bearings:
    none = np.zeros(0)
    return Bearings(stamp_ns, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))


def timeline(**settings: float) -> Timeline:
    return Timeline((Ticks, Bearings), Settings.model_validate(settings))


def pushed(line: Timeline, messages: list[Message], replay: bool) -> list[Message]:
    return [out for message in messages for out in line.push(message, replay)]


def stamps(messages: list[Message], stream: type[Message] = object) -> list[int]:  # type: ignore[assignment]
    return [message.stamp_ns for message in messages if isinstance(message, stream)]


def ticking(start_ns: int, count: int, step_ns: int = 20 * MS) -> list[Message]:
    return [ticks(start_ns + i * step_ns) for i in range(count)]


# ------------------------------------------------------------------ order

rising = st.lists(st.integers(0, 30 * SECOND), unique=True, max_size=40).map(sorted)


@given(rising, rising, st.randoms(use_true_random=False))
def test_any_interleaving_of_two_streams_goes_on_in_the_same_order(a: Any, b: Any, chance: Any) -> None:
    streams: list[list[Message]] = [[ticks(s) for s in a], [bearings(s) for s in b]]
    whole = sorted([m for stream in streams for m in stream], key=lambda m: (m.stamp_ns, isinstance(m, Bearings)))
    line = timeline()
    out: list[Message] = []
    while any(streams):
        out += line.push(chance.choice([s for s in streams if s]).pop(0), replay=True)
    out += line.drain()
    assert [(type(m), m.stamp_ns) for m in out] == [(type(m), m.stamp_ns) for m in whole]
    assert not line.refused
    assert not line.late


@given(rising, rising, st.lists(st.tuples(st.integers(0, 79), st.integers(0, 2**62)), max_size=6), st.randoms())
def test_mad_stamps_do_not_make_the_order_depend_on_arrival(a: Any, b: Any, mad: Any, chance: Any) -> None:
    def played(pick: Any) -> Any:
        streams = [[ticks(s) for s in a], [bearings(s) for s in b]]
        for place, stamp in mad:
            stream = streams[place % 2]
            stream.insert(min(place // 2, len(stream)), (ticks, bearings)[place % 2](stamp))
        line = timeline(confirmations=100)
        out: list[Message] = []
        while any(streams):
            out += line.push(pick([s for s in streams if s]).pop(0), replay=True)
        return [(type(m), m.stamp_ns) for m in out + line.drain()]

    first = played(lambda streams: streams[0])
    assert first == sorted(first, key=lambda m: m[1])
    if all(s <= 60 * SECOND for _, s in mad):  # beyond it what a stream begins with is judged by the others' stamps
        assert first == played(chance.choice)


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 2**62)), max_size=60), st.booleans())
def test_whatever_comes_is_given_in_order_or_counted(messages: Any, replay: bool) -> None:
    line = timeline(confirmations=100)
    out = pushed(line, [ticks(s) if which else bearings(s) for which, s in messages], replay) + line.drain()
    assert stamps(out) == sorted(stamps(out))
    assert len(out) + sum(line.refused.values()) + len(line._streams[Ticks]._doubted) + len(
        line._streams[Bearings]._doubted
    ) == len(messages)


def test_at_equal_stamps_the_stream_named_first_goes_first() -> None:
    line = timeline()
    out = pushed(line, [bearings(0), bearings(20 * MS), *ticking(0, 3)], replay=True)
    assert [type(m) for m in out[:2]] == [Ticks, Bearings]


def test_a_message_of_no_stream_is_a_wrong_call() -> None:
    with pytest.raises(ValueError, match="Scan"):
        timeline().push(Scan(0, 0.0, 0.1, np.zeros(0, np.float32)), replay=True)


# ------------------------------------------------------------------ lateness


def test_live_a_stream_that_lags_is_waited_for_no_longer_than_the_lateness() -> None:
    line = timeline(lateness_s=0.25)
    pushed(line, [bearings(0), bearings(10 * MS)], replay=False)
    out = pushed(line, ticking(0, 100), replay=False)
    assert stamps(out, Ticks)[-1] == 99 * 20 * MS - 260 * MS
    assert line.late["Bearings"] > 0
    assert pushed(line, [bearings(SECOND)], replay=False) == []
    assert line.refused["Bearings: came too late"] == 1


def test_on_a_playback_every_message_is_waited_for() -> None:
    line = timeline(lateness_s=0.25)
    pushed(line, [bearings(0), bearings(10 * MS)], replay=True)
    assert stamps(pushed(line, ticking(0, 100), replay=True)) == [0, 0, 10 * MS]
    assert stamps(pushed(line, [bearings(30 * MS)], replay=True)) == [20 * MS, 30 * MS]
    assert not line.late


def test_what_is_held_is_bounded() -> None:
    line = timeline(max_held=100)
    out = pushed(line, ticking(0, 1000), replay=True)
    assert len(out) == 900
    assert stamps(out) == sorted(stamps(out))


# ------------------------------------------------------------------ mad stamps


@pytest.mark.parametrize("replay", [True, False])
@pytest.mark.parametrize(
    ("mad", "reason"),
    [
        (2**62, "stamp far ahead"),
        (300 * SECOND, "stamp far ahead"),
        (0, "reversed stamp"),
        (10 * SECOND, "repeated stamp"),
    ],
)
def test_one_mad_stamp_is_refused_and_changes_nothing(mad: Any, reason: Any, replay: bool) -> None:
    sane = ticking(10 * SECOND, 100), [bearings(10 * SECOND + i * 66 * MS) for i in range(30)]
    merged = sorted([*sane[0], *sane[1]], key=lambda m: m.stamp_ns)
    expected = pushed(timeline(), merged, replay)
    for place in range(4, len(merged)):
        line = timeline()
        stamp = merged[place - 1].stamp_ns if reason == "repeated stamp" else mad
        intruder = type(merged[place - 1]) is Ticks
        out = pushed(line, [*merged[:place], ticks(stamp) if intruder else bearings(stamp), *merged[place:]], replay)
        assert stamps(out) == stamps(expected)
        assert sum(line.refused.values()) <= 1
        assert not line.refused or reason in next(iter(line.refused))


@pytest.mark.parametrize("mad", [2**62, 0])
def test_a_mad_first_stamp_is_refused_too(mad: Any) -> None:
    line = timeline()
    out = pushed(line, [ticks(mad), bearings(100 * SECOND), bearings(100 * SECOND + MS)], replay=False)
    out += pushed(line, ticking(100 * SECOND, 50), replay=False)
    assert stamps(out)[0] == 100 * SECOND
    assert stamps(out) == sorted(stamps(out))
    assert line.refused == {"Ticks: contradicts the next stamp": 1}


# ------------------------------------------------------------------ another clock


@pytest.mark.parametrize("start_ns", [0, 5000 * SECOND], ids=["back", "ahead"])
def test_a_clock_that_has_changed_is_followed(start_ns: Any) -> None:
    line = timeline()

    def drive(at_ns: int, count: int) -> list[Message]:
        messages = [*ticking(at_ns, count), *[bearings(at_ns + 5 * MS + i * 66 * MS) for i in range(count * 20 // 66)]]
        return sorted(messages, key=lambda m: m.stamp_ns)

    before = pushed(line, drive(1000 * SECOND, 100), replay=False)
    after = pushed(line, drive(start_ns, 200), replay=False)
    assert stamps(before)[0] == 1000 * SECOND
    new = [s for s in stamps(after) if abs(s - start_ns) < 10 * SECOND]
    assert len(new) > 200 * 0.9
    assert new == sorted(new)
    assert len(stamps([m for m in after if abs(m.stamp_ns - start_ns) < 10 * SECOND], Bearings)) > 50


def test_stragglers_of_the_old_clock_do_not_bring_it_back() -> None:
    line = timeline()
    pushed(
        line, [*ticking(1000 * SECOND, 50), bearings(1000 * SECOND), bearings(1000 * SECOND + 66 * MS)], replay=False
    )
    out = pushed(line, ticking(0, 10), replay=False)
    out += pushed(line, [bearings(1001 * SECOND), bearings(1001 * SECOND + 66 * MS)], replay=False)
    out += pushed(line, ticking(200 * MS, 50), replay=False)
    assert stamps(out, Ticks)[-1] < 10 * SECOND
    assert all(s < 1002 * SECOND for s in stamps(out))
    out = pushed(line, [bearings(SECOND + i * 66 * MS) for i in range(10)], replay=False)
    assert stamps(out, Bearings)


# ------------------------------------------------------------------ one stream alone


def test_a_lone_stream_goes_on_at_once_and_a_stamp_that_does_not_fit_is_refused() -> None:
    line = LoneStream(Ticks, Settings())
    given = (SECOND, SECOND, SECOND // 2, 2**61, SECOND + MS, SECOND + MS, SECOND + 2 * MS)
    assert [stamps(line.push(ticks(stamp))) for stamp in given] == [
        *([SECOND], [], [], []),
        *([SECOND + MS], [], [SECOND + 2 * MS]),
    ]
    assert line.refused == {"Ticks: repeated stamp": 2, "Ticks: reversed stamp": 1, "Ticks: stamp far ahead": 1}


def test_a_lone_stream_whose_clock_has_changed_goes_on_when_enough_agree() -> None:
    line = LoneStream(Ticks, Settings(confirmations=3))
    out = [stamps(line.push(message)) for message in (*ticking(2**61, 2), *ticking(SECOND, 4))]
    later = stamps(ticking(SECOND, 4))
    assert out == [[2**61], [2**61 + 20 * MS], [], [], later[:3], later[3:]]
    assert not line.refused
