"""A robot on a commanded path: the encoders tell the command, the world gets it with wheel noise (eq. 31)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from omnivert.odometry import after, arc

Array = NDArray[np.float64]
Path = Literal["paper", "alternate", "straight", "turn", "arc", "still"]

Leg = tuple[float, float, float]  # way along it (m), turn (rad), rest after it (s)

SPEED = 0.15  # m/s
TURN_RATE = np.deg2rad(9.0)  # rad/s
RAMP_S = 0.3  # to full speed, and to a stop


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """One drive. Samples are the encoders' own."""

    time_s: Array  # (S,)
    wheels_m: Array  # (S, 2) right, left, cumulative, as the encoders tell, before they are rounded to counts
    pose: Array  # (S, 3) where the robot really was


def drive(
    path: Path,
    base: float,
    noise_k: float,
    sample_s: float,
    rng: np.random.Generator,
    radius: float = 0.5,
    repeat: int = 1,
    wheel_ratio: float = 1.0,
    base_factor: float = 1.0,
) -> Robot:
    """A drive from (0, 0, 0), commanded by what is configured and done by the wheels that are really there.

    path      paper: straight 3.3 m, then 180 deg on the spot (Fig. 25); alternate: three times 0.75 m and 90 deg;
              straight: 6 m; turn: 360 deg; arc: 40 s on a circle of `radius`; still: 40 s
    base      m    as configured
    noise_k   m    variance of a wheel's displacement per metre, drawn anew at each sample
    sample_s  s    time between encoder samples
    wheel_ratio    right diameter / left diameter of the true wheels; their mean is as configured, because the common
                   scale of both cannot be seen from bearings
    base_factor    true base / configured base
    """
    match path:
        case "paper":
            legs: list[Leg] = [(3.3, 0.0, 0.0), (0.0, np.pi, 0.0)]
        case "alternate":
            legs = [(0.75, 0.0, 0.0), (0.0, np.pi / 2, 0.0)] * 3
        case "straight":
            legs = [(6.0, 0.0, 0.0)]
        case "turn":
            legs = [(0.0, 2.0 * np.pi, 0.0)]
        case "arc":
            legs = [(40.0 * SPEED, 40.0 * SPEED / radius, 0.0)]
        case "still":
            legs = [(0.0, 0.0, 40.0)]
    told = np.concatenate([np.zeros((1, 2)), told_steps(legs * (repeat if path != "still" else 1), base, sample_s)])
    real = told * wheel_factors(wheel_ratio) + np.sqrt(noise_k * np.abs(told)) * rng.standard_normal(told.shape)
    pose = np.zeros((told.shape[0], 3))
    for i, step in enumerate(arc(real[1:, 0], real[1:, 1], base * base_factor)):
        pose[i + 1] = after(pose[i], step)
    return Robot(sample_s * np.arange(told.shape[0], dtype=np.float64), np.cumsum(told, axis=0), pose)


def told_steps(
    legs: Sequence[Leg], base: float, sample_s: float, speed: float = SPEED, turn_rate: float = TURN_RATE
) -> Array:
    """What the encoders tell in each sample of a commanded path: each leg begins and ends at rest.

    base      m
    sample_s  s      between samples
    speed     m/s    of the origin
    turn_rate rad/s  on the spot
    returns   (S, 2) m, right and left wheel
    """
    steps = [np.zeros((0, 2))]
    for way, turn, rest in legs:
        if way or turn:
            duration = _duration_s(way, turn, speed, turn_rate)
            time = np.arange(0.0, duration + sample_s, sample_s)
            share = np.diff(np.clip(_ramped(time, duration), 0.0, 1.0))
            steps.append(share[:, None] * np.array([way + 0.5 * base * turn, way - 0.5 * base * turn]))
        steps.append(np.zeros((round(rest / sample_s), 2)))
    return np.concatenate(steps)


def lasts_s(legs: Sequence[Leg], speed: float, turn_rate: float) -> float:
    """s, all legs together; the arguments are those of `told_steps`"""
    return sum(rest + (_duration_s(way, turn, speed, turn_rate) if way or turn else 0.0) for way, turn, rest in legs)


def _duration_s(way: float, turn: float, speed: float, turn_rate: float) -> float:
    return max(abs(way) / speed, 0.0 if way else abs(turn) / turn_rate) + RAMP_S


def wheel_factors(ratio: float) -> Array:
    """(2,) true displacement / told displacement of the right and the left wheel, for a ratio of their diameters."""
    return np.array([2.0 * ratio / (1.0 + ratio), 2.0 / (1.0 + ratio)])


def _ramped(time: Array, duration: float) -> Array:
    """Share of the way done: speed rises for RAMP_S, stays, and falls for RAMP_S."""
    full = duration - RAMP_S
    up = np.minimum(time, RAMP_S)
    down = np.clip(time - full, 0.0, RAMP_S)
    middle = np.clip(time - RAMP_S, 0.0, full - RAMP_S)
    return (0.5 * up**2 / RAMP_S + middle + down - 0.5 * down**2 / RAMP_S) / full
