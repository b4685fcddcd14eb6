"""The bus on real zenoh, through a router of its own, within one process."""

import threading
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
import zenoh

from omnivert.config import Config, parsed
from omnivert.errors import DataError, UseError
from omnivert.messages import Bearings, Extrinsics, Frame, Health, Mount, PixelFormat, Playback, State, Ticks
from omnivert.wire import bus as module
from omnivert.wire import listening
from omnivert.wire.bus import Bus, Received, Router
from omnivert.wire.channels import BEARINGS, EXTRINSICS, FRAME, HEALTH, PLAYBACK, TICKS, Channel
from omnivert.wire.codec import encode
from omnivert.wire.envelope import Envelope
from omnivert.wire.settings import client_settings

DEADLINE_S = 10.0


@pytest.fixture
def router(config: Config) -> Iterator[Router]:
    with Router(config) as open_router:
        yield open_router


def met(*buses: Bus) -> None:
    """Waits until each sees all others."""
    for bus in buses:
        bus.ready()
    for bus in buses:
        others = {(other.service, other.instance) for other in buses if other is not bus}
        assert bus.await_presence(partial(seen_by, bus, others), DEADLINE_S)


def seen_by(bus: Bus, others: set[tuple[str, str]]) -> bool:
    return others <= bus.present()


def until(heard: Iterator[Received | None], holds: Callable[[Received], bool]) -> list[Received]:
    """What is heard up to the first message that `holds`."""
    out: list[Received] = []
    silent = 0
    for received in heard:
        if received is None:
            silent += 1
            assert silent < DEADLINE_S
            continue
        out.append(received)
        if holds(received):
            return out
    raise AssertionError("the bus ended")


def numbers(received: list[Received], channel: Channel = TICKS) -> list[int]:
    return [r.message.stamp_ns for r in received if r.channel is channel]


def frame(number: int, size: int = 300_000) -> Frame:
    return Frame(number, PixelFormat.PNG, 4, 4, np.full(size, number % 256, np.uint8))


def extrinsics(stamp_ns: int) -> Extrinsics:
    mount = Mount(0.0, 0.1, 0.0, np.eye(3))
    return Extrinsics(stamp_ns, "demo", "front", mount, State.CALIBRATED, 1, (), "omnivert 0", "0")


def health_of(bus: Bus) -> Health:
    return bus._meter.health(1)


# ------------------------------------------------------------------ streams


@pytest.mark.usefixtures("router")
def test_messages_arrive_in_order_with_their_envelope(config: Config) -> None:
    with Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b:
        heard = a.listen(TICKS)
        met(a, b)
        for i in range(300):
            b.publish(TICKS, Ticks(i, i, i), replay=True)
        got = until(heard, lambda r: r.message.stamp_ns == 299)
        assert numbers(got) == list(range(300))
        assert {r.run for r in got} == {r.publisher for r in got} == {b.incarnation}
        assert [r.sequence for r in got] == list(range(300))
        assert all(r.replay and r.same_clock for r in got)
        a.done(got[-1])
        counted = health_of(a)
        assert counted.received["v1/encoder/base/ticks"] == 300
        assert not counted.gaps
        assert counted.latency_p50_ms is not None


@pytest.mark.usefixtures("router")
def test_a_result_belongs_to_the_run_of_what_led_to_it(config: Config) -> None:
    with Bus(config, "vision", "front") as a, Bus(config, "player", "front") as b, Bus(config, "monitor", "m") as c:
        frames, results = a.listen(FRAME), c.listen(BEARINGS)
        met(a, b, c)
        b.publish(FRAME, frame(7), replay=True)
        cause = until(frames, lambda r: True)[0]
        none = np.zeros(0)
        bearings = Bearings(7, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))
        a.publish(BEARINGS, bearings, cause=cause)
        result = until(results, lambda r: True)[0]
        assert (result.run, result.replay, result.publisher) == (b.incarnation, True, a.incarnation)


def has_received(bus: Bus, key: str, count: int) -> bool:
    return health_of(bus).received.get(key) == count


@pytest.mark.usefixtures("router")
def test_a_consumer_that_is_late_takes_the_newest_live_frame_and_counts_the_others(config: Config) -> None:
    with Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b:
        heard = a.listen(FRAME, TICKS)
        met(a, b)
        received = "v1/camera/front/frame"
        for i in range(20):  # one by one: of a burst the bus itself may drop some
            b.publish(FRAME, frame(i))
            wait(partial(has_received, a, received, i + 1))
        b.publish(TICKS, Ticks(99, 0, 0))
        got = until(heard, lambda r: r.channel is TICKS)
        assert numbers(got, FRAME) == [19]
        assert health_of(a).dropped == {"v1/camera/front/frame": 19}


