"""What a step of the front end asks for and keeps, as far as Python sees it: not what compiled kernels work in."""

import gc
import tracemalloc

from omnivert.vision.frontend import FrontEnd
from tests.vision.drive import corridor

PICTURE_BYTES = 640 * 480


def test_a_step_asks_for_little_memory_and_keeps_none() -> None:
    """On raw frames: a decoded picture would come on top. There and back, so that lap after lap begins alike."""
    drive = corridor(0, 25)
    front, lap = FrontEnd(drive.config), (*drive.frames, *drive.frames[::-1])
    for frame in lap[:10]:
        front.step(frame)  # kernels are made or read before anybody counts
    tracemalloc.start()
    try:
        for frame in lap:
            front.step(frame)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        most = 0
        for frame in 2 * lap:
            tracemalloc.reset_peak()
            now, _ = tracemalloc.get_traced_memory()
            front.step(frame)
            most = max(most, tracemalloc.get_traced_memory()[1] - now)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 4 * PICTURE_BYTES  # measured 2.2 of them
    assert after - before < 30_000  # over 100 steps; measured 10 300
