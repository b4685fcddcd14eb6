"""Time of the filter, of the watchdog beside it and of the global start, and what each grows with."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.bench.growth import picture_with_lines
from omnivert.bench.spread import Spread
from omnivert.bench.yardstick import sobel_pair_s
from omnivert.calibration.judging.corrections import first_prior
from omnivert.calibration.kalman.ekf import Evidence, Filter, Rules
from omnivert.calibration.kalman.watchdog import Watchdog
from omnivert.calibration.sighting import clean_sighting
from omnivert.calibration.solver.problem import Problem
from omnivert.calibration.solver.start import started
from omnivert.calibration.solver.stretch import Stretch
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND, Odometer, Samples, after
from omnivert.simulation.recording import Scene, recorded

Array = NDArray[np.float64]

LINES = (10, 20, 50, 100, 200)
DRIVES_S = (15.0, 30.0, 60.0, 120.0)
POINTS = len(LINES) + len(DRIVES_S)
STEPS = 300  # of the filter for each number of lines
WARM_UP = 60  # of them, not counted: kernels are compiled, and the watchdog has come to ask about as much as ever
DYING = 1.0 / 40.0  # chance of a line in a frame
OUTLIERS = 0.05
STD = 0.003  # rad
SAMPLES, SAMPLE_S = 17, 0.0196  # of the encoders in a frame


@dataclass(frozen=True, slots=True)
class FilterPoint:
    """One number of lines that are seen in each frame."""

    lines: int
    step: Spread  # predict and update, with gate and with lines that come and go
    watchdog: Spread  # on top of it


@dataclass(frozen=True, slots=True)
class StartPoint:
    """The global start over a whole drive."""

    drive_s: float
    frames: int
    seconds: float  # the less of two goes
    found: bool


@dataclass(frozen=True, slots=True)
class CalibrationTimes:
    """On one thread."""

    sobel_pair: Spread
    filter: tuple[FilterPoint, ...]
    start: tuple[StartPoint, ...]

    @property
    def filter_exponent(self) -> float:
        """Slope of log time over log lines between the two largest numbers; dense algebra comes to 3."""
        return exponent([p.lines for p in self.filter[-2:]], [p.step.median_ms for p in self.filter[-2:]])

    @property
    def start_exponent(self) -> float:
        """Slope of log time over log length of the drive."""
        return exponent([p.drive_s for p in self.start], [p.seconds for p in self.start])

    def json(self) -> dict[str, Any]:
        yard = self.sobel_pair
        return {
            "sobel_pair": yard.json(),
            "filter": [
                {"lines": p.lines, "step": p.step.json(yard), "watchdog": p.watchdog.json(yard)} for p in self.filter
            ],
            "filter_exponent": self.filter_exponent,
            "start": [
                {"drive_s": p.drive_s, "frames": p.frames, "seconds": p.seconds, "found": p.found} for p in self.start
            ],
            "start_exponent": self.start_exponent,
        }


def calibration_times(
    config: Config,
    lines: Sequence[int] = LINES,
    drives_s: Sequence[float] = DRIVES_S,
    steps: int = STEPS,
    moved: Callable[[], None] = lambda: None,
) -> CalibrationTimes:
    """All points.

    moved  called after each
    """
    picture = picture_with_lines(config, 50)
    sobel = [sobel_pair_s(picture) for _ in range(30)]

    def told(point: Any) -> Any:
        moved()
        return point

    return CalibrationTimes(
        Spread.of_seconds(sobel),
        tuple(told(filter_point(config, count, steps)) for count in lines),
        tuple(told(start_point(config, drive_s)) for drive_s in drives_s),
    )


def exponent(size: Sequence[float], took: Sequence[float]) -> float:
    """Slope of log time over log size; 0 when there are not two."""
    if len(size) < 2:
        return 0.0
    return float(np.polyfit(np.log(size), np.log(took), 1)[0])


def filter_point(config: Config, lines: int, steps: int = STEPS) -> FilterPoint:
    """A drive to and fro among lines all around, so many seen in each frame."""
    rng = np.random.default_rng(0)
    odometer, noise_k = Odometer(config.encoder, config.robot.wheel_base_m), config.encoder.noise_k_m
    mount, spread = np.array([-0.34, 0.23, 0.33]), np.diag([0.01**2, 0.002**2, 0.01**2])
    known, dog = Filter(mount, spread, Rules(most_lines=lines + 5)), Watchdog(mount, spread)
    pose, place, name = np.zeros(3), _strewn(lines, rng), np.arange(lines)
    step, watch = [], []
    clock = time.perf_counter
    for frame in range(steps + WARM_UP):
        wheels = np.full(2, 0.05) if frame % 20 < 10 else np.array([0.02, -0.02])
        each = np.tile(wheels * (1.0 if frame % 40 < 20 else -1.0) / SAMPLES, (SAMPLES, 1))
        real = each + np.sqrt(noise_k * np.abs(each)) * rng.standard_normal(each.shape)
        pose = after(pose, odometer.motion(_samples(real)).pose)
        motion = odometer.motion(_samples(each))
        gone = rng.random(lines) < DYING
        place[gone] = pose[:2] + _strewn(int(gone.sum()), rng)
        name = np.where(gone, name.max() + np.cumsum(gone), name)
        beta, std = _bearings(place, pose, mount, rng), np.full(lines, STD)
        began = clock()
        known.predict(motion)
        evidence: Evidence | None = known.update(name, beta, std).evidence
        between = clock()
        if dog.step(frame, known, evidence) is not None:
            dog.trust(known.mount, known.mount_covariance)
        step.append(between - began)
        watch.append(clock() - between)
    return FilterPoint(lines, Spread.of_seconds(step[WARM_UP:]), Spread.of_seconds(watch[WARM_UP:]))


def start_point(config: Config, drive_s: float) -> StartPoint:
    """The global start over the first seconds of the alternating path, ten lines seen."""
    problem = _driven(config, drive_s)
    took, found = [], False
    for _ in range(2):
        began = time.perf_counter()
        found = _start(config, problem)
        took.append(time.perf_counter() - began)
    return StartPoint(drive_s, problem.frames, min(took), found)


def _start(config: Config, problem: Problem) -> bool:
    """What is timed; whether there is a result."""
    settings = config.calibration
    return started(problem, settings.max_rho_m, settings.start_etas, settings.start_lines) is not None


def _driven(config: Config, drive_s: float) -> Problem:
    scene = Scene(path="alternate", repeat=int(np.ceil(drive_s / 40.0)))
    odometer, stretch = Odometer(config.encoder, config.robot.wheel_base_m), Stretch(config)
    messages = [m for m in recorded(scene, config, 0).messages if m.stamp_ns <= drive_s * SECOND]
    for message in messages:
        if isinstance(message, Ticks):
            odometer.push(message)
    last: int | None = None
    for message in messages:
        if isinstance(message, Bearings) and message.stamp_ns <= (odometer.newest_ns or 0):
            sighting, _ = clean_sighting(message, np.deg2rad(config.calibration.bearing_floor_deg))
            wheels = None if last is None else odometer.samples(last, message.stamp_ns)
            stretch.append(message.stamp_ns / SECOND, wheels, sighting.track, sighting.beta, sighting.std)
            last = message.stamp_ns
    return stretch.posed(first_prior(), config.calibration.window_lines, 4).problem


def _samples(steps: Array) -> Samples:
    """Steps of the wheels (N, 2) right, left, as encoders tell them."""
    right, left = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]).T
    return Samples(SAMPLE_S * np.arange(right.size), right, left)


def _strewn(count: int, rng: np.random.Generator) -> Array:
    """Lines (count, 2) around the origin, m."""
    far, way = rng.uniform(1.3, 3.5, count), rng.uniform(-np.pi, np.pi, count)
    return np.stack([far * np.cos(way), far * np.sin(way)], axis=1)


def _bearings(place: Array, pose: Array, mount: Array, rng: np.random.Generator) -> Array:
    phi, rho, psi = mount
    sight = place - pose[:2] - rho * np.array([np.cos(pose[2] + phi), np.sin(pose[2] + phi)])
    beta = np.arctan2(sight[:, 1], sight[:, 0]) - pose[2] - phi - psi + STD * rng.standard_normal(place.shape[0])
    wrong = rng.random(beta.size) < OUTLIERS
    return np.asarray(wrap(np.where(wrong, rng.uniform(-np.pi, np.pi, beta.size), beta)))