@pytest.mark.usefixtures("router")
def test_of_a_playback_every_frame_is_taken(config: Config) -> None:
    with Bus(config, "vision", "front") as a, Bus(config, "player", "front") as b:
        heard = a.listen(FRAME)
        met(a, b)
        for i in range(20):
            b.publish(FRAME, frame(i, 20_000), replay=True)
        got = until(heard, lambda r: r.message.stamp_ns == 19)
        assert numbers(got, FRAME) == list(range(20))
        assert [int(r.message.data[0]) for r in got if isinstance(r.message, Frame)] == list(range(20))


@pytest.mark.usefixtures("router")
def test_silence_is_told_so_that_a_loop_can_do_something_else(config: Config) -> None:
    with Bus(config, "vision", "front") as a:
        assert next(a.listen(TICKS, period_s=0.01)) is None


@pytest.mark.usefixtures("router")
def test_health_comes_by_itself_and_once_more_at_the_end(config: Config) -> None:
    with Bus(config, "monitor", "m") as a:
        heard = a.listen(HEALTH)
        with Bus(config, "vision", "front") as b:
            met(a, b)
            first = until(heard, lambda r: r.key == "v1/vision/front/health")[-1]
            b.refuse("dark", 3)
            b.note("slow", "disk")
        last = until(heard, lambda r: isinstance(r.message, Health) and bool(r.message.notes))[-1]
        assert isinstance(first.message, Health)
        assert isinstance(last.message, Health)
        assert last.message.refused == {"dark": 3}
        assert last.message.notes == ("slow",)


def wait(holds: Callable[[], bool]) -> None:
    """Until something that has no event of its own holds."""
    pause = threading.Event()
    for _ in range(int(DEADLINE_S / 0.01)):
        if holds():
            return
        pause.wait(0.01)
    raise AssertionError("it did not come")


# ------------------------------------------------------------------ bad input


@pytest.mark.usefixtures("router")
def test_whatever_strangers_put_on_a_key_is_counted_and_the_stream_goes_on(config: Config) -> None:
    settings = module._zenoh_config(client_settings(config))
    good = Envelope(b"s" * 8, b"s" * 8, 0, 0).packed()
    key = TICKS.key(config)
    with Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b, zenoh.open(settings) as stranger:
        heard = a.listen(TICKS)
        met(a, b)
        stranger.put(key, encode(Ticks(1, 1, 1)))
        stranger.put(key, encode(Ticks(1, 1, 1)), attachment=b"x")
        stranger.put(key, b"\x00\xff", attachment=good)
        stranger.put(key, b"", attachment=good)
        stranger.put(key, encode(Ticks(1, 1, 1))[:-1], attachment=good)
        stranger.put(key, encode(frame(1)), attachment=good)
        stranger.put(key, bytes(300_000), attachment=good)
        stranger.delete(key)
        wait(lambda: sum(health_of(a).received.values()) + sum(health_of(a).refused.values()) >= 8)
        b.publish(TICKS, Ticks(5, 5, 5))
        assert numbers(until(heard, lambda r: True)) == [5]
        refused = health_of(a).refused
    assert refused[f"{key}: no envelope"] == 3
    assert refused[f"{key}: not msgpack"] == 4
    assert refused[f"{key}: not Ticks"] == 1


@pytest.mark.usefixtures("router")
@pytest.mark.parametrize("pattern", ["v1/**", "v1/*/*/ticks", "v1/encoder/ba$*/ticks"])
def test_what_is_sent_to_a_pattern_of_keys_is_nobodys_message(config: Config, pattern: str) -> None:
    settings = module._zenoh_config(client_settings(config))
    with Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b, zenoh.open(settings) as stranger:
        heard = a.listen(TICKS)
        met(a, b)
        stranger.put(pattern, encode(Ticks(1, 1, 1)), attachment=Envelope(b"s" * 8, b"s" * 8, 0, 0).packed())
        wait(lambda: health_of(a).refused == {f"{TICKS.key(config)}: sent to a pattern of keys": 1})
        b.publish(TICKS, Ticks(5, 5, 5))
        assert numbers(until(heard, lambda r: True)) == [5]


