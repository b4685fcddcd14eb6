"""Ticks and bearings in; an estimate for every frame, and extrinsics whenever they are calibrated, out."""

import argparse
import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.smoothing import Background
from omnivert.calibration.solver.result import Outcome
from omnivert.calibration.warm_up import warm_up
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Message, Playback, Receipt, Ticks
from omnivert.store import Entry
from omnivert.store_rules import restorable
from omnivert.timeline import Timeline
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, PLAYBACK, RECEIPT, TICKS
from omnivert.wire.sources import Admission, Sources
from services import _start
from services._repeater import Repeater

_PERIOD_S = 0.5
_NEW_IDS = 2**40  # the tracks of a vision service that has come anew are counted from here on: they are others


def run(bus: Bus, config: Config, arguments: argparse.Namespace | None = None) -> None:
    warm_up(config)  # before others are told that this service is here, or their first frames would wait for it
    with ThreadPoolExecutor(1, "smoother") as pool:
        _run(bus, _Desk(bus, config, lambda job: pool.submit(job).result))


def _run(bus: Bus, desk: "_Desk") -> None:
    heard = bus.listen(TICKS, BEARINGS, RECEIPT, PLAYBACK, period_s=_PERIOD_S)
    bus.answer(EXTRINSICS, lambda: desk.claims.newest)
    for received in heard:
        if received is not None:
            desk.step(received)
        desk.keep_house(time.monotonic())
    desk.close()


