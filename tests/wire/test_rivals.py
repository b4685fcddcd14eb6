"""Two services that would publish the same: real processes on a real router, which begin at the same moment."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from omnivert.config import Config
from omnivert.errors import DataError, UseError
from omnivert.wire import rivals
from omnivert.wire.bus import Bus, Router
from omnivert.wire.presence import Presence

ROUNDS = 25
RIVAL = """
import sys, time
from omnivert.config import parsed
from omnivert.errors import UseError
from omnivert.wire import rivals
from omnivert.wire.bus import Bus
rivals.LEAVE_S = 1.0
service, other, endpoint = sys.argv[1:]
config = parsed({"bus": {"endpoint": endpoint}}, "the test")
for _ in sys.stdin:  # a line begins the round, the next one ends it
    with Bus(config, service, "front") as bus:
        print("here", flush=True)
        sys.stdin.readline()
        began = ended = 0  # of what is published; who is refused never began
        try:
            bus.refuse_beside("bridge", "player")
            began, stays = time.monotonic_ns(), True
            if (service, other) == ("player", "bridge"):
                stays = not bus.await_presence(lambda: bool(bus.incarnations("bridge")), 30.0)
            ended = time.monotonic_ns()
        except UseError as error:
            stays = error.code != "OV402"
        if not stays:
            bus.__exit__(None, None, None)
        print(stays, began, ended, flush=True)
        sys.stdin.readline()
"""


class Rival:
    """A process that tries to be the one, round by round."""

    def __init__(self, service: str, other: str, config: Config) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", RIVAL, service, other, config.bus.endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def say(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()

    def hear(self) -> list[str]:
        assert self.process.stdout is not None
        return self.process.stdout.readline().split()


@pytest.mark.parametrize("pair", [("bridge", "player"), ("player", "player")], ids=" and ".join)
def test_of_two_that_begin_at_once_exactly_one_stays(config: Config, pair: tuple[str, str]) -> None:
    with Router(config), Bus(config, "lookout", "all") as lookout:
        both = [Rival(pair[0], pair[1], config), Rival(pair[1], pair[0], config)]
        try:
            for number in range(ROUNDS):
                for say_then in ("here", "decided"):
                    for rival in both if number % 2 else both[::-1]:
                        rival.say()
                    told = [rival.hear() for rival in both]
                    assert all(told), f"a process ended before it was {say_then}"
                    if say_then == "here":  # and those of the round before are gone
                        assert lookout.await_presence(lambda: not lookout.present(), 30.0)
                stays = [line[0] == "True" for line in told]
                assert sorted(stays) == [False, True]
                if pair[0] != pair[1]:
                    assert stays[0], "the player gives way to the bridge"
                    assert int(told[1][2]) <= int(told[0][1]), "the bridge waits until the player has gone"
                for rival in both:
                    rival.say()
        finally:
            for rival in both:
                rival.process.kill()
                rival.process.communicate()


def known(presence: Presence, answers: list[frozenset[str] | None], stopped: Callable[[], bool]) -> rivals.Known:
    return rivals.Known(presence, lambda: answers.pop(0) if len(answers) > 1 else answers[0], ("bridge",), stopped)


def test_no_answer_is_not_taken_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rivals, "ASK_AGAIN_S", 0.0)
    bridge = Presence("bridge", "front", b"b" * 8)
    presence = Presence("player", "front", b"a" * 8)
    assert (
        known(presence, [None, None, frozenset({bridge.key})], lambda: False).settled(lambda: None, False) == "bridge"
    )
    assert known(presence, [frozenset({presence.key})], lambda: False).settled(lambda: None, False) == ""
    assert known(presence, [None], lambda: True).settled(lambda: None, False) == ""


def test_who_is_seen_by_presence_alone_is_there_too() -> None:
    presence = Presence("player", "front", b"a" * 8)
    presence.token(Presence("bridge", "front", b"b" * 8).key, here=True)
    assert known(presence, [frozenset()], lambda: False).settled(lambda: None, False) == "bridge"


def test_a_player_that_is_refused_has_not_shown_itself(config: Config) -> None:
    with Router(config), Bus(config, "player", "a") as first, Bus(config, "player", "b") as second:
        first.refuse_beside("bridge", "player")
        with pytest.raises(UseError, match="beside another player"):
            second.refuse_beside("bridge", "player")
        assert first.present() == frozenset()


def test_a_bridge_stands_beside_that_of_another_camera_not_beside_one_of_its_own(
    config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rivals, "LEAVE_S", 0.1)
    with Router(config), Bus(config, "bridge", "front") as simulator, Bus(config, "bridge", "rear") as other:
        simulator.refuse_beside("player")
        other.refuse_beside("player", namesakes=("bridge",))
        with (
            Bus(config, "bridge", "front") as bridge,
            pytest.raises(UseError, match="beside another bridge") as refused,
        ):
            bridge.refuse_beside("player", namesakes=("bridge",))
        assert "robot.id" in refused.value.help


def test_a_bridge_that_is_started_again_waits_for_the_one_that_has_died(config: Config) -> None:
    with Router(config), Bus(config, "bridge", "front") as again:
        with Bus(config, "bridge", "front") as before:
            before.ready()
            assert again.await_presence(lambda: bool(again.incarnations("bridge")), 30.0)
            leaving = threading.Timer(0.3, before.__exit__, (None, None, None))
            leaving.start()
            again.refuse_beside("player", namesakes=("bridge",))
            leaving.join()
        assert not again.incarnations("bridge")


@pytest.mark.parametrize("broken", ["no router", "timed out", "another router"])
def test_an_answer_counts_only_from_a_router_that_was_there_all_the_while(broken: str) -> None:
    seen = {"no router": ((), ()), "timed out": (("r",), ("r",)), "another router": (("r",), ("s",))}
    routers: Iterator[tuple[str, ...]] = iter(seen[broken])
    reply = SimpleNamespace(ok=None if broken == "timed out" else SimpleNamespace(key_expr="v1/@live/x/y/00"))
    session: Any = SimpleNamespace(
        info=SimpleNamespace(routers_zid=lambda: next(routers)),
        liveliness=lambda: SimpleNamespace(get=lambda *_, **__: [reply]),
    )
    assert rivals.tokens(session, ZeroDivisionError) is None


def test_a_second_router_says_in_one_line_that_there_is_one(config: Config, tmp_path: Path) -> None:
    with Router(config), pytest.raises(DataError) as refused, Router(config):
        pass
    error = refused.value
    assert (error.code, error.because) == ("OV403", "another router listens there already")
    nowhere = config.model_copy(
        update={"bus": config.bus.model_copy(update={"endpoint": f"unixsock-stream/{tmp_path}/no/bus"})}
    )
    with pytest.raises(DataError, match="its folder does not exist"), Router(nowhere):
        pass
    unknown = config.model_copy(update={"bus": config.bus.model_copy(update={"endpoint": "foo/bar:1"})})
    with pytest.raises(DataError) as refused, Router(unknown):
        pass
    assert "/" not in refused.value.because
