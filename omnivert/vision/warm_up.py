"""Compiles, before the first real frame comes, what a frame needs: the first time on a machine that takes a while."""

import numpy as np

from omnivert.config import Config
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd

_SPOKES = 24


def warm_up(config: Config) -> None:
    """Takes a drawn picture through a front end of its own, twice: kernels are read from disk, or compiled and kept."""
    front_end = FrontEnd(config)
    width, height = config.camera.width_px, config.camera.height_px
    (center_u, center_v), ring = config.ring.center_px, config.ring
    v, u = np.mgrid[:height, :width]
    radius, angle = np.hypot(u - center_u, v - center_v), np.arctan2(center_v - v, u - center_u)
    bright = (angle * _SPOKES / np.pi).astype(np.int64) % 2 == 1
    inside = (radius > ring.r_min_px) & (radius < ring.r_max_px)
    grey = np.where(inside, np.where(bright, 170, 90), 20).astype(np.uint8)
    for stamp in range(2):  # the second time there are tracks to continue
        front_end.step(Frame(stamp, PixelFormat.GREY8, width, height, grey.ravel()))
