"""What goes on from a solution: the filter with the lines that the smoother knows, the watchdog's scout with all."""

from functools import cache

import numpy as np
import pytest

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.pulse import Pulse
from omnivert.calibration.sighting import Sighting
from omnivert.calibration.solver.result import Result
from omnivert.calibration.solver.seed import LOOSE, Seed
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


def seeded(is_watched: bool) -> Pulse:
    pulse = Pulse()
    pulse.mark()
    pulse.seed(solved(), is_watched)
    return pulse


def with_a_stranger(pulse: Pulse) -> Sighting:
    """What the filter expects, and one line more."""
    known = pulse.filter
    assert known is not None
    track = np.array([*known.tracks, STRANGER])
    beta = np.append(known.expected()[0], 1.0)
    return Sighting(0, track, beta, np.full(track.size, 0.003), ())


def test_the_scout_takes_up_a_line_at_its_first_sight_and_the_filter_never() -> None:
    pulse = seeded(is_watched=True)
    assert pulse.update(with_a_stranger(pulse))
    scout, evidence = pulse.watched
    assert scout is not None
    assert scout is not pulse.filter
    assert pulse.filter is not None
    assert STRANGER in scout.tracks
    assert STRANGER not in pulse.filter.tracks
    assert evidence is not None
    assert evidence.nu.size == len(pulse.filter.tracks)


def test_unwatched_there_is_no_scout_and_the_filter_stands_in() -> None:
    pulse = seeded(is_watched=False)
    assert pulse.update(with_a_stranger(pulse))
    assert pulse.watched == (pulse.filter, pulse.innovation.evidence)
    watched = seeded(is_watched=True)
    watched.seed(solved(), is_watched=False)
    assert watched.watched[0] is watched.filter


def test_the_scout_changes_nothing_of_the_filter() -> None:
    one, other = seeded(is_watched=False), seeded(is_watched=True)
    for pulse in (one, other):
        for _ in range(3):
            assert pulse.update(with_a_stranger(pulse))
    assert one.filter is not None
    assert other.filter is not None
    np.testing.assert_array_equal(one.filter.x, other.filter.x)
    np.testing.assert_array_equal(one.filter.P, other.filter.P)


def test_a_dropped_pulse_is_watched_through_nothing() -> None:
    pulse = seeded(is_watched=True)
    pulse.update(with_a_stranger(pulse))
    pulse.drop()
    assert pulse.watched[0] is None


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
