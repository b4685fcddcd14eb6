"""The real processes on real zenoh, playing the corridor: the bytes of offline, and each of them may be killed.

All waiting is for messages, with a deadline; nothing depends on how fast the machine is.
"""

import json
import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from omnivert.calibration.calibrator import Calibrator
from omnivert.cli.supervisor import Event, Happened, Supervisor
from omnivert.config import Config, load
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Health, Message, Playback, Receipt, Ticks
from omnivert.store import Store
from omnivert.threads import one_thread
from omnivert.timeline import Timeline
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, HEALTH, PLAYBACK, RECEIPT
from omnivert.wire.codec import encode
from omnivert.wire.recording import Recording

DEADLINE_S = 60.0
CORRIDOR = Path(__file__).resolve().parents[2] / "omnivert" / "data" / "corridor.mcap"
HEARD = (BEARINGS, ESTIMATE, EXTRINSICS, RECEIPT, PLAYBACK, HEALTH)
SERVICES = ("router", "vision", "calibration", "storage")


@pytest.fixture
def file(config: Config, folder: Path) -> Path:
    """The configuration of the machine that made the corridor, with the test's own bus and store."""
    whole = Recording(CORRIDOR).config(config).model_dump(mode="json")
    whole["vision"]["max_lines"] = 40  # enough, and faster
    path = folder / "config.json"
    path.write_text(json.dumps(whole), encoding="utf-8")
    return path


class Ears:
    """A bus that hears everything, and the supervisor's events."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.all: list[Received] = []
        self._heard = bus.listen(*HEARD, period_s=0.5)

    def until(self, what: str, holds: Callable[[Received], bool]) -> Received:
        """The next message that `holds`."""
        deadline = time.monotonic() + DEADLINE_S
        for received in self._heard:
            if received is not None:
                self.all.append(received)
                if holds(received):
                    return received
            assert time.monotonic() < deadline, f"{what} did not come"
        raise AssertionError(f"the bus ended before {what} came")


@contextmanager
def running(file: Path, *services: str) -> Iterator[tuple[Supervisor, Ears, list[Event]]]:
    events: list[Event] = []
    with Supervisor(file, events.append) as supervisor:
        for service in services:
            supervisor.start(service)
        with Bus(load(file), "test", "test") as bus:
            yield supervisor, Ears(bus), events


def played(*more: str) -> tuple[str, ...]:
    return ("player", "--recording", str(CORRIDOR), "--speed", "full", *more)


def offline(config: Config, to_s: float) -> list[Message]:
    """The same recording through the same steppers, without a process."""
    one_thread()
    front_end, timeline, calibrator = FrontEnd(config), Timeline((Ticks, Bearings), config.timeline), Calibrator(config)
    out: list[Message] = []

    def work(released: list[Message]) -> None:
        for message in released:
            if isinstance(message, Ticks | Bearings):
                out.extend(calibrator.step(message))

    for _, message in Recording(CORRIDOR).messages((Frame, Ticks), None, to_s):
        if isinstance(message, Frame):
            out.append(front_end.step(message))
            work(timeline.push(out[-1], replay=True))
        else:
            work(timeline.push(message, replay=True))
    work(timeline.drain())
    out.extend(calibrator.close())
    return out


def test_at_full_speed_through_the_processes_the_results_are_those_of_offline_byte_by_byte(file: Path) -> None:
    to_s = 28.0
    with running(file, *SERVICES) as (supervisor, ears, _):
        supervisor.start(*played("--to", str(to_s), "--wait-for", "vision,calibration,storage,test"))
        expected = offline(load(file), to_s)
        ears.until("the end", lambda r: isinstance(r.message, Playback) and r.message.finished)
        assert supervisor.wait("player", DEADLINE_S)
        wanted: dict[type[Message], list[bytes]] = {
            kind: [encode(m) for m in expected if isinstance(m, kind)] for kind in (Bearings, Estimate, Extrinsics)
        }
        counts: dict[str, type[Message]] = {"vision": Bearings, "calibration": Estimate, "storage": Extrinsics}
        health: dict[str, Health] = {}

        def has_told_all(received: Received) -> bool:
            """Whether every result is here, and each service's health speaks of the whole playback."""
            if isinstance(received.message, Health):
                health[received.message.service] = received.message
            return all(
                s in health
                and sum(health[s].published.values()) >= len(wanted[kind])
                and sum(isinstance(r.message, kind) for r in ears.all) >= len(wanted[kind])
                for s, kind in counts.items()
            )

        ears.until("health", has_told_all)
    for kind, bytes_offline in wanted.items():
        live = [encode(r.message) for r in ears.all if isinstance(r.message, kind)]
        assert len(live) == len(bytes_offline) > 0
        assert [i for i, (a, b) in enumerate(zip(live, bytes_offline, strict=True)) if a != b] == [], kind.__name__
    for service in ("vision", "calibration", "storage"):
        found = health[service]
        assert [found.gaps, found.dropped, found.refused, found.reordered] == [{}, {}, {}, {}]
    assert health["vision"].latency_p50_ms is not None


