"""Who is waited for when services start, against a bus whose seconds take no time."""

from collections.abc import Callable
from typing import cast

import pytest

from omnivert.cli.robot.supervisor import Event, Happened
from omnivert.cli.robot.troubles import COMPILED_S, START_S, Troubles, await_services
from omnivert.errors import DataError
from omnivert.wire.bus import Bus

ALL = {"router", "vision", "calibration", "storage"}


class Coming:
    """Services that come after so many seconds."""

    stopped = False

    def __init__(self, after_s: dict[str, float]) -> None:
        self._after_s = after_s
        self.now_s = 0.0

    def present(self) -> set[tuple[str, str]]:
        return {(name, "front") for name, after_s in self._after_s.items() if self.now_s >= after_s}

    def await_presence(self, here: Callable[[], bool], timeout_s: float) -> bool:
        self.now_s += timeout_s
        return here()


def bus_after(after_s: dict[str, float]) -> tuple[Coming, str]:
    """The bus when the waiting has ended, and the refusal, "" without one."""
    bus = Coming({name: after_s.get(name, 0.0) for name in ALL})
    try:
        await_services(cast(Bus, bus), ALL, Troubles())
    except DataError as error:
        return bus, f"{error.code} {error}"
    return bus, ""


@pytest.mark.parametrize("names", [{"vision"}, {"calibration"}, {"vision", "calibration"}])
def test_those_that_compile_have_the_time_to(names: set[str]) -> None:
    late_s = START_S + 50.0
    bus, refusal = bus_after(dict.fromkeys(names, late_s))
    assert bus.now_s == pytest.approx(late_s, abs=1.0)
    assert not refusal
    bus, refusal = bus_after(dict.fromkeys(names, 1e9))
    assert bus.now_s == pytest.approx(COMPILED_S, abs=1.0)
    assert refusal == f"OV422 {', '.join(sorted(names))} did not come up in time"


@pytest.mark.parametrize("compiling", [set(), {"vision"}])
def test_for_another_one_nobody_waits_so_long(compiling: set[str]) -> None:
    bus, refusal = bus_after({"storage": 1e9} | dict.fromkeys(compiling, 1e9))
    assert bus.now_s == pytest.approx(START_S, abs=2.0)
    assert refusal.startswith("OV422 storage")


@pytest.mark.parametrize("loud", [False, True])
def test_of_a_service_that_died_its_last_words_are_told_once(loud: bool, capsys: pytest.CaptureFixture[str]) -> None:
    troubles = Troubles(loud)
    troubles(Event("vision", Happened.SAID, "the frame\x1b[2J is odd [/] " + "x" * 100))
    for _ in range(2):
        troubles(Event("vision", Happened.DIED, "died (SIGABRT); starts again in 0.2 s"))
    told = capsys.readouterr().err
    assert told.count("vision died (SIGABRT)") == 2
    assert told.count("is odd [/]") == 1
    assert "\x1b[2J" not in told
    assert max(map(len, told.splitlines())) <= 80 or loud
