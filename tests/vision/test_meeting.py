"""Where lines meet, against lines that lean about a known point."""

import numpy as np
from numpy.typing import NDArray

from omnivert.config import MirrorRing
from omnivert.vision.edges import no_edges
from omnivert.vision.lines import Lines
from omnivert.vision.meeting import MeetingFinder

STD = 0.5


def _leaning(
    meeting: tuple[float, float], finder: MeetingFinder, rng: np.random.Generator, count: int = 40
) -> tuple[Lines, NDArray[np.float64]]:
    """Lines about a point as the finder's own would be fitted, their angles as if they met where it says; true ones."""
    true = np.sort(rng.uniform(-np.pi, np.pi, count))
    before = finder.point
    slant, asked = (-np.sin(true) * u - np.cos(true) * v for u, v in (meeting, before))
    lean, none = slant - asked + rng.normal(0.0, STD, count), np.zeros(count)
    lever = none + 0.002
    angle = true + (slant - asked) * lever
    sides = np.ones(count, dtype=np.int64)
    return Lines(angle, none + 1e-4, sides, none + 1, none + 63, none + 225, asked, lean, none + STD, lever), true


def _learnt(meeting: tuple[float, float], frames: int, seed: int, count: int = 40) -> MeetingFinder:
    finder, rng = MeetingFinder(MirrorRing()), np.random.default_rng(seed)
    _begun(finder)
    for _ in range(frames):
        finder.corrected(_leaning(meeting, finder, rng, count)[0])
    return finder


def _begun(finder: MeetingFinder) -> None:
    """Enough edges to look at, none of them on the ring: the centre it is, to begin with."""
    far = np.full(2000, 1e4, dtype=np.float32)
    finder.search(no_edges()._replace(u_px=far, v_px=far, gradient_u=far, gradient_v=far), (0.0, 0.0), 20.0)


def test_the_point_is_found_to_a_tenth_of_a_pixel_and_its_sigma_is_honest() -> None:
    off = []
    for seed in range(20):
        known = _learnt((3.0, -2.0), 40, seed).known
        assert known is not None
        assert known.used
        assert np.hypot(known.u_px - 3.0, known.v_px + 2.0) < 0.5
        off.append(((known.u_px - 3.0) / known.std_px, (known.v_px + 2.0) / known.std_px))
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 2.0


def test_lines_that_do_not_lean_meet_at_the_centre() -> None:
    for seed in range(5):
        finder = _learnt((0.0, 0.0), 40, seed)
        known = finder.known
        assert known is not None
        assert not known.used
        assert finder.point == (0.0, 0.0)


def test_of_a_few_lines_nothing_is_learnt() -> None:
    finder = _learnt((3.0, -2.0), 40, 0, count=4)
    known = finder.known
    assert known is not None
    assert not known.used
    assert known[:2] == (0.0, 0.0)


def test_frames_that_nod_are_each_corrected() -> None:
    """About a mean of 3 px, by 1 px rms."""
    finder, rng = MeetingFinder(MirrorRing()), np.random.default_rng(3)
    _begun(finder)
    without, left = [], []
    for frame in range(80):
        u, v = rng.normal(0.0, 1.0, 2)
        lines, true = _leaning((3.0 + u, v), finder, rng)
        corrected = finder.corrected(lines)
        if frame >= 30:
            without.append(lines.angle_rad - true)
            left.append(corrected.angle_rad - true)
    rms, before = (float(np.sqrt(np.mean(np.square(e)))) for e in (left, without))
    assert before > 1.5e-3  # a pixel on the lever is 2e-3
    assert rms < 0.25 * before
