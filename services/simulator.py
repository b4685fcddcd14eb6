"""A robot in a room that does not exist, on the keys of the bridge and in its place: nobody downstream can tell.

Its time is this host's monotonic clock. It drives a path, or what `omnivert drive` says.
"""

import argparse
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.drivers.newest import Newest
from omnivert.errors import DataError
from omnivert.messages import Drive, Ticks
from omnivert.simulation.place import Place
from omnivert.simulation.route import Route, commanded
from omnivert.simulation.stage import Shot, Stage, with_camera
from omnivert.simulation.steering import Steering
from omnivert.simulation.toml_file import loaded
from omnivert.simulation.trip import SECOND, start_of
from omnivert.simulation.vehicle import SAMPLE_S, Vehicle
from omnivert.wire.bus import Bus
from omnivert.wire.channels import DRIVE, FRAME, SCAN, TICKS
from services import _start

Array = NDArray[np.float64]

BLOCKED = "blocked: something stands in the robot's way"  # a note in health
SETTLE_S = 1.0  # standing, before a path begins and after it has ended
_TURN_S = 0.1  # how often a thread looks whether it is over
_ANY = Route.model_validate({"leg": [{"rest_s": SAMPLE_S}]})  # where no path was asked for


@dataclass(frozen=True, slots=True)
class _Due:
    """A picture that is to be taken."""

    stamp_ns: int
    shot: Shot


def run(bus: Bus, config: Config, given: argparse.Namespace) -> None:
    """Publishes until the bus stops, or, if asked to, until the path has ended.

    raises  UseError beside a bridge or a player, DataError without one of the services to wait for
    """
    bus.refuse_beside("bridge", "player")
    place = with_camera(loaded(given.world, "worlds", Place), tilt_deg=given.tilt_deg)
    stage = Stage(config, place, given.seed, given.people)
    route = loaded(given.path, "paths", Route) if given.path else _ANY
    pose = start_of(stage, route)
    stage.taken(stage.shot(0, 0.0, pose, 0.0)).frame(0)  # compiled, or read from disk, before time begins
    noise_k = config.encoder.noise_k_m if given.noise_k is None else given.noise_k
    vehicle = Vehicle(config, stage.room, pose, noise_k, given.seed, stage.mount[1])
    told = commanded(route, config.robot.wheel_base_m, SAMPLE_S)
    robot = _Robot(bus, config, stage, vehicle, Steering(vehicle, told))
    await_services(bus, tuple(name for name in given.wait_for.split(",") if name), config.player.wait_s)
    with robot.alive():
        robot.stand(SETTLE_S)
        robot.drive(exit_when_done=given.exit_when_done)
        robot.stand(SETTLE_S)


def await_services(bus: Bus, services: tuple[str, ...], wait_s: float) -> None:
    """raises DataError when one of them does not come"""

    def lacking() -> set[str]:
        return set(services) - {name for name, _ in bus.present()}

    if lacking():
        bus.await_presence(lambda: not lacking(), wait_s)
    if lacking() and not bus.stopped:
        missing = ", ".join(sorted(lacking()))
        raise DataError("OV404", f"{missing} has not come", f"not within {wait_s:g} s", "omnivert monitor")


