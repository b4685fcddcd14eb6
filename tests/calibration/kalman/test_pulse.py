"""What the filter goes on from: the smoother's lines, those of a sure distance, and what has come since."""

from functools import cache

import numpy as np
import pytest

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.pulse import Pulse
from omnivert.calibration.sighting import Sighting
from omnivert.calibration.solver.result import Result
from omnivert.calibration.solver.seed import BENT, LOOSE, Seed
from omnivert.config import Config
from omnivert.simulation.recording import Scene, recorded

STRANGER = 987_654


@cache
def solved() -> Result:
    calibrator = Calibrator(Config())
    for message in recorded(Scene(path="alternate", outliers=0.0), Config(), 3).messages:
        calibrator.step(message)
    result = calibrator.settle()
    assert result is not None
    return result


def seeded() -> Pulse:
    pulse = Pulse()
    pulse.mark()
    assert pulse.seed(solved())
    return pulse


def with_a_stranger(pulse: Pulse) -> Sighting:
    """What the filter expects, and one line more."""
    known = pulse.filter
    assert known is not None
    track = np.array([*known.tracks, STRANGER])
    beta = np.append(known.expected()[0], 1.0)
    return Sighting(0, track, beta, np.full(track.size, 0.003), ())


def test_a_line_that_the_smoother_does_not_know_stays_out_of_the_filter() -> None:
    pulse = seeded()
    assert pulse.filter is not None
    before = list(pulse.filter.tracks)
    assert pulse.update(with_a_stranger(pulse))
    assert pulse.filter.tracks == before
    assert pulse.innovation.new == 1


def test_what_came_since_the_mark_is_driven_through_again() -> None:
    """A seed that comes late ends where one that came at once would have ended."""
    at_once, late = seeded(), Pulse()
    sighting = with_a_stranger(at_once)
    late.mark()
    late.update(sighting)
    assert late.seed(solved())
    assert at_once.update(sighting)
    assert late.filter is not None
    assert at_once.filter is not None
    np.testing.assert_array_equal(late.filter.x, at_once.filter.x)
    np.testing.assert_array_equal(late.filter.P, at_once.filter.P)


@pytest.mark.parametrize("loose", [(), (0,), (1, 3), (0, 1, 2, 3)])
def test_lines_of_unsure_distance_are_left_out_of_a_seed_and_the_rest_stays_joint(loose: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    root = rng.standard_normal((11, 11))
    size = np.full(11, 0.01)
    size[[2 * k for k in loose]] = 1.5 * LOOSE
    spread = root @ root.T
    spread *= np.outer(size, size) / np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
    lines = rng.standard_normal((4, 2))
    firm = [k for k in range(4) if k not in loose]
    seed = Seed(lines, spread, (10, 11, 12, 13)).without_loose()
    rows = [i for k in firm for i in (2 * k, 2 * k + 1)] + [8, 9, 10]
    assert seed.tracks == tuple(10 + k for k in firm)
    np.testing.assert_array_equal(seed.lines, lines[firm])
    np.testing.assert_array_equal(seed.covariance, spread[np.ix_(rows, rows)])


def test_of_two_lines_as_unsure_the_near_one_alone_is_left_out_of_a_seed() -> None:
    """What a frame across shows of 1/D bends the more the nearer the line is."""
    std = BENT / 0.7
    lines = np.array([[0.5, 0.1], [1.0, 0.2]])
    seed = Seed(lines, np.diag(np.array([std, 0.01, std, 0.01, 0.01, 0.01, 0.01]) ** 2), (10, 11))
    assert std < LOOSE
    assert seed.without_loose().tracks == (10,)