@pytest.mark.usefixtures("router")
@pytest.mark.parametrize("name", ["\x1b[2J", "x" * 100])
def test_a_key_that_no_screen_should_show_goes_by_its_pattern(config: Config, name: str) -> None:
    settings = module._zenoh_config(client_settings(config))
    with Bus(config, "monitor", "x") as a, Bus(config, "bridge", "front") as b, zenoh.open(settings) as stranger:
        heard = a.listen(HEALTH)
        met(a, b)  # the router knows what is listened to
        attachment = Envelope(b"s" * 8, b"s" * 8, 0, 0).packed()
        stranger.put(f"v1/vision/{name}/health", encode(Health(1, "vision", "odd", 0.0)), attachment=attachment)
        last = until(heard, lambda r: isinstance(r.message, Health) and r.message.instance == "odd")[-1]
        assert last.key == HEALTH.key(config)


@pytest.mark.usefixtures("router")
def test_messages_that_are_too_large_are_neither_sent_nor_taken(config: Config) -> None:
    small = config.model_copy(update={"bus": config.bus.model_copy(update={"max_message_bytes": 1024})})
    with Bus(small, "vision", "front") as a, Bus(config, "bridge", "front") as b:
        heard = a.listen(FRAME, TICKS)
        met(a, b)
        b.publish(FRAME, frame(1, 5000))
        b.publish(TICKS, Ticks(1, 1, 1))
        until(heard, lambda r: r.channel is TICKS)
        wait(lambda: health_of(a).refused == {"v1/camera/front/frame: too large": 1})
        a.publish(FRAME, frame(1, 5000))
        assert health_of(a).refused["v1/camera/front/frame: too large to send"] == 1


