"""More lines in a frame than are taken: which go on, and that what they cost has a bound."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.choice import SECTORS, UNSEEN, Choice
from omnivert.calibration.sighting import Sighting
from omnivert.config import Calibration, Config
from omnivert.messages import Bearings, Estimate, State
from omnivert.simulation.recording import Scene, recorded

Array = NDArray[np.float64]
MOST = 20
SECTOR = 2.0 * np.pi / SECTORS


def sighting(track: NDArray[np.integer] | list[int], beta: Array | None = None, std: Array | None = None) -> Sighting:
    names = np.sort(np.asarray(track, dtype=np.int64))
    around = np.linspace(-3.0, 3.0, names.size) if beta is None else beta
    return Sighting(0, names, around, np.full(names.size, 0.003) if std is None else std, ())


@given(st.lists(st.frozensets(st.integers(0, 60), max_size=45), max_size=12), st.integers(0, 2**32 - 1))
def test_a_frame_goes_on_whole_or_as_the_most_that_are_taken(frames: list[frozenset[int]], seed: int) -> None:
    rng = np.random.default_rng(seed)
    choice, left_out = Choice(MOST), 0
    for names in frames:
        whole = sighting(sorted(names), rng.uniform(-np.pi, np.pi, len(names)))
        part = choice.step(whole)
        left_out += max(0, len(names) - MOST)
        assert choice.left_out == left_out
        if len(names) <= MOST:
            assert part is whole
            continue
        assert part.reasons == (f"{len(names)} lines in a frame, {MOST} of them taken",)
        assert part.track.size == MOST
        assert (np.diff(part.track) > 0).all()
        place = np.searchsorted(whole.track, part.track)
        assert (whole.track[place] == part.track).all()
        assert (whole.beta[place] == part.beta).all()


@given(st.integers(MOST + 1, 90), st.integers(0, 2**32 - 1))
def test_a_line_that_was_taken_stays_while_it_is_seen(lines: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    choice = Choice(MOST)
    first = choice.step(sighting(np.arange(lines), rng.uniform(-np.pi, np.pi, lines)))
    for _ in range(5):
        newcomers = 1000 + np.unique(rng.integers(0, 1000, 50))
        names = np.concatenate([np.arange(lines), newcomers])
        taken = choice.step(sighting(names, rng.uniform(-np.pi, np.pi, names.size), rng.uniform(1e-4, 0.1, names.size)))
        assert (taken.track == first.track).all()


def test_lines_that_are_missed_now_and_then_keep_their_places() -> None:
    rng = np.random.default_rng(1)
    choice = Choice(MOST)
    sights: dict[int, int] = {}
    frames = 200
    for _ in range(frames):
        for track in choice.step(sighting(np.flatnonzero(rng.random(300) < 0.9))).track.tolist():
            sights[track] = sights.get(track, 0) + 1
    # Of every line nine of ten sights come; the few that fill the gaps of the others take the rest.
    often = sorted(sights.values(), reverse=True)[:MOST]
    assert min(often) > 0.75 * frames
    assert len(sights) < 2 * MOST


def test_free_places_go_where_the_circle_has_the_fewest() -> None:
    rng = np.random.default_rng(2)
    crowd, few = rng.uniform(0.0, SECTOR, 500), -np.pi + SECTOR * (np.arange(12) + 0.5)
    beta = np.concatenate([crowd, few])
    taken = choice_of(beta)
    assert set(np.arange(500, 512)) <= set(taken.track.tolist())
    again = Choice(MOST)
    again.step(sighting(np.arange(8), crowd[:8]))  # eight of the crowd are followed already
    held = again.step(sighting(np.arange(512), beta))
    assert set(range(8)) | set(range(500, 512)) == set(held.track.tolist())


@given(st.lists(st.integers(0, SECTORS - 1), min_size=MOST + 1, max_size=80), st.integers(0, 2**32 - 1))
def test_no_part_of_the_circle_has_two_more_than_one_that_could_have_more(sector: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    beta = -np.pi + SECTOR * (np.array(sector) + 0.5)
    std = rng.uniform(1e-4, 0.1, beta.size)
    taken = choice_of(beta, std)
    there = np.bincount(sector, minlength=SECTORS)
    own = np.bincount([sector[k] for k in taken.track], minlength=SECTORS)
    assert own.max() <= own[own < there].min(initial=own.max()) + 1
    for k in set(range(beta.size)) - set(taken.track.tolist()):  # in each part the most precise ones
        assert all(std[k] >= std[t] for t in taken.track.tolist() if sector[t] == sector[k])


def choice_of(beta: Array, std: Array | None = None) -> Sighting:
    return Choice(MOST).step(sighting(np.arange(beta.size), beta, std))


def test_tracks_that_never_come_again_are_forgotten() -> None:
    choice = Choice(MOST)
    for frame in range(50):
        choice.step(sighting(50 * frame + np.arange(50)))
    assert choice._name.size == 50 * (UNSEEN + 1)
    assert choice._name.min() >= 50 * (50 - UNSEEN - 1)


def test_a_drive_among_too_many_lines_is_calibrated_by_the_part_that_is_taken() -> None:
    config = Config(calibration=Calibration(frame_lines=MOST))
    drive = recorded(Scene(visible=700, lines=1400, path="paper"), config, 12)
    calibrator, estimates = Calibrator(config), list[Estimate]()
    for message in drive.messages:
        estimates += [out for out in calibrator.step(message) if isinstance(out, Estimate)]
    lines = [m.track_id.size for m in drive.messages if isinstance(m, Bearings)]
    assert calibrator.left_out == sum(n - MOST for n in lines)
    assert calibrator.refused == {}
    for told, count in zip(estimates, lines, strict=True):
        assert told.lines_used + told.lines_new + told.lines_rejected <= MOST
        assert f"{count} lines in a frame, {MOST} of them taken" in told.reasons
    last = estimates[-1]
    assert last.state is State.CALIBRATED
    assert last.mount is not None
    off = np.array([last.mount.phi_rad, last.mount.rho_m, last.mount.psi_rad]) - drive.mount
    off[[0, 2]] = wrap(off[[0, 2]])
    assert off @ np.linalg.solve(last.mount.covariance, off) < 21.1  # chi-square of 3, 1 in 10 000
