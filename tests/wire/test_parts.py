"""The bus's parts that need no bus: envelope, inbox, meter, presence, sources."""

import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.config import Config, parsed
from omnivert.messages import Ticks
from omnivert.wire import channels
from omnivert.wire.channels import CHANNELS, FRAME, TICKS, channel_from_key, presence_key
from omnivert.wire.codec import decode, encode
from omnivert.wire.envelope import Envelope
from omnivert.wire.inbox import Inbox, Parcel
from omnivert.wire.listening import taken
from omnivert.wire.meter import Meter
from omnivert.wire.once import Once
from omnivert.wire.presence import Presence
from omnivert.wire.received import Received
from omnivert.wire.settings import client_settings, router_settings
from omnivert.wire.sources import Admission, Sources

A, B, C = (letter * 8 for letter in (b"a", b"b", b"c"))


def parcel(channel: channels.Channel, number: int, replay: bool = False, size: int = 1) -> Parcel:
    return Parcel(channel, channel.key(Config()), Envelope(A, A, number, 0, replay), bytes(size))


# ------------------------------------------------------------------ channels and envelope


def test_every_key_leads_back_to_its_channel_and_has_four_chunks() -> None:
    for channel in CHANNELS:
        key = channel.key(Config())
        assert channel_from_key(key.replace("*", "x")) is channel
        assert key.count("/") == 3
    assert channel_from_key("v1/encoder/base/frame") is None
    assert channel_from_key("v2/encoder/base/ticks") is None
    assert channel_from_key("") is None


@given(st.binary(min_size=8, max_size=8), st.integers(0, 2**64 - 1), st.integers(-(2**63), 2**63 - 1), st.booleans())
def test_an_envelope_comes_back_as_it_was(who: Any, sequence: Any, sent_ns: Any, replay: bool) -> None:
    envelope = Envelope(who, A, sequence, sent_ns, replay)
    assert Envelope.unpacked(envelope.packed()) == envelope


@given(st.binary(max_size=60))
def test_other_bytes_are_no_envelope(data: Any) -> None:
    assert Envelope.unpacked(data) is None


# ------------------------------------------------------------------ inbox


def test_live_only_the_newest_frame_waits_and_the_displaced_are_given_back() -> None:
    inbox = Inbox(100, 10_000)
    inbox.put(parcel(TICKS, 0))
    displaced = [gone for i in range(5) for gone in inbox.put(parcel(FRAME, i))]
    inbox.put(parcel(TICKS, 1))
    taken = [inbox.take(0.0) for _ in range(4)]
    assert [(p.channel, p.envelope.sequence) for p in taken if p] == [(TICKS, 0), (FRAME, 4), (TICKS, 1)]
    assert [gone.envelope.sequence for gone in displaced] == [0, 1, 2, 3]


@pytest.mark.parametrize(("replay", "every"), [(True, False), (False, True)])
def test_of_a_playback_and_for_whoever_must_miss_none_every_frame_waits(replay: bool, every: bool) -> None:
    inbox = Inbox(100, 10_000, every)
    for i in range(5):
        assert inbox.put(parcel(FRAME, i, replay)) == []
    assert len(inbox) == 5


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 400)), max_size=60))
def test_the_inbox_is_bounded_and_what_goes_in_comes_out_or_is_given_back(puts: Any) -> None:
    inbox = Inbox(max_messages=10, max_bytes=1000)
    displaced = 0
    for i, (live_frame, size) in enumerate(puts):
        displaced += len(inbox.put(parcel(FRAME if live_frame else TICKS, i, size=size)))
        assert len(inbox) <= 10
    taken = []
    while (p := inbox.take(0.0)) is not None:
        taken.append(p)
    assert len(taken) + displaced == len(puts)
    assert sum(len(p.data) for p in taken) <= 1000


def test_closing_the_inbox_wakes_up_whoever_waits() -> None:
    inbox = Inbox(10, 1000)
    taken: list[object] = []
    waiting = threading.Thread(target=lambda: taken.append(inbox.take(60.0)))
    waiting.start()
    inbox.close()
    waiting.join(10.0)
    assert taken == [None]


