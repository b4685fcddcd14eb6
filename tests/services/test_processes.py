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
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.cli.robot.supervisor import Event, Happened, Supervisor
from omnivert.config import Config, load
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Health, Message, Playback, Receipt, Ticks
from omnivert.offline import calibrated
from omnivert.store import Store
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, FRAME, HEALTH, PLAYBACK, RECEIPT
from omnivert.wire.codec import encode
from omnivert.wire.recording import Recording, RecordingWriter

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


def played(recording: Path, *more: str) -> tuple[str, ...]:
    return ("player", "--recording", str(recording), "--speed", "full", *more)


def heard(ears: Ears, kind: type[Message]) -> list[bytes]:
    """What has come of a kind; extrinsics are said again until storage has acknowledged them."""
    every = [encode(r.message) for r in ears.all if isinstance(r.message, kind)]
    return list(dict.fromkeys(every)) if kind is Extrinsics else every


@pytest.fixture
def part(file: Path, folder: Path) -> Path:
    """The first 38 s of the corridor: enough to be calibrated."""
    corridor, path = Recording(CORRIDOR), folder / "part.mcap"
    with RecordingWriter(path, corridor.config(load(file))) as writer:
        for key, message in corridor.messages((Frame, Ticks), None, 38.0):
            writer.write(key, message)
    return path


def test_at_full_speed_through_the_processes_the_results_are_those_of_offline_byte_by_byte(
    file: Path, part: Path
) -> None:
    with running(file, *SERVICES) as (supervisor, ears, _):
        supervisor.start(*played(part, "--wait-for", "vision,calibration,storage,test"))
        expected = list(calibrated(Recording(part), load(file)))
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
                and len(heard(ears, kind)) >= len(wanted[kind])
                for s, kind in counts.items()
            )

        ears.until("health", has_told_all)
    for kind, bytes_offline in wanted.items():
        live = heard(ears, kind)
        assert len(live) == len(bytes_offline) > 0
        assert [i for i, (a, b) in enumerate(zip(live, bytes_offline, strict=True)) if a != b] == [], kind.__name__
    for service in ("vision", "calibration", "storage"):
        found = health[service]
        assert [found.gaps, found.dropped, found.refused, found.reordered] == [{}, {}, {}, {}]
    assert health["vision"].latency_p50_ms is not None
    assert [note.partition(": ")[2].partition(" ")[2] for note in health["vision"].notes] == [
        f"lines found, the strongest 40 kept ({health['vision'].notes[0].split()[1]})"
    ]


def test_what_a_calibration_that_has_gone_for_good_has_claimed_is_told_by_storage(file: Path, part: Path) -> None:
    with running(file, *SERVICES) as (supervisor, ears, _):
        supervisor.start(*played(part, "--wait-for", "vision,calibration,storage,test"))
        assert supervisor.wait("player", DEADLINE_S)
        pid = supervisor.pid("calibration")
        assert pid is not None
        os.kill(pid, signal.SIGTERM)
        assert supervisor.wait("calibration", DEADLINE_S)
        assert ears.bus.await_presence(lambda: not ears.bus.incarnations("calibration"), DEADLINE_S)
        gone_ns = time.monotonic_ns()

        def claims() -> list[Extrinsics]:
            return [r.message for r in ears.all if isinstance(r.message, Extrinsics)]

        def is_stored(received: Received) -> bool:
            """Whether storage has the last claim; its health comes after everything that went before it."""
            stamps = {r.message.stamp_ns for r in ears.all if isinstance(r.message, Receipt)}
            after = isinstance(received.message, Health) and received.message.stamp_ns > gone_ns
            return after and bool(claims()) and claims()[-1].stamp_ns in stamps

        ears.until("the receipt of the last claim", is_stored)
        with Bus(load(file), "asker", "test") as anew:
            told = anew.ask(EXTRINSICS, DEADLINE_S)
    assert told is not None
    assert encode(told) == encode(claims()[-1])


class Kills:
    """Kills services one by one, and holds that the others live on as the same processes."""

    def __init__(self, supervisor: Supervisor, ears: Ears, services: tuple[str, ...]) -> None:
        self._supervisor, self._ears, self._services = supervisor, ears, services
        self.done: Counter[str] = Counter()

    def kill(self, service: str) -> None:
        """Returns when another process of the service is here, and the others are here as they were."""
        bus, pids, names = self._ears.bus, self._pids(), self._names()
        pid = pids[service]
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        self.done[service] += 1
        others = [other for other in self._services if other != service]

        def is_anew() -> bool:
            now = self._names()
            came = len(now[service]) == 1 and now[service].isdisjoint(names[service])
            return came and all(now[other] == names[other] for other in others)

        assert bus.await_presence(is_anew, DEADLINE_S), (service, names, self._names())
        now = self._pids()
        assert now[service] not in (None, pid)
        assert {other: now[other] for other in others} == {other: pids[other] for other in others}

    def _pids(self) -> dict[str, int | None]:
        return {service: self._supervisor.pid(service) for service in self._services}

    def _names(self) -> dict[str, frozenset[bytes]]:
        return {service: self._ears.bus.incarnations(service) for service in self._services}


