"""Whether all that a robot needs is there and at work, and until then what is still missing."""

import time
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.guest import guest
from omnivert.config import Config
from omnivert.messages import Health
from omnivert.pictures import notes
from omnivert.wire.channels import BEARINGS, FRAME, HEALTH, TICKS, channel_from_key

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus

QUIET_S = 2.0  # so long nobody asks what takes so long
LONG_S = 5.0  # then it is said why
AGAIN_S = 2.0  # what changes faster is told in one
COMPILES = ("vision", "calibration")  # the first time on a machine
COMPILING = "compiling, the first time for half a minute"
_SENSORS = ("bridge", "player")
_PERIOD_S = 0.2


class Readiness:
    """A stepper: takes what services tell of themselves, and says once that all are ready.

    services  that have to be there, by their names on the bus, in the order of the data
    sensors   what gives the data of the sensors, in words
    """

    is_over = False  # nothing more is to be said: what was to be ready has ended

    def __init__(self, services: tuple[str, ...], sensors: str) -> None:
        self._services = services
        self._source = next(name for name in services if name in _SENSORS)
        self._sensors = sensors
        self._health: dict[str, Health] = {}
        self._said, self._said_s = "", 0.0

    def take(self, health: Health) -> None:
        self._health[health.service] = health

    def told(self, present: frozenset[str], waited_s: float) -> str:
        """What is missing, where it has changed since it was said last; "" when there is nothing to say."""
        lacking = self.lacking(present, waited_s)
        text = f"waiting for {', '.join(lacking)}" if lacking and waited_s >= QUIET_S else ""
        if not text or text == self._said or waited_s - self._said_s < AGAIN_S:
            return ""
        self._said, self._said_s = text, waited_s
        return text

    def lacking(self, present: frozenset[str], waited_s: float) -> list[str]:
        """What has to come yet; nothing when all is ready."""
        absent = [name for name in self._services if name not in present or name not in self._health]
        slow = [name for name in absent if name in COMPILES and waited_s >= LONG_S]
        lacking = [self._sensors if name == self._source else name for name in absent if name not in slow]
        if slow:
            lacking.append(f"{' and '.join(slow)} ({COMPILING})")
        if not lacking:
            lacking = [*self._sensor_data(), *filter(notes.is_of_no_store, self._health["storage"].notes)]
        if not lacking and not self.begun:
            lacking = ["the calibration to begin"]
        return lacking

    @property
    def begun(self) -> str:
        """How the calibration has begun, in its own words; "" before."""
        health = self._health.get("calibration")
        return next(filter(notes.is_of_the_beginning, health.notes), "") if health is not None else ""

    def _sensor_data(self) -> list[str]:
        """What has to come of camera and encoder yet, or why it does not."""
        health = self._health[self._source]
        came = {channel_from_key(key) for key, count in health.published.items() if count}
        lacking = [f"the {note}" for note in health.notes if notes.todo(note)]
        if self._source == "player":
            return lacking if came & {FRAME, TICKS, BEARINGS} else [*lacking, "the first messages of the recording"]
        wanted = {"camera": ("the first frame", FRAME), "encoder": ("the first wheel counts", TICKS)}
        for device, (what, channel) in wanted.items():
            if channel not in came and not any(text.startswith(f"the {device}:") for text in lacking):
                lacking.append(what)
        return lacking


def watched(config: Config, readiness: Readiness, following: str) -> AbstractContextManager[None]:
    """In here a guest on the bus tells what is missing, and once that nothing is.

    following  the command to type then
    """
    return guest(config, "up", lambda bus: _follow(bus, readiness, following))


def _follow(bus: "Bus", readiness: Readiness, following: str) -> None:
    began_s = time.monotonic()
    for received in bus.listen(HEALTH, period_s=_PERIOD_S):
        if received is not None and isinstance(received.message, Health):
            readiness.take(received.message)
        if readiness.is_over:
            return
        waited_s = time.monotonic() - began_s
        present = frozenset(name for name, _ in bus.present())
        if not readiness.lacking(present, waited_s):
            say.story(f"  [green]✓[/] [bold]ready[/]: all services are at work, after {waited_s:.0f} s")
            say.story(f"    the calibration {escape(readiness.begun)}")
            say.story(f"    next: {escape(following)}")
            return
        if text := readiness.told(present, waited_s):
            say.story(f"  [cyan]…[/] {escape(text)}")
