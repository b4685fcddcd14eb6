"""Compiles, before the first real drive, what a calibration needs: the first time on a machine that takes a while."""

import numpy as np

from omnivert.angles import wrap
from omnivert.calibration.calibrator import Calibrator
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.odometry import SECOND

_FRAMES = 48
_LINES = 8
_WAY_M, _TURN_RAD = 0.05, 0.08  # from frame to frame, straight and on the spot in turn


def warm_up(config: Config) -> None:
    """Takes a small made-up drive through a calibrator of its own: kernels are read from disk, or compiled and kept."""
    calibrator = Calibrator(config)
    scale, base = config.encoder.metres_per_tick, config.robot.wheel_base_m
    around = 2.0 * np.pi * np.arange(_LINES) / _LINES
    lines = 2.5 * np.stack([np.cos(around), np.sin(around)], axis=1)
    x, heading, right, left = -0.6, 0.0, 0.0, 0.0
    for k in range(_FRAMES):
        stamp = k * SECOND // 5
        calibrator.step(Ticks(stamp, round(left / scale), round(right / scale)))
        camera = np.array([x + 0.2 * np.cos(heading), 0.2 * np.sin(heading)])
        sight = lines - camera
        bearing = wrap(np.arctan2(sight[:, 1], sight[:, 0]) - heading)
        few = np.zeros(_LINES, dtype=np.int32)
        calibrator.step(
            Bearings(stamp, np.arange(_LINES), bearing, np.full(_LINES, 0.003), few, np.ones(_LINES, dtype=np.float32))
        )
        if k % 24 < 12:
            x, right, left = x + _WAY_M, right + _WAY_M, left + _WAY_M
        else:
            heading += _TURN_RAD
            right, left = right + 0.5 * base * _TURN_RAD, left - 0.5 * base * _TURN_RAD
    calibrator.settle()
