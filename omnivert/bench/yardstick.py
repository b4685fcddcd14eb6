"""A pair of Sobel filters over the whole frame: what every time is compared with."""

import time

import cv2

from omnivert.vision.image import Grey


def sobel_pair_s(grey: Grey) -> float:
    """Seconds for cv2.Sobel in u and in v: the second of two goes, when the picture is in the cache for sure."""
    began = 0.0
    for _ in range(2):
        began = time.perf_counter()
        cv2.Sobel(grey, cv2.CV_16S, 1, 0)
        cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    return time.perf_counter() - began