def test_a_copy_is_refused_and_one_that_is_no_message_keeps_out_nobody() -> None:
    """Copies with a wrong bit carry the envelope of their originals."""
    inbox, meter, key = Inbox(100, 10_000), Meter("vision", "front", 0), TICKS.key(Config())
    envelopes = [Envelope(A, A, number, 0) for number in range(3)]
    torn, genuine, copy = b"\x00\xff", encode(Ticks(1, 1, 1)), encode(Ticks(2**61, 9, 9))
    for envelope in (envelopes[0], Envelope(A, A, 2**60, 0), envelopes[1], envelopes[2]):
        for data in (torn, genuine, copy):
            inbox.put(Parcel(TICKS, key, envelope, data))
    inbox.put(Parcel(TICKS, key, Envelope(B, B, 0, 0), genuine))  # another's first one
    got = [received for received, _ in zip(taken(inbox, meter, 10.0), range(5), strict=False) if received]
    assert [(r.publisher, r.sequence, r.message.stamp_ns) for r in got] == [
        *((A, number, 1) for number in (0, 2**60, 1, 2)),
        (B, 0, 1),
    ]
    assert meter.health(0).refused == {f"{key}: not msgpack": 4, f"{key}: the same sequence number again": 4}


def test_what_has_been_taken_is_remembered_within_bounds() -> None:
    once = Once()
    for number in range(3000):
        once.take("k", Envelope(A, A, number, 0))
    assert [once.has_taken("k", Envelope(A, A, number, 0)) for number in (0, 2000, 2999)] == [False, True, True]
    for number in range(500):
        once.take("k", Envelope(number.to_bytes(8, "big"), A, 0, 0))
    assert not once.has_taken("k", Envelope(A, A, 2999, 0))


@pytest.mark.parametrize("every", [True, False])
def test_what_came_before_the_end_is_given_to_whoever_must_miss_none(every: bool) -> None:
    inbox = Inbox(100, 10_000, every)
    for number in range(3):
        inbox.put(parcel(TICKS, number))
    inbox.close()
    assert inbox.put(parcel(TICKS, 3)) == []
    given = [p.envelope.sequence for p in iter(lambda: inbox.take(0.0), None)]
    assert (given, inbox.closed) == ([0, 1, 2] if every else [], True)


# ------------------------------------------------------------------ meter


def health(meter: Meter) -> Any:
    found = meter.health(10)
    assert decode(encode(found)).service == "vision"  # type: ignore[union-attr]
    return found


@given(st.lists(st.integers(0, 50), unique=True, min_size=1))
def test_what_is_missing_by_number_is_counted(numbers: Any) -> None:
    meter = Meter("vision", "front", 0)
    for number in sorted(numbers):
        meter.received("k", Envelope(A, A, number, 0))
    missing = max(numbers) - min(numbers) + 1 - len(numbers)
    assert health(meter).gaps.get("k", 0) == missing
    assert not health(meter).reordered


@given(st.integers(2**32, 2**64 - 1))
def test_a_number_that_is_out_of_all_reason_tells_of_no_loss(wrong: int) -> None:
    meter = Meter("vision", "front", 0)
    for number in (3, wrong, 5, 6):
        meter.received("k", Envelope(A, A, number, 0))
    found = health(meter)
    assert (found.received, found.gaps, found.reordered) == ({"k": 4}, {"k": 1}, {})


def test_what_comes_twice_or_late_and_from_another_process_is_counted_apart() -> None:
    meter = Meter("vision", "front", 0)
    for who, number in ((A, 5), (A, 5), (A, 4), (A, 6), (B, 0), (B, 1)):
        meter.received("k", Envelope(who, who, number, 0))
    found = health(meter)
    assert (found.received, found.reordered, found.restarts, found.gaps) == ({"k": 6}, {"k": 2}, {"k": 1}, {})


def test_a_flood_of_keys_reasons_and_publishers_stays_bounded() -> None:
    meter = Meter("vision", "front", 0)
    for i in range(5000):
        meter.received(f"k{i}", Envelope(i.to_bytes(8, "big"), A, i, 0))
        meter.refused(f"reason {i} " + "x" * 2000)
        meter.note("n" * 5000, about=str(i))
    found = health(meter)
    assert len(found.received) < 300
    assert sum(found.received.values()) == 5000
    assert sum(found.refused.values()) == 5000


