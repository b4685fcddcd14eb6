"""An encoder on a real pseudo-terminal that goes on sending, and a camera that is a folder of pictures."""

import os
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from omnivert.drivers.protocols.omnivert_line import line_from_sample
from omnivert.drivers.protocols.sample import Sample

PERIOD_S = 0.01


def line(number: int) -> bytes:
    """The reading of a robot that drives straight on."""
    return line_from_sample(Sample(int(1e6 * PERIOD_S) * number, number, number))


@contextmanager
def sending(port: Path, data: Callable[[int], bytes] = line) -> Iterator[Path]:
    """A board whose port has this name; it sends `data` of 0, 1, 2 ... every 10 ms."""
    master, slave = os.openpty()
    tty.setraw(master)
    port.symlink_to(os.ttyname(slave))
    stop = threading.Event()

    def send() -> None:
        number = 0
        while not stop.wait(PERIOD_S):
            os.write(master, data(number))
            number += 1

    board = threading.Thread(target=send, daemon=True)
    board.start()
    try:
        yield port
    finally:
        stop.set()
        board.join()
        port.unlink()
        os.close(master)
        os.close(slave)


def pictures(folder: Path, width: int = 64, height: int = 48) -> Path:
    folder.mkdir()
    for k in range(12):
        picture = np.random.default_rng(k).integers(0, 256, (height, width), np.uint8)
        cv2.imwrite(str(folder / f"{k:03}.png"), picture)
    return folder


def settings(port: Path, source: Path) -> dict[str, dict[str, object]]:
    """The tables of a configuration with these devices."""
    return {
        "encoder": {"port": str(port)},
        "camera": {"source": str(source), "width_px": 64, "height_px": 48, "frame_rate_hz": 50.0},
        "ring": {"center_px": [32, 24], "r_min_px": 5.0, "r_max_px": 22.0},
    }