def test_each_service_may_be_killed_while_it_plays_and_what_was_acknowledged_stays(file: Path) -> None:
    config = load(file)
    with running(file, *SERVICES) as (supervisor, ears, events):
        bus = ears.bus
        supervisor.start(*played("--loop", "--wait-for", "vision,calibration,storage"))
        acknowledged = ears.until("a receipt", lambda r: isinstance(r.message, Receipt)).message

        def killed(service: str) -> None:
            pid = supervisor.pid(service)
            assert pid is not None
            os.kill(pid, signal.SIGKILL)

        def anew(kind: type[Message], *said_by: str) -> Received:
            """The next message of this kind that another process than so far has published."""

            def is_meant(r: Received) -> bool:
                return isinstance(r.message, kind) and (not said_by or getattr(r.message, "service", "") in said_by)

            before = {r.publisher for r in ears.all if is_meant(r)}
            return ears.until(
                f"{kind.__name__} from another process", lambda r: is_meant(r) and r.publisher not in before
            )

        def flowing() -> None:
            """The playback goes on through all of them: an estimate for a frame that is played from now on."""
            now = max(r.message.stamp_ns for r in ears.all if isinstance(r.message, Playback))
            ears.until("an estimate", lambda r: isinstance(r.message, Estimate) and r.message.stamp_ns > now)

        killed("vision")
        anew(Bearings)
        flowing()
        killed("storage")
        flowing()
        anew(Health, "storage")
        stored = bus.ask(EXTRINSICS, DEADLINE_S)
        assert stored is not None
        assert stored.stamp_ns >= acknowledged.stamp_ns
        killed("calibration")
        anew(Estimate)
        flowing()
        killed("router")
        ears.until("the router", lambda r: Happened.DIED in {e.happened for e in events if e.service == "router"})
        flowing()
        killed("player")
        run = anew(Playback).run
        ears.until("an estimate", lambda r: isinstance(r.message, Estimate) and r.run == run)
        receipts = [r.message for r in ears.all if isinstance(r.message, Receipt)]
    died = Counter(event.service for event in events if event.happened is Happened.DIED)
    assert died == dict.fromkeys(("vision", "storage", "calibration", "router", "player"), 1), "nobody else, once each"
    entries = {e.entry: e.extrinsics.stamp_ns for e in Store(config.storage.path, writable=False).entries()}
    for receipt in receipts:
        assert entries[receipt.entry] == receipt.stamp_ns


def test_who_comes_after_calibration_has_gone_gets_the_newest_extrinsics_from_storage(file: Path) -> None:
    with running(file, "router", "vision", "storage") as (_, ears, _):
        with Supervisor(file, lambda event: None) as calibrating:
            calibrating.start("calibration")
            calibrating.start(*played("--wait-for", "vision,calibration,storage"))
            acknowledged = ears.until("a receipt", lambda r: isinstance(r.message, Receipt)).message
        bus = ears.bus
        gone = ("calibration", bus.config.camera.id)
        assert bus.await_presence(lambda: gone not in bus.present(), DEADLINE_S)
        with Bus(load(file), "late", "joiner") as late:
            answer = late.ask(EXTRINSICS, DEADLINE_S)
            assert answer is not None
            assert answer.stamp_ns >= acknowledged.stamp_ns
            kept = Store(bus.config.storage.path, writable=False).entries()
            assert encode(answer) in [encode(entry.extrinsics) for entry in kept]
