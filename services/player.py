"""A recording on the keys of the bridge, in its place: the same messages, marked as a replay."""

import argparse
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Bearings, Frame, Message, Playback
from omnivert.wire.bus import Bus
from omnivert.wire.channels import BEARINGS, ESTIMATE, PLAYBACK
from omnivert.wire.recording import Recording
from omnivert.wire.rivals import refusal
from services import _start
from services._ahead import read_ahead
from services._clock import Clock
from services._controls import Controls
from services._credits import Credits
from services._excerpt import CHANNELS, Excerpt

_log = logging.getLogger("omnivert.player")
_PROGRESS_S = 0.2
_END_S = 0.1  # how often the thread that follows the results looks whether it is over
_AHEAD_BYTES = 32 * 2**20  # read before it is due: a chunk from the disk takes longer than a message's turn
_POLL_S = 0.05  # how often the services are looked at while the playback waits


@dataclass(frozen=True, slots=True)
class Played:
    """How a playback went.

    lost     frames whose results were given up
    seconds  that it took
    """

    messages: int
    frames: int
    lost: int
    seconds: float

    def __str__(self) -> str:
        return (
            f"played {self.messages} messages, {self.frames} frames of them, in {self.seconds:.1f} s; {self.lost} lost"
        )


def run(
    bus: Bus,
    config: Config,
    path: Path,
    speed: float = 1.0,
    loop: bool = False,
    from_s: float | None = None,
    to_s: float | None = None,
    wait_for: tuple[str, ...] = (),
    begun: Callable[[str], None] = lambda service: None,
    controls: Controls | None = None,
) -> Played:
    """Plays until the end, and until all results of it are in.

    speed     1 is as recorded; 0 is as fast as the results come
    wait_for  services that must be there first
    begun     called before the first message, with the service that consumes the images or bearings
    controls  pause it, let it step and end it
    raises    UseError beside a live bridge or when one comes, DataError without sensor data or one of `wait_for`
    """
    recording = Recording(path, quick=True)  # a damaged part of a large file is found when its turn has come
    excerpt = Excerpt(recording, config, from_s, to_s)
    bus.refuse_beside("bridge", "player")
    begun(excerpt.consumer)
    if changes := config.rig_changes(named_alike(recording.config(config), config).rig_digest()):
        bus.note(f"the recording was made with another rig than the configuration's: {'; '.join(changes)}", "rig")
    _note_cut(bus, recording)
    player = _Player(bus, config, controls or Controls())
    with player.following():
        player.await_services(wait_for)
        with read_ahead(excerpt.rounds(loop), _size, _AHEAD_BYTES) as messages:
            played = player.play(messages, excerpt.count(), speed)
    _note_cut(bus, recording)
    for reason, times in recording.refused.items():
        bus.refuse(f"recording: {reason}", times)
    return played


def _note_cut(bus: Bus, recording: Recording) -> None:
    if recording.cut:
        bus.note(f"the recording is not whole: {recording.cut}", "cut")


def _size(message: Message) -> int:
    """About how many bytes it takes up."""
    return 500 + (message.data.nbytes if isinstance(message, Frame) else 0)


def named_alike(config: Config, other: Config) -> Config:
    """A configuration with the names that another one gives its robot, camera and encoder."""
    tables = ("robot", "camera", "encoder")
    update = {table: getattr(config, table).model_copy(update={"id": getattr(other, table).id}) for table in tables}
    return config.model_copy(update=update)