class _Robot:
    """Wheels in the caller's thread; camera and ear each in one of its own, so that neither delays the counts."""

    def __init__(self, bus: Bus, config: Config, stage: Stage, vehicle: Vehicle, steering: Steering) -> None:
        self._bus, self._stage, self._vehicle, self._steering = bus, stage, vehicle, steering
        self._rate = config.camera.frame_rate_hz
        self._due, self._displaced = Newest[_Due](), 0
        self._commands: SimpleQueue[Drive] = SimpleQueue()
        self._over = threading.Event()
        self._broken: list[Exception] = []
        self._began_ns = 0
        self._sample = 0  # of the wheels, that was told last
        self._frames = 0

    @contextmanager
    def alive(self) -> Iterator[None]:
        """Time begins; camera and ear have ended when it is left.

        raises  whatever broke one of them
        """
        threads = [
            threading.Thread(target=self._guarded, args=(work,), daemon=True) for work in (self._see, self._hear)
        ]
        for thread in threads:
            thread.start()
        self._began_ns = time.monotonic_ns()
        self._tell_counts()
        self._plan(self._vehicle.pose)
        try:
            yield
        finally:
            self._over.set()
            self._due.close()
            for thread in threads:
                thread.join()
        if self._broken:
            raise self._broken[0]

    def stand(self, seconds: float) -> None:
        """Wheels at rest."""
        for _ in range(round(seconds / SAMPLE_S)):
            if not self._waited():
                return
            self._step(None)

    def drive(self, exit_when_done: bool) -> None:
        """Along the path, then as told; returns when the bus stops, or the path has ended and that was asked for."""
        while self._waited():
            self._step(self._steering)
            if exit_when_done and not self._steering.on_path:
                return

    def _waited(self) -> bool:
        """Waits until the next sample is due; False when the bus was stopped."""
        due_ns = self._began_ns + round((self._sample + 1) * SAMPLE_S * SECOND)
        left_s = 1e-9 * (due_ns - time.monotonic_ns())
        return not (self._bus.wait_stopped(left_s) if left_s > 0.0 else self._bus.stopped)

    def _step(self, steering: Steering | None) -> None:
        """One sample of the wheels, and the pictures up to it."""
        before = self._vehicle.pose
        now_s = time.monotonic()
        if steering is None:
            self._vehicle.step(np.zeros(2))
        else:
            while (command := self._heard()) is not None:
                steering.take(command, now_s)
            steering.step(now_s)
        self._sample += 1
        self._tell_counts()
        self._plan(before)
        self._bus.note(BLOCKED if self._vehicle.blocked else None, "blocked")

    def _heard(self) -> Drive | None:
        try:
            return self._commands.get_nowait()
        except Empty:
            return None

    def _tell_counts(self) -> None:
        counts = self._vehicle.counts
        self._bus.publish(TICKS, Ticks(self._stamp_ns(self._sample * SAMPLE_S), counts.left, counts.right))

    def _plan(self, before: Array) -> None:
        """Has the pictures taken that lie between the last sample and this one."""
        after = self._vehicle.pose
        turn_rate = float(after[2] - before[2]) / SAMPLE_S
        while (time_s := self._frames / self._rate) <= self._sample * SAMPLE_S + 1e-9:
            share = time_s / SAMPLE_S - (self._sample - 1)
            pose = before + share * (after - before)
            shot = self._stage.shot(self._frames, time_s, pose, turn_rate)
            self._due.put(_Due(self._stamp_ns(time_s), shot))
            self._frames += 1

    def _stamp_ns(self, time_s: float) -> int:
        return self._began_ns + round(time_s * SECOND)

    # ------------------------------------------------------------------ the other threads

    def _see(self) -> None:
        """Takes the pictures."""
        while not self._over.is_set():
            due = self._due.take(_TURN_S)
            if due is not None:
                taken = self._stage.taken(due.shot)
                self._bus.publish(SCAN, taken.scan(due.stamp_ns))
                self._bus.publish(FRAME, taken.frame(due.stamp_ns))
            if self._due.displaced > self._displaced:
                self._bus.refuse("camera: frame displaced by a newer one", self._due.displaced - self._displaced)
                self._displaced = self._due.displaced

    def _hear(self) -> None:
        """Takes the commands."""
        for received in self._bus.listen(DRIVE, period_s=_TURN_S):
            if self._over.is_set():
                return
            if received is not None and isinstance(received.message, Drive):
                self._commands.put(received.message)

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - raised again by the main thread
            self._broken.append(error)
            self._bus.stop()


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--world", required=True)
    parser.add_argument("--path", default="", help="stands until it is steered without one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--people", type=int)
    parser.add_argument("--noise-k", type=float)
    parser.add_argument("--tilt-deg", type=float)
    parser.add_argument("--wait-for", default="", help="services that must be there first, separated by commas")
    parser.add_argument("--exit-when-done", action="store_true", help="end when the path has ended")


def main() -> int:
    return _start.start("bridge", run, _arguments)


if __name__ == "__main__":
    sys.exit(main())
