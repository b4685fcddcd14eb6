"""A drive of many hours: is a camera that stays ever called moved, and does anything grow?"""

import gc
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.solver.result import Outcome
from omnivert.config import Config
from omnivert.messages import Bearings, Extrinsics, State, Ticks
from omnivert.simulation.recording import recorded
from omnivert.studies.presets import Case
from omnivert.studies.run import with_noise

Array = NDArray[np.float64]

WARM_H = 0.5  # before memory is asked to stay where it is: kernels, caches and windows fill
NAMES = 1_000_000  # of the tracks of one room


@dataclass(frozen=True, slots=True)
class Room:
    """Some minutes of the drive."""

    case: str
    seed: int
    hours: float  # driven when it was left
    frames: int
    alarms: tuple[str, ...]
    calibrated_frames: int
    memory_mb: float  # resident, of the whole process, when it was left
    frame_ms: float  # CPU time for a frame, solves among them
    solves: int
    solve_median_ms: float  # CPU time
    solve_max_ms: float
    solved_keyframes: int  # at most, together


def rooms_of(case: Case, config: Config, seed: int, hours: float) -> Iterator[Room]:
    """One robot with one camera, from room to room: in each other lines stand, and no track goes on."""
    config = with_noise(config, case.noise_k_m)
    rng = np.random.default_rng([seed, 2])
    mount = (rng.uniform(-np.pi, np.pi), rng.uniform(0.08, 0.40), rng.uniform(-np.pi, np.pi))
    solves: list[float] = []

    def timed(job: Callable[[], Outcome]) -> Callable[[], Outcome]:
        began = time.process_time()
        outcome = job()
        solves.append(time.process_time() - began)
        return lambda: outcome

    calibrator = Calibrator(config, background=timed)
    last, number = Ticks(0, 0, 0), 0
    while last.stamp_ns < hours * 3600e9:
        drive = recorded(replace(case.scene, mount=mount), config, 1000 * seed + number)
        step_ns = round(1e9 * case.scene.sample_s) if number else 0
        start = Ticks(last.stamp_ns + step_ns, last.left, last.right)
        alarms: list[str] = []
        frames = calibrated = 0
        size = 0
        solves.clear()
        began = time.process_time()
        for message in drive.messages:
            match message:
                case Ticks():
                    last = Ticks(
                        message.stamp_ns + start.stamp_ns, message.left + start.left, message.right + start.right
                    )
                    told = calibrator.step(last)
                case Bearings():
                    names = message.track_id + NAMES * number
                    told = calibrator.step(replace(message, stamp_ns=message.stamp_ns + start.stamp_ns, track_id=names))
            for word in told:
                if not isinstance(word, Extrinsics):
                    frames += 1
                    calibrated += word.state is State.CALIBRATED
                    size = max(size, calibrator.solved_keyframes)
                elif word.state is State.MOVED:
                    alarms.append(" ".join(word.reasons))
        spent = time.process_time() - began
        number += 1
        yield Room(
            case.name,
            seed,
            last.stamp_ns / 3600e9,
            frames,
            tuple(alarms),
            calibrated,
            memory_mb(),
            1e3 * spent / max(frames, 1),
            len(solves),
            1e3 * float(np.median(solves)) if solves else 0.0,
            1e3 * max(solves, default=0.0),
            size,
        )


def drive_of(case: Case, config: Config, seed: int, hours: float) -> list[Room]:
    return list(rooms_of(case, config, seed, hours))


def memory_mb() -> float:
    """Resident memory of this process; what nobody holds any more is given back first."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def endurance_study(cases: Sequence[Case], rooms: Sequence[Room]) -> dict[str, Any]:
    """Figures of each case below "paths", with its targets beside them, and each room of it."""
    from omnivert.studies.summary import met

    paths = {}
    for case in cases:
        own = [room for room in rooms if room.case == case.name]
        figures = endurance_figures(own)
        figures["targets_met"] = {name: met(figures, name, *within) for name, within in case.targets.items()}
        paths[case.name] = figures
    return {"paths": paths}


def endurance_figures(rooms: Sequence[Room]) -> dict[str, Any]:
    """Of the rooms of one case, in the order of the drive."""
    frames = sum(room.frames for room in rooms)
    drives = [[room for room in rooms if room.seed == seed] for seed in dict.fromkeys(room.seed for room in rooms)]
    hours = sum(drive[-1].hours for drive in drives)
    alarms = [word for room in rooms for word in room.alarms]
    growth = [slope for drive in drives if (slope := _per_hour(drive, [room.memory_mb for room in drive])) is not None]
    slower = [slope for drive in drives if (slope := _per_hour(drive, [room.solve_median_ms for room in drive]))
              is not None]  # fmt: skip
    return {
        "drives": len(drives),
        "hours": hours,
        "frames": frames,
        "false_alarms": len(alarms),
        "false_alarms_per_h": len(alarms) / hours if hours else None,
        "alarms": alarms,
        "calibrated_share": sum(room.calibrated_frames for room in rooms) / frames if frames else None,
        "memory_growth_mb_per_h": max(growth) if growth else None,
        "memory_mb": [room.memory_mb for room in rooms],
        "solve_growth_ms_per_h": max(slower) if slower else None,
        "solve_median_ms": [room.solve_median_ms for room in rooms],
        "solve_max_ms": [room.solve_max_ms for room in rooms],
        "solved_keyframes": [room.solved_keyframes for room in rooms],
        "frame_ms": [room.frame_ms for room in rooms],
        "at_h": [room.hours for room in rooms],
    }


def _per_hour(drive: Sequence[Room], values: Sequence[float]) -> float | None:
    """Slope of the middle line through the values (Theil and Sen) once it is warm; None when that is too short."""
    warm = [(room.hours, value) for room, value in zip(drive, values, strict=True) if room.hours >= WARM_H]
    if len(warm) < 4:
        return None
    time_h, value = np.array(warm).T
    i, j = np.triu_indices(time_h.size, 1)
    return float(np.median((value[j] - value[i]) / (time_h[j] - time_h[i])))