class _Player:
    """The clock, the credits, and the services that the playback is for."""

    def __init__(self, bus: Bus, config: Config, controls: Controls) -> None:
        self._bus = bus
        self._controls = controls
        self._settings = config.player
        self._longest_pause_s = config.timeline.max_jump_s
        self._credits = Credits(config.player.frames_ahead)
        self._changed = threading.Condition()  # of the credits
        self._needed: dict[str, frozenset[bytes]] = {}  # service -> its processes as last seen
        self._away_s: dict[str, float] = {}  # service that is needed and gone -> since when
        self._heard_s = time.monotonic()  # the last result, or the last reason not to expect one
        self._results = bus.listen(BEARINGS, ESTIMATE, period_s=_END_S)
        self._over = threading.Event()
        self._told_s = 0.0
        self._played = 0
        self._frames = 0

    @contextmanager
    def following(self) -> Iterator[None]:
        """Follows the results in a thread, which has ended before the bus closes: in zenoh it would break the exit."""
        thread = threading.Thread(target=self._follow_results, name="results", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._over.set()
            thread.join()

    def _follow_results(self) -> None:
        for received in self._results:
            if self._over.is_set():
                return
            if received is not None and received.run == self._bus.incarnation:
                with self._changed:
                    self._credits.seen(received.message)
                    self._heard_s = time.monotonic()
                    self._changed.notify()

    def await_services(self, services: tuple[str, ...]) -> None:
        for service in services:
            self._bus.note(f"waits for {service}", "start")
            wait_s = self._settings.wait_s
            self._bus.await_presence(partial(self._is_here_or_bridge, service), wait_s)
            self._give_way()
            if not self._is_here(service) and not self._bus.stopped:
                raise DataError("OV404", f"{service} has not come", f"not within {wait_s:g} s", "omnivert monitor")
        self._bus.note(None, "start")

    def play(self, messages: Iterator[Message], total: int, speed: float) -> Played:
        began_s = time.monotonic()
        self._play(messages, total, speed)
        return Played(self._played, self._frames, self._credits.lost, time.monotonic() - began_s)

    def _play(self, messages: Iterator[Message], total: int, speed: float) -> None:
        clock = Clock(speed, self._longest_pause_s)
        for message in messages:
            is_frame = isinstance(message, Frame | Bearings)
            if is_frame:
                clock.stood_still(self._await_credit())
            self._await_turn(message, is_frame, clock, total)
            if self._bus.stopped or self._controls.ended:
                break
            self._give_way()
            with self._changed:
                self._credits.played(message)
            self._bus.publish(CHANNELS[type(message)], message, replay=True)
            self._controls.played(is_frame)
            self._played += 1
            self._frames += is_frame
            self._tell(total)
        if not self._bus.stopped:
            self._finish(total)

    def _await_turn(self, message: Message, is_frame: bool, clock: Clock, total: int) -> None:
        """Waits until the message is due, and while the playback is paused, unless this is of a step."""
        stood = False
        while not self._bus.stopped and not self._controls.ended:
            if self._controls.holds(is_frame):
                if not stood:
                    self._bus.note("paused", "pause")
                stood = True
                self._controls.wait(_POLL_S)
                self._heard_s = time.monotonic()  # nobody owes a result meanwhile
            elif stood or self._controls.paused:  # what is of a step comes at once
                self._bus.note(None, "pause")
                clock.due_now(message.stamp_ns)
                return
            elif (left_s := clock.until(message.stamp_ns)) > 0.0:
                self._bus.await_presence(self._bridge_is_here, min(left_s, _PROGRESS_S))
            else:
                return
            self._tell(total)
            self._give_way()

    def _finish(self, total: int) -> None:
        """Waits for what is on its way. The end is told when all bearings are in: nothing may come after it."""
        self._await(lambda: self._credits.complete(self._wants("vision"), calibration=False))
        done = False
        while not done and not self._bus.stopped:
            self._tell(total, finished=True)
            done = self._await(
                lambda: self._credits.complete(self._wants("vision"), self._wants("calibration")), _PROGRESS_S
            )

    # ------------------------------------------------------------------ credits

    def _await_credit(self) -> float:
        """Waits until the next frame may be played; returns for how long, in s."""
        began = time.monotonic()
        self._await(
            lambda: not self._away_s and self._credits.may_play(self._wants("vision"), self._wants("calibration"))
        )
        return time.monotonic() - began

    def _await(self, holds: Callable[[], bool], timeout_s: float = float("inf")) -> bool:
        """Waits until `holds`, watching the services; whether it does."""
        began = time.monotonic()
        while True:
            self._give_way()
            self._watch_services()
            with self._changed:
                if holds():
                    return True
                if self._bus.stopped or time.monotonic() - began > timeout_s:
                    return False
                self._changed.wait(_POLL_S)

    def _wants(self, service: str) -> bool:
        return service in self._needed

    def _is_here(self, service: str) -> bool:
        return bool(self._bus.incarnations(service))

    def _is_here_or_bridge(self, service: str) -> bool:
        return self._is_here(service) or self._bridge_is_here()

    def _bridge_is_here(self) -> bool:
        return self._is_here("bridge")

    def _give_way(self) -> None:
        """raises UseError when a bridge has come: it publishes nothing until this player has gone"""
        if self._bridge_is_here():
            raise refusal(self._bus.config.robot.id, "player", "bridge")

    def _watch_services(self) -> None:
        """Whoever was there is waited for when it goes; what it had not answered is lost."""
        now_s = time.monotonic()
        for service in ("vision", "calibration"):
            here = self._bus.incarnations(service)
            before = self._needed.get(service)
            if here and before is None:
                self._needed[service] = here
            elif here and (service in self._away_s or not here & self._needed[service]):
                self._needed[service] = here
                self._away_s.pop(service, None)
                self._bus.note(None, service)
                self._give_up(f"{service} was away")
            elif not here and before is not None:
                self._wait_for_comeback(service, now_s)
        if not self._away_s and now_s - self._heard_s > self._settings.patience_s:
            self._give_up(f"no result for {self._settings.patience_s:g} s")

    def _wait_for_comeback(self, service: str, now_s: float) -> None:
        if now_s - self._away_s.setdefault(service, now_s) <= self._settings.comeback_s:
            self._bus.note(f"waits for {service} to come back", service)
            return
        self._give_up(f"{service} has not come back")
        del self._needed[service], self._away_s[service]
        self._bus.note(f"goes on without {service}, which has not come back", service)

    def _give_up(self, why: str) -> None:
        with self._changed:
            lost = self._credits.give_up(self._wants("vision"), self._wants("calibration"))
            self._heard_s = time.monotonic()
        if lost:
            self._bus.refuse(f"frames without a result: {why}", lost)

    def _tell(self, total: int, finished: bool = False) -> None:
        now_s = time.monotonic()
        if finished or now_s - self._told_s >= _PROGRESS_S:
            self._told_s = now_s
            credits = self._credits
            stamp_ns = max(credits.frame_ns, credits.ticks_ns)
            told = Playback(stamp_ns, self._played, total, finished, credits.frame_ns, credits.ticks_ns, credits.lost)
            self._bus.publish(PLAYBACK, told, replay=True)


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recording", type=Path, required=True)
    parser.add_argument(
        "--speed", type=_speed, default=1.0, help="1 is as recorded, 0 or full: as fast as results come"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--from", dest="from_s", type=float, help="second to begin at")
    parser.add_argument("--to", dest="to_s", type=float, help="second to end at")
    parser.add_argument("--wait-for", default="", help="services that must be there first, separated by commas")


def _speed(text: str) -> float:
    speed = 0.0 if text == "full" else float(text)
    if not 0.0 <= speed < float("inf"):
        raise argparse.ArgumentTypeError("a speed is 0 or more")
    return speed


def _run(bus: Bus, config: Config, given: argparse.Namespace) -> None:
    wait_for = tuple(name for name in given.wait_for.split(",") if name)
    _log.info("%s", run(bus, config, given.recording, given.speed, given.loop, given.from_s, given.to_s, wait_for))


def main() -> int:
    return _start.start("player", _run, _arguments)


if __name__ == "__main__":
    sys.exit(main())
