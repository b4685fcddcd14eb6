"""What a live robot's wheels are told next: along its path, until somebody steers it by hand."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Drive
from omnivert.simulation.vehicle import SAMPLE_S, Vehicle

Array = NDArray[np.float64]

STALE_S = 0.5  # after which a command holds no longer


class Steering:
    """The path goes on until the first command; from then on only commands count.

    told  (S, 2)  m, right and left wheel in each sample of the path
    """

    def __init__(self, vehicle: Vehicle, told: Array) -> None:
        self._vehicle = vehicle
        self._path: Iterator[Array] = iter(told)
        self._command: Drive | None = None
        self._heard_s = 0.0
        self.on_path = True  # whether the path goes on

    def take(self, command: Drive, now_s: float) -> None:
        """A command has come."""
        self._command, self._heard_s, self.on_path = command, now_s, False

    def step(self, now_s: float) -> None:
        """One sample of the wheels."""
        told = next(self._path, None) if self.on_path else None
        if told is None:
            self.on_path = False
            forward, turn = self._wanted(now_s)
            told = self._vehicle.steered(forward, turn, SAMPLE_S)
        self._vehicle.step(told)

    def _wanted(self, now_s: float) -> tuple[float, float]:
        if self._command is None or now_s - self._heard_s > STALE_S:
            return 0.0, 0.0
        return self._command.forward_m_s, self._command.turn_rad_s
