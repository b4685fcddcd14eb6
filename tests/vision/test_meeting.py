"""Where lines meet, against lines that lean about a known point."""

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import MirrorRing
from omnivert.vision.edges import no_edges
from omnivert.vision.lines import Lines
from omnivert.vision.meeting import MeetingFinder

STD = 0.5


def _leaning(
    meeting: tuple[float, float], finder: MeetingFinder, rng: np.random.Generator, count: int = 40
) -> tuple[Lines, Lines, NDArray[np.float64]]:
    """Lines about a point as the finder has them, as they would be fitted where it first looks, and true angles."""
    true = np.sort(rng.uniform(-np.pi, np.pi, count))
    noise, none = rng.normal(0.0, STD, count), np.zeros(count)
    lever, sides = none + 0.002, np.ones(count, dtype=np.int64)

    def about(asked_for: tuple[float, float]) -> Lines:
        """Angles as if they met where they are asked to."""
        slant, asked = (-np.sin(true) * u - np.cos(true) * v for u, v in (meeting, asked_for))
        lean, angle = slant - asked + noise, true + (slant - asked) * lever
        return Lines(angle, none + 1e-4, sides, none + 1, none + 63, none + 225, asked, lean, none + STD, lever)

    first = about(finder.point)
    return finder.lines(about), first, true


def _learnt(meeting: tuple[float, float], frames: int, seed: int, count: int = 40) -> MeetingFinder:
    finder, rng = MeetingFinder(MirrorRing()), np.random.default_rng(seed)
    _begun(finder)
    for _ in range(frames):
        _leaning(meeting, finder, rng, count)
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
        corrected, first, true = _leaning((3.0 + u, v), finder, rng)
        if frame >= 30:
            without.append(first.angle_rad - true)
            left.append(corrected.angle_rad - true)
    rms, before = (float(np.sqrt(np.mean(np.square(e)))) for e in (left, without))
    assert before > 1.5e-3  # a pixel on the lever is 2e-3
    assert rms < 0.25 * before


@pytest.mark.parametrize("nodding", [0.0, 0.3, 1.0, 3.0])
def test_what_is_told_of_a_nodding_robot_is_as_good_as_it_says(nodding: float) -> None:
    """The point of each frame, by its own sigma; and the bearings, by theirs."""
    point, bearing = [], []
    for seed in range(6):
        finder, rng = MeetingFinder(MirrorRing()), np.random.default_rng(seed)
        _begun(finder)
        for frame in range(60):
            at = (4.0 + nodding * rng.normal(), -3.0 + nodding * rng.normal())
            lines, _, true = _leaning(at, finder, rng)
            known = finder.known
            if frame >= 5 and known is not None and known.used:
                point.append(np.array((known.u_px - at[0], known.v_px - at[1])) / known.std_px)
                bearing.append(wrap(lines.angle_rad - true) / lines.std_rad)
    assert len(point) == 6 * 55
    assert 0.35 < np.sqrt(np.mean(np.square(point))) < 1.3  # it nods a little for all that the finder knows
    assert np.sqrt(np.mean(np.square(bearing))) < 1.3


def test_the_mean_does_not_stick_to_where_the_robot_began() -> None:
    """It stands leaning for 5 frames, then nods about the upright."""
    finder, rng = MeetingFinder(MirrorRing()), np.random.default_rng(1)
    _begun(finder)
    for frame in range(200):
        _leaning((6.0, 0.0) if frame < 5 else (rng.normal(), rng.normal()), finder, rng)
    assert np.hypot(*finder.point) < 0.7
