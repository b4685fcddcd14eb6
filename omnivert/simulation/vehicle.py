"""A robot in a room: takes what its wheels are told in a sample, keeps where it really is (eqs. 14, 15, 31)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.odometry import after, arc
from omnivert.simulation.robot import RAMP_S, SPEED
from omnivert.simulation.surfaces import Surfaces

Array = NDArray[np.float64]

SAMPLE_S = 0.02  # between two readings of the encoders
BODY_M = 0.28  # no wall comes nearer to the robot's origin than this,
CASE_M = 0.05  # nor, whatever way it turns, to the camera than this
ACCELERATION = SPEED / RAMP_S  # m/s^2, of each wheel


@dataclass(frozen=True, slots=True)
class Counts:
    """What the encoders have counted, cumulative."""

    left: int
    right: int


class Vehicle:
    """The robot. A wall stops it: the wheels stand still rather than slip.

    pose     (3,)  m, m, rad: where it really is
    noise_k  m     variance of a wheel's way per metre, drawn anew in each sample
    seed           of that noise
    rho_m    m     how far from its origin the camera sits
    """

    def __init__(
        self, config: Config, room: Surfaces, pose: Array, noise_k: float, seed: int, rho_m: float = 0.0
    ) -> None:
        self.pose = pose
        self.blocked = False  # whether the last step would have led into something
        self._base, self._scale = config.robot.wheel_base_m, config.encoder.metres_per_tick
        self._room, self._noise_k = room, noise_k
        self._rng = np.random.default_rng(seed)
        self._body_m = max(BODY_M, rho_m + CASE_M)
        self._clear = clearance(room, pose[:2])
        self._told = np.zeros(2)  # right, left
        self._speed = np.zeros(2)  # m/s, of the wheels

    @property
    def counts(self) -> Counts:
        right, left = self._told / self._scale
        return Counts(round(float(left)), round(float(right)))

    def step(self, told: Array) -> None:
        """One sample: (2,) m, what the right and the left wheel are told."""
        real = told + np.sqrt(self._noise_k * np.abs(told)) * self._rng.standard_normal(2)
        pose = after(self.pose, arc(real[:1], real[1:], self._base)[0])
        clear = clearance(self._room, pose[:2])
        self.blocked = clear < self._body_m and clear < self._clear
        if self.blocked:
            self._speed[:] = 0.0
            return
        self.pose, self._clear = pose, clear
        self._told = self._told + told

    def steered(self, forward_m_s: float, turn_rad_s: float, sample_s: float) -> Array:
        """(2,) m, what the wheels are told so that they come nearer to these speeds, no faster than they can."""
        wanted = forward_m_s + 0.5 * self._base * turn_rad_s * np.array([1.0, -1.0])
        most = ACCELERATION * sample_s
        before = self._speed
        self._speed = before + np.clip(wanted - before, -most, most)
        return np.asarray(0.5 * (before + self._speed) * sample_s)


def clearance(room: Surfaces, point: Array) -> float:
    """m, from a point to whatever is nearest of what stands no higher than the knee; inf in an empty world"""
    low = room.heights[:, 0] < 0.5
    flat = np.arange(low.size) < room.flat
    panels, rounds = room.place[low & flat], room.place[low & ~flat]
    start, along = panels[:, :2], panels[:, 2:] - panels[:, :2]
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - start) * along).sum(axis=1) / length, 0.0, 1.0)
    to_panel = np.hypot(*(start + share[:, None] * along - point).T)
    to_round = np.hypot(*(rounds[:, :2] - point).T) - rounds[:, 2]
    return float(np.concatenate((to_panel, to_round, [np.inf])).min())