def test_each_service_may_be_killed_while_it_plays_and_what_was_acknowledged_stays(file: Path, folder: Path) -> None:
    config = load(file)
    with running(file, *SERVICES) as (supervisor, ears, events):
        bus = ears.bus
        supervisor.start("recorder", "--output", str(folder / "drive.mcap"))
        supervisor.start("monitor")
        supervisor.start(*played(CORRIDOR, "--loop", "--wait-for", "vision,calibration,storage,recorder,monitor"))
        acknowledged = ears.until("a receipt", lambda r: isinstance(r.message, Receipt)).message
        kills = Kills(supervisor, ears, (*SERVICES, "recorder", "monitor", "player"))

        def anew(kind: type[Message], service: str) -> Received:
            """The next message of this kind, from the process of the service that is here now."""
            (publisher,) = bus.incarnations(service)
            return ears.until(
                f"{kind.__name__} of the new {service}",
                lambda r: isinstance(r.message, kind) and r.publisher == publisher,
            )

        def flowing() -> None:
            """The playback goes on through all of them: an estimate for a frame that is played from now on."""
            now = max(r.message.stamp_ns for r in ears.all if isinstance(r.message, Playback))
            ears.until("an estimate", lambda r: isinstance(r.message, Estimate) and r.message.stamp_ns > now)

        kills.kill("vision")
        anew(Bearings, "vision")
        flowing()
        kills.kill("storage")
        flowing()
        told: list[Message | None] = []

        def is_told(received: Received) -> bool:
            """Whether storage, which alone can, answers now: its token comes before its answers."""
            if isinstance(received.message, Health):
                told.append(bus.ask(RECEIPT, DEADLINE_S))
            return bool(told) and told[-1] is not None

        ears.until("the new storage's answer", is_told)
        stored = told[-1]
        assert isinstance(stored, Receipt)
        assert stored.stamp_ns >= acknowledged.stamp_ns
        kills.kill("recorder")
        anew(Health, "recorder")
        flowing()
        kills.kill("monitor")
        anew(Health, "monitor")
        flowing()
        kills.kill("calibration")
        anew(Estimate, "calibration")
        flowing()
        kills.kill("router")
        anew(Health, "router")
        flowing()
        kills.kill("player")
        back = anew(Playback, "player")
        ears.until("an estimate of its run", lambda r: isinstance(r.message, Estimate) and r.run == back.run)
        receipts = [r.message for r in ears.all if isinstance(r.message, Receipt)]
    died = Counter(event.service for event in events if event.happened is Happened.DIED)
    assert died == kills.done == dict.fromkeys((*SERVICES, "recorder", "monitor", "player"), 1)
    entries = {e.entry: e.extrinsics.stamp_ns for e in Store(config.storage.path, writable=False).entries()}
    for receipt in receipts:
        assert entries[receipt.entry] == receipt.stamp_ns
    first, second = (Recording(folder / name) for name in ("drive.mcap", "drive-2.mcap"))
    assert first.cut
    assert not second.cut
    assert min(first.counts[ESTIMATE.key(config)], second.counts[ESTIMATE.key(config)]) > 0


# ------------------------------------------------------------------ a folder of images as the camera


def with_folder(config: Config, folder: Path, images: Path, **more: Any) -> Path:
    """The configuration of a robot whose camera is this folder, and whose encoder is away."""
    given = {
        "bus": {"endpoint": config.bus.endpoint},
        "storage": {"path": str(config.storage.path)},
        "encoder": {"port": str(folder / "no-such-port")},
        **more,
    }
    given["camera"]["source"] = str(images)
    path = folder / "config.json"
    path.write_text(json.dumps(given), encoding="utf-8")
    return path


def test_a_bridge_that_is_killed_comes_back_and_its_frames_go_on(config: Config, folder: Path) -> None:
    images = folder / "images"
    images.mkdir()
    for k in range(1000):
        cv2.imwrite(str(images / f"{k}.png"), np.full((48, 64), k % 256, np.uint8))
    camera = {"width_px": 64, "height_px": 48, "frame_rate_hz": 10.0}
    ring = {"center_px": (31.5, 23.5), "r_min_px": 5.0, "r_max_px": 22.0}
    file = with_folder(config, folder, images, camera=camera, ring=ring)
    services = ("router", "vision", "bridge")
    with running(file, *services) as (supervisor, ears, events):
        first = ears.until("bearings", lambda r: isinstance(r.message, Bearings))
        kills = Kills(supervisor, ears, services)
        kills.kill("bridge")
        (bridge,) = ears.bus.incarnations("bridge")
        assert first.run != bridge
        back = ears.until("bearings again", lambda r: isinstance(r.message, Bearings) and r.run == bridge)
        assert back.publisher == first.publisher
        assert back.message.stamp_ns > first.message.stamp_ns
    died = Counter(event.service for event in events if event.happened is Happened.DIED)
    assert died == {"bridge": 1}


def test_photographs_go_from_their_folder_through_bridge_and_vision(
    config: Config, folder: Path, shared_data: Path, strong_edges_deg: tuple[float, ...]
) -> None:
    images = shared_data / "real" / "vmr"
    if not images.is_dir():
        pytest.skip("needs the photographs real/vmr, which are not here")
    camera = {"width_px": 1024, "height_px": 768, "frame_rate_hz": 0.1}  # the first one is not displaced by the next
    ring = {"center_px": (516.7, 384.1), "r_min_px": 90.0, "r_max_px": 452.5}
    file = with_folder(config, folder, images, camera=camera, ring=ring)
    with running(file, "router", "vision") as (supervisor, ears, _):
        frames = ears.bus.listen(FRAME)
        assert ears.bus.await_presence(lambda: bool(ears.bus.incarnations("vision")), DEADLINE_S)
        supervisor.start("bridge")
        seen = ears.until("bearings", lambda r: isinstance(r.message, Bearings)).message
        frame = next(received for received in frames if received is not None).message
    assert isinstance(frame, Frame)
    assert isinstance(seen, Bearings)
    assert frame.data.tobytes() == (images / "VMRImage0.jpg").read_bytes()
    assert (seen.stamp_ns, seen.reasons) == (frame.stamp_ns, ())
    for by_eye in strong_edges_deg:
        assert np.min(np.abs(np.rad2deg(seen.bearing_rad) - by_eye)) < 0.5