@pytest.mark.usefixtures("router")
def test_an_exception_in_a_callback_is_counted_and_the_stream_goes_on(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b:
        heard = a.listen(TICKS)
        met(a, b)
        with monkeypatch.context() as broken:
            broken.setattr(listening, "Parcel", None)
            b.publish(TICKS, Ticks(1, 1, 1))
            wait(lambda: "v1/encoder/base/ticks: TypeError in the callback" in health_of(a).refused)
        b.publish(TICKS, Ticks(2, 2, 2))
        assert numbers(until(heard, lambda r: True)) == [2]


@pytest.mark.usefixtures("router")
def test_what_does_not_keep_its_form_is_a_wrong_call(config: Config) -> None:
    with Bus(config, "bridge", "front") as b:
        with pytest.raises(ValueError, match="does not belong"):
            b.publish(TICKS, frame(1))
        with pytest.raises(ValueError, match="out of range"):
            b.publish(TICKS, Ticks(-1, 0, 0))
    with pytest.raises(ValueError, match="key"):
        Bus(config, "a/b", "c")


# ------------------------------------------------------------------ questions


@pytest.mark.usefixtures("router")
def test_whoever_asks_gets_the_newest_answer_of_all(config: Config) -> None:
    with Bus(config, "storage", "s") as a, Bus(config, "calibration", "c") as b, Bus(config, "monitor", "m") as c:
        assert c.ask(EXTRINSICS, DEADLINE_S) is None
        a.answer(EXTRINSICS, lambda: extrinsics(5))
        b.answer(EXTRINSICS, lambda: extrinsics(7))
        met(a, b, c)
        newest = c.ask(EXTRINSICS, DEADLINE_S)
        assert newest is not None
        assert newest.stamp_ns == 7
        own = b.ask(EXTRINSICS, DEADLINE_S)
        assert own is not None
        assert own.stamp_ns == 5


@pytest.mark.usefixtures("router")
def test_an_answer_that_fails_is_counted_on_both_sides(config: Config) -> None:
    def fails() -> Extrinsics:
        raise KeyError("x")

    with Bus(config, "storage", "s") as a, Bus(config, "monitor", "m") as c:
        a.answer(EXTRINSICS, fails)
        met(a, c)
        assert c.ask(EXTRINSICS, DEADLINE_S) is None
        assert health_of(a).refused == {"v1/calibration/front/extrinsics: KeyError in the answer": 1}
        assert health_of(c).refused == {"v1/calibration/front/extrinsics: an answer failed": 1}


# ------------------------------------------------------------------ presence, robots


@pytest.mark.usefixtures("router")
def test_two_robots_on_one_router_do_not_see_each_other(config: Config) -> None:
    other = parsed({**config.model_dump(mode="json"), "robot": {"id": "other"}}, "the test")
    with Bus(config, "vision", "a") as a, Bus(other, "vision", "b") as b, Bus(config, "bridge", "c") as c:
        heard, silent = a.listen(TICKS, HEALTH), b.listen(TICKS, HEALTH, period_s=0.01)
        a.answer(EXTRINSICS, lambda: extrinsics(1))
        met(a, c)
        assert b.ask(EXTRINSICS) is None
        for i in range(50):
            c.publish(TICKS, Ticks(i, 0, 0))
        until(heard, lambda r: r.message.stamp_ns == 49)
        assert next(silent) is None or next(silent) is None
        assert set(health_of(b).received) <= {"v1/vision/b/health"}
        assert b.present() == frozenset()
        assert c.present() == {("vision", "a")}
    with Bus(other, "monitor", "m") as m, Bus(other, "bridge", "x") as x:
        watching = m.listen(HEALTH)
        met(m, x)
        assert until(watching, lambda r: r.key == "v1/bridge/x/health")


@pytest.mark.usefixtures("router")
def test_a_service_refuses_to_stand_beside_another_that_publishes_the_same(config: Config) -> None:
    with Bus(config, "bridge", "a") as bridge, Bus(config, "player", "b") as player:
        bridge.refuse_beside("player", "bridge")
        with pytest.raises(UseError, match="beside another bridge") as refused:
            player.refuse_beside("bridge", "player")
        assert refused.value.code == "OV402"


@pytest.mark.usefixtures("router")
def test_a_service_is_here_when_it_listens_and_gone_when_it_has_closed(config: Config) -> None:
    with Bus(config, "monitor", "m") as a:
        with Bus(config, "vision", "front") as b:
            b.listen(FRAME)
            assert a.await_presence(lambda: ("vision", "front") in a.present(), DEADLINE_S)
            assert a.alive(b.incarnation)
            assert a.incarnations("vision") == {b.incarnation}
        assert a.await_presence(lambda: not a.present(), DEADLINE_S)


# ------------------------------------------------------------------ opening and closing


def test_without_a_router_an_impatient_bus_says_so(config: Config) -> None:
    with pytest.raises(DataError, match="no router") as refused, Bus(config, "monitor", "m", patience_s=0.0):
        pass
    assert refused.value.code == "OV401"


def test_a_bus_that_is_stopped_while_it_connects_hears_nothing_and_says_nothing(config: Config) -> None:
    bus = Bus(config, "vision", "front")
    threading.Timer(0.1, bus.stop).start()
    with bus:
        assert list(bus.listen(TICKS)) == []
        assert bus.ask(EXTRINSICS) is None
        bus.publish(PLAYBACK, Playback(0, 0, 0, False))
        bus.refuse_beside("player")


def test_a_bus_waits_for_its_router(config: Config) -> None:
    opened = threading.Event()
    seen: list[object] = []

    def service() -> None:
        with Bus(config, "vision", "front") as bus:
            opened.set()
            seen.extend(bus.listen(TICKS, period_s=0.01).__next__() for _ in range(1))

    thread = threading.Thread(target=service)
    thread.start()
    with Router(config):
        assert opened.wait(DEADLINE_S)
        thread.join(DEADLINE_S)
    assert seen == [None]


def test_a_router_that_cannot_listen_says_where(config: Config) -> None:
    wrong = config.model_copy(update={"bus": config.bus.model_copy(update={"endpoint": "tcp/256.0.0.1:1"})})
    with pytest.raises(DataError, match=r"256\.0\.0\.1") as refused, Router(wrong):
        pass
    assert refused.value.code == "OV403"


@pytest.mark.usefixtures("router")
def test_listening_ends_when_the_bus_stops(config: Config) -> None:
    with Bus(config, "vision", "front") as a:
        heard = a.listen(TICKS, period_s=60.0)
        threading.Timer(0.05, a.stop).start()
        assert list(heard) == []


def test_services_come_back_when_the_router_does(config: Config) -> None:
    with Router(config) as first, Bus(config, "vision", "front") as a, Bus(config, "bridge", "front") as b:
        heard = a.listen(TICKS, period_s=0.05)
        a.answer(EXTRINSICS, lambda: extrinsics(7))
        met(a, b)
        first.__exit__(None, None, None)
        assert a.await_presence(lambda: not a.present(), DEADLINE_S)
        with Router(config):
            met(a, b)
            stamps = iter(range(10_000))
            while next(heard) is None:
                b.publish(TICKS, Ticks(next(stamps), 0, 0))
            assert b.ask(EXTRINSICS, DEADLINE_S) is not None


def test_the_door_is_closed_by_default() -> None:
    made = module._zenoh_config(client_settings(Config()))
    assert made.get_json("scouting/multicast/enabled") == "false"
    assert made.get_json("scouting/gossip/enabled") == "false"
    assert made.get_json("mode") == '"client"'