def test_latency_is_told_as_percentiles() -> None:
    meter = Meter("vision", "front", 0)
    for ms in range(1, 101):
        meter.latency(ms * 1_000_000)
    found = health(meter)
    assert found.latency_p50_ms == pytest.approx(50.5)
    assert found.latency_p99_ms == pytest.approx(99.01)


@pytest.mark.parametrize("duration_ns", [2**63, 10**16, -1])
def test_a_time_that_cannot_be_is_no_latency(duration_ns: int) -> None:
    meter = Meter("vision", "front", 0)
    meter.latency(duration_ns)
    assert health(meter).latency_p99_ms is None


def test_texts_with_bytes_that_are_no_utf8_can_be_sent() -> None:
    meter = Meter("vision", "front", 0)
    name = b"frame\xff.png".decode(errors="surrogateescape")
    meter.refused(f"camera: {name}")
    meter.note(f"camera: {name}", "camera")
    found = health(meter)
    assert (list(found.refused), found.notes) == (["camera: frame?.png"], ("camera: frame?.png",))


def test_a_note_stays_until_it_is_taken_back() -> None:
    meter = Meter("vision", "front", 0)
    meter.note("dark", "camera")
    meter.note("slow", "disk")
    meter.note(None, "camera")
    assert health(meter).notes == ("slow",)


# ------------------------------------------------------------------ presence


def test_presence_knows_the_others_by_service_and_by_process() -> None:
    presence = Presence("vision", "front", A)
    for who in (A, B, C):
        presence.token(presence_key("vision", "front", who.hex()), here=True)
    presence.token("v1/@live/vision/front/no-number", here=True)
    presence.token("nonsense", here=True)
    assert presence.services() == {("vision", "front")}
    assert presence.incarnations("vision") == {B, C}
    presence.token(presence_key("vision", "front", B.hex()), here=False)
    assert presence.alive(C)
    assert not presence.alive(B)
    assert not presence.alive(A)


# ------------------------------------------------------------------ sources


def heard(run: bytes, replay: bool, channel: channels.Channel = TICKS) -> Received:
    return Received(channel, channel.key(Config()), Ticks(0, 0, 0), 0, replay, run, run, 0)


class World:
    def __init__(self) -> None:
        self.alive: set[bytes] = set()
        self.sources = Sources(lambda who: who in self.alive)

    def hears(self, run: bytes, replay: bool, channel: channels.Channel = TICKS) -> Admission:
        return self.sources.admission(heard(run, replay, channel))


def test_a_second_playback_begins_anew_and_what_was_left_of_the_first_is_refused() -> None:
    world = World()
    assert [world.hears(run, True) for run in (A, A, B, B, A)] == ["fresh", "same", "fresh", "same", "refused"]


@pytest.mark.parametrize("replay", [True, False])
def test_while_a_source_is_alive_no_other_one_is_heard(replay: bool) -> None:
    world = World()
    world.alive = {A, B}
    assert world.hears(A, replay) is Admission.FRESH
    assert [world.hears(B, other) for other in (True, False)] == ["refused", "refused"]
    assert world.hears(A, replay) is Admission.SAME


def test_live_a_bridge_that_comes_back_goes_on_with_the_same_drive() -> None:
    world = World()
    answers = [world.hears(A, False), world.hears(A, False, FRAME), world.hears(B, False), world.hears(B, False, FRAME)]
    assert answers == ["fresh", "same", "same", "same"]


def test_from_a_playback_to_live_and_back_everything_begins_anew() -> None:
    world = World()
    assert [world.hears(A, True), world.hears(B, False), world.hears(C, True)] == ["fresh", "fresh", "fresh"]


# ------------------------------------------------------------------ a closed door


def test_services_listen_nowhere_and_nobody_is_scouted_for() -> None:
    config = parsed({"robot": {"id": "r7"}}, "the test")
    client, router = client_settings(config), router_settings(config)
    assert client["mode"] == "client"
    assert "listen/endpoints" not in client
    assert client["namespace"] == "omnivert/r7"
    assert router["listen/endpoints"] == ["tcp/127.0.0.1:7447"]
    for settings in (client, router):
        assert not settings["scouting/multicast/enabled"]
        assert not settings["scouting/gossip/enabled"]
