"""Time of every stage from frame to estimate, each beside a pair of Sobel filters on the same frame."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import cv2

from omnivert.bench.spread import Spread
from omnivert.bench.yardstick import sobel_pair_s
from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.ekf import Filter
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Frame, Ticks
from omnivert.timeline import Timeline
from omnivert.vision.frontend import FrontEnd, Work
from omnivert.vision.image import grey_from_frame
from omnivert.wire.recording import Recording

WARM_UP = 3  # frames that fill caches and lazy imports, not counted


@dataclass(frozen=True, slots=True)
class PipelineTimes:
    """Durations by stage over one recording, on one thread."""

    sobel_pair: Spread  # cv2.Sobel in u and in v of the whole frame: the yardstick
    stages: dict[str, Spread]  # of the vision, in order
    vision: Spread  # the whole step Frame -> Bearings
    calibration: Spread  # the whole step Bearings and their Ticks -> Estimate
    filter: Spread | None  # of that the filter alone, predict and update; None when it was never started


def pipeline_times(recording: Recording, config: Config, moved: Callable[[], None] = lambda: None) -> PipelineTimes:
    """Run the recording through vision and calibration and time every part.

    moved  called after each frame
    """
    clock = time.perf_counter
    front_end, calibrator = FrontEnd(config), Calibrator(config)
    timeline = Timeline((Ticks, Bearings), config.timeline)
    sobel: list[float] = []
    vision: list[float] = []
    stages: dict[str, list[float]] = defaultdict(list)
    calibration: list[float] = []
    filtering: list[float] = []
    spent = 0.0
    with _one_thread(), _stopwatch(Filter, "predict", "update") as in_filter:
        for _, message in recording.messages(types=(Frame, Ticks)):
            arriving: Bearings | Ticks
            if isinstance(message, Frame):
                sobel.append(sobel_pair_s(grey_from_frame(message)))
                arriving, seconds = _seen(front_end, message, stages)
                vision.append(seconds)
                moved()
            elif isinstance(message, Ticks):
                arriving = message
            for released in timeline.push(arriving, replay=True):
                if not isinstance(released, Bearings | Ticks):
                    continue
                began = clock()
                results = calibrator.step(released)
                spent += clock() - began
                if any(isinstance(result, Estimate) for result in results):
                    calibration.append(spent)
                    filtering += [sum(in_filter)] if in_filter else []
                    in_filter.clear()
                    spent = 0.0
    return PipelineTimes(
        sobel_pair=Spread.of_seconds(sobel[WARM_UP:] or sobel),
        stages={name: Spread.of_seconds(seconds[WARM_UP:] or seconds) for name, seconds in stages.items()},
        vision=Spread.of_seconds(vision[WARM_UP:] or vision),
        calibration=Spread.of_seconds(calibration),
        filter=Spread.of_seconds(filtering) if filtering else None,
    )


def _seen(front_end: FrontEnd, frame: Frame, stages: dict[str, list[float]]) -> tuple[Bearings, float]:
    """The frame's bearings, and what all of it took; each stage's time goes to its list."""
    began = time.perf_counter()
    work = Work(frame)
    for stage in front_end.stages:
        start = time.perf_counter()
        stage.run(work)
        stages[stage.name].append(time.perf_counter() - start)
    bearings = front_end.bearings(work)
    return bearings, time.perf_counter() - began


@contextmanager
def _stopwatch(kind: type, *methods: str) -> Iterator[list[float]]:
    """The duration of each call of these methods of a class, seconds, until the block ends."""
    durations: list[float] = []
    originals = {name: getattr(kind, name) for name in methods}

    def timed(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            began = time.perf_counter()
            result = method(*arguments)
            durations.append(time.perf_counter() - began)
            return result

        return call

    for name, method in originals.items():
        setattr(kind, name, timed(method))
    try:
        yield durations
    finally:
        for name, method in originals.items():
            setattr(kind, name, method)


@contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV on one thread, then as before."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
