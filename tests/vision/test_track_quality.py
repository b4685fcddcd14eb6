"""How sure an identity is, against lines that are known to be seen well or badly."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.config import Vision
from omnivert.vision.lines import no_lines
from omnivert.vision.tracker import Tracker
from tests.vision.test_tracker import World

Float = NDArray[np.float64]

COUNT = 10
EVERY = np.arange(COUNT)
BAD, LEAN, GONE = 3, 5, 7  # lines seen badly in what follows


class Drive:
    """Turns on the spot; what befalls a frame is told for each."""

    def __init__(self, frames: int = 12) -> None:
        """Seen well so long."""
        self.world, self.tracker, self.frame = World(COUNT, seed=5), Tracker(Vision()), 0
        self.rng = np.random.default_rng(9)
        for _ in range(frames):
            self.quality = self.step()

    def step(self, *, unlike: float = 0.0, off_rad: float = 0.0, gone: bool = False) -> Float:
        """Quality by line, NaN where it is in no track.

        unlike   by how much the descriptor of BAD differs from the last one
        off_rad  how far LEAN is from where it should be, once to this side, once to that
        gone     GONE is not seen
        """
        which = EVERY[EVERY != GONE] if gone else EVERY
        lines, descriptor = self.world.seen(which, turn=0.02 * self.frame)
        if unlike:
            row = np.abs(descriptor[BAD] + self.rng.normal(0.0, unlike / np.sqrt(192.0), 192))
            descriptor[BAD] = np.sqrt(3.0) * row / np.linalg.norm(row)
        lines.angle_rad[LEAN] += off_rad * (-1.0) ** self.frame
        self.frame += 1
        tracked = self.tracker.step(lines, descriptor)
        assert np.array_equal(tracked.track_id[np.argsort(tracked.line)], which)  # identities stay
        quality = np.full(COUNT, np.nan)
        quality[which[tracked.line]] = tracked.quality
        return quality


def test_a_new_track_is_doubtful_and_grows_sure_while_it_is_matched_well() -> None:
    drive = Drive(frames=0)
    seen = np.array([drive.step() for _ in range(15)])
    assert np.all(seen[0] < 0.5)
    assert np.all(np.diff(seen[:8], axis=0) > 0.0)
    assert np.all(seen[-1] > 0.85)
    assert np.all(seen <= 1.0)


@pytest.mark.parametrize(("line", "unlike", "off_rad"), [(BAD, 0.6, 0.0), (LEAN, 0.0, 0.004)])
def test_quality_falls_while_a_line_is_matched_badly_and_rises_again(line: int, unlike: float, off_rad: float) -> None:
    drive = Drive()
    sure = drive.quality
    for _ in range(6):
        harmed = drive.step(unlike=unlike, off_rad=off_rad)
    assert harmed[line] < sure[line] - 0.15
    assert np.all(np.delete(harmed, line) > 0.8)
    for _ in range(8):
        healed = drive.step()
    assert healed[line] > sure[line] - 0.1


def test_the_worse_the_match_the_lower_the_quality() -> None:
    def after(unlike: float) -> float:
        drive = Drive()
        for _ in range(6):
            quality = drive.step(unlike=unlike)
        return float(quality[BAD])

    values = [after(unlike) for unlike in (0.0, 0.3, 0.45, 0.6)]
    assert np.all(np.diff(values) < 0.0)


@pytest.mark.parametrize("frames", [1, 3])
def test_a_line_that_was_gone_comes_back_less_sure(frames: int) -> None:
    drive = Drive()
    for _ in range(frames):
        drive.step(gone=True)
    back = drive.step()
    assert back[GONE] < np.min(np.delete(back, GONE)) - 0.1
    for _ in range(8):
        back = drive.step()
    assert back[GONE] > 0.8


def test_frames_without_lines_make_all_tracks_less_sure() -> None:
    drive = Drive()
    sure = drive.quality
    for _ in range(3):
        drive.tracker.step(no_lines(), np.empty((0, 192), dtype=np.float32))
        drive.frame += 1
    assert np.all(drive.step() < sure - 0.3)