class _Desk:
    """One drive at a time: its timeline, its calibrator, and the claims that storage has not acknowledged yet."""

    def __init__(self, bus: Bus, config: Config, background: Background[Outcome]) -> None:
        self.claims = Repeater()
        self._background = background
        self._bus = bus
        self._config = config
        self._sources = Sources(bus.alive)
        self._begin()

    def _begin(self) -> None:
        """Another drive: nothing of the one before is true of it."""
        self._timeline = Timeline((Ticks, Bearings), self._config.timeline)
        self._calibrator: Calibrator | None = None
        self._counted: Counter[str] = Counter()
        self._newest_ns: dict[type[Message], int] = {}
        self._newest: Received | None = None
        self._released_ns = -1
        self._run = b""
        self._is_loop = False
        self._bus.note(None, "loop")
        self._bus.note(None, "lines")
        self._seen_from_start = False
        self._causes: dict[int, Received] = {}  # stamp of bearings that wait for their estimate -> how they came
        self._vision = b""
        self._generation = 0

    # ------------------------------------------------------------------ messages

    def step(self, received: Received) -> None:
        match received.message:
            case Receipt() as receipt:
                self.claims.acknowledge(receipt)
            case Playback() as playback:
                if received.run == self._run and playback.played > playback.total and not self._is_loop:
                    self._is_loop = True
                    self._bus.note("the playback shows the same drive again: nothing more of it is claimed", "loop")
                if playback.finished and received.run == self._run and self._has_all_of(playback):
                    self._finish(received)
            case Ticks() | Bearings() as message:
                admission = self._sources.admission(received)
                if admission is Admission.REFUSED:
                    self._bus.refuse(f"{received.key}: from another source than the one that is heard")
                    return
                if admission is Admission.FRESH:
                    self._begin()
                if isinstance(message, Bearings) and self._hears_another_vision_than(received.publisher):
                    self._bus.refuse(f"{received.key}: from another vision than the one that is heard")
                    return
                self._run = received.run
                self._take(message, received)

    def _take(self, message: Ticks | Bearings, received: Received) -> None:
        if isinstance(message, Ticks) and Ticks not in self._newest_ns:
            self._seen_from_start = received.sequence == 0
        if isinstance(message, Bearings):
            message = self._told_apart(message, received)
            self._causes[message.stamp_ns] = received
            if len(self._causes) > self._config.timeline.max_held:
                del self._causes[next(iter(self._causes))]
        self._newest_ns[type(message)] = message.stamp_ns
        self._newest = received
        self._work(self._timeline.push(message, received.replay), received)

    def close(self) -> None:
        """The service ends: what is known now is claimed once more, for a storage that still listens."""
        if self._calibrator is not None and self._newest is not None:
            for result in self._calibrator.close():
                self._publish(result, self._newest)

    def _finish(self, cause: Received) -> None:
        """Nothing comes after this: what waited for more goes on without it."""
        self._newest = cause
        self._work(self._timeline.drain(), cause)
        self.close()

    def _work(self, released: Sequence[Message], cause: Received) -> None:
        for message in released:
            if self._calibrator is not None and message.stamp_ns < self._released_ns:
                self._change_clock(self._calibrator)
            self._released_ns = message.stamp_ns
            if self._calibrator is None:
                self._calibrator = Calibrator(self._config, self._to_resume(cause), self._background)
            if isinstance(message, Ticks | Bearings):
                for result in self._calibrator.step(message):
                    self._publish(result, cause)
        self._count(self._timeline.refused)
        self._count({f"{stream}: not waited for": times for stream, times in self._timeline.late.items()})
        if self._calibrator is not None:
            self._count(self._calibrator.refused)
            if left_out := self._calibrator.left_out:
                most = self._config.calibration.frame_lines
                self._bus.note(
                    f"more lines than calibration.frame_lines = {most} in a frame, {left_out} left out so far", "lines"
                )

    def _change_clock(self, calibrator: Calibrator) -> None:
        """The timeline follows another clock: what comes by it is another drive, with the last word on this one said.

        Stamps of two clocks have no order, and no way of the wheels leads from one to the other.
        """
        self._bus.refuse("stamps: the clock has changed, another drive begins")
        self.close()
        self._count(calibrator.refused)
        for reason in calibrator.refused:
            del self._counted[reason]
        self._calibrator = None

    def _publish(self, result: Estimate | Extrinsics, cause: Received) -> None:
        match result:
            case Estimate():
                self._bus.publish(ESTIMATE, result, cause=cause)
                came = self._causes.pop(result.stamp_ns, None)
                if came is not None:
                    self._bus.done(came)
            case Extrinsics() if not self._is_loop:  # the same drive once more is no further evidence
                self._bus.publish(EXTRINSICS, result, cause=cause)
                self.claims.claim(result, cause, time.monotonic())

    def _hears_another_vision_than(self, publisher: bytes) -> bool:
        """Two visions of one camera give the same lines other names, each their own."""
        return publisher != self._vision and self._bus.alive(self._vision)

    def _told_apart(self, bearings: Bearings, received: Received) -> Bearings:
        """A vision service that has come anew counts its tracks from 0 again; these are other lines."""
        if received.publisher != self._vision:
            self._generation += bool(self._vision)
            self._vision = received.publisher
        if self._generation == 0:
            return bearings
        return dataclasses.replace(bearings, track_id=bearings.track_id + self._generation * _NEW_IDS)

    def _has_all_of(self, playback: Playback) -> bool:
        """Whether the last messages of the playback have come: bearings are on the way for longer than its end is."""
        newest = (self._newest_ns.get(Bearings, -1), self._newest_ns.get(Ticks, -1))
        return newest[0] >= playback.frame_ns and newest[1] >= playback.ticks_ns

    def _count(self, counts: Mapping[str, int]) -> None:
        for reason, times in counts.items():
            if times > self._counted[reason]:
                self._bus.refuse(reason, times - self._counted[reason])
                self._counted[reason] = times

    # ------------------------------------------------------------------ storage

    def _to_resume(self, cause: Received) -> Extrinsics | None:
        """The stored extrinsics to go on from; a note says why there are none.

        A playback that is seen from its start begins from nothing, so that it always gives the same results.
        """
        stored = None
        if not self._config.calibration.resume:
            why = "calibration.resume is false"
        elif cause.replay and self._seen_from_start:
            why = "a playback"
        else:
            stored, why = self._restored()
        self._bus.note("goes on from the stored extrinsics" if stored else f"begins from nothing: {why}", "resume")
        return stored

    def _restored(self) -> tuple[Extrinsics | None, str]:
        answer = self._bus.ask(EXTRINSICS)
        if not isinstance(answer, Extrinsics):
            return None, "nothing is stored for this camera, or storage is away"
        allowed, why = restorable(Entry(0, "", answer), self._config)
        return answer if allowed else None, why

    def keep_house(self, now_s: float) -> None:
        """Says again what storage has not acknowledged."""
        for extrinsics, cause in self.claims.due(now_s):
            self._bus.publish(EXTRINSICS, extrinsics, cause=cause)
        waiting = self.claims.repeated
        self._bus.note("storage has not acknowledged the newest extrinsics" if waiting else None, "storage")


def main() -> int:
    return _start.start("calibration", run)


if __name__ == "__main__":
    sys.exit(main())
