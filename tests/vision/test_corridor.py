"""The front end on the rendered corridor, against its exact truth; limits hold a margin below what was measured."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd

Float = NDArray[np.float64]

NEAR = np.deg2rad(0.7)
FRAMES = range(110)  # the straight, the turn on the spot, and half way round


class Truth(NamedTuple):
    line_id: NDArray[np.int64]
    bearing: Float
    share: Float
    contrast: Float
    moving: Float  # bearings that are neither right nor wrong: silhouettes of round things, moving things


class Run(NamedTuple):
    seen: list[Bearings]
    truth: list[Truth]
    center: Float


def _columns(path: Path, *names: str) -> Float:
    with path.open(newline="") as file:
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


@pytest.fixture(scope="module")
def run(shared_data: Path) -> Run:
    folder = shared_data / "corridor"
    rows = _columns(folder / "truth/lines.csv", "index", "line_id", "bearing_rad", "visible_fraction", "contrast")
    neither = _columns(folder / "truth/nonstatic_lines.csv", "index", "bearing_rad")
    front = FrontEnd(Config())
    seen, truth = [], []
    for index in FRAMES:
        data = np.fromfile(folder / f"frames/{index:06d}.jpg", dtype=np.uint8)
        seen.append(front.step(Frame(index, PixelFormat.JPEG, 640, 480, data)))
        mine = rows[rows[:, 0] == index]
        moving = neither[neither[:, 0] == index, 1]
        truth.append(Truth(mine[:, 1].astype(np.int64), mine[:, 2], mine[:, 3], mine[:, 4], moving))
    return Run(seen, truth, _columns(folder / "truth/centers.csv", "cu_px", "cv_px")[list(FRAMES)])


def _apart(a: Float, b: Float) -> Float:
    return np.abs(wrap(a[:, None] - b[None, :]))


def test_the_ring_centre_is_known_to_a_twentieth_of_a_pixel(run: Run) -> None:
    centers = np.array([(s.ring.center_u_px, s.ring.center_v_px) for s in run.seen if s.ring is not None])
    assert centers.shape == run.center.shape
    assert np.sqrt(np.mean((centers - run.center) ** 2)) < 0.05  # measured 0.023


def test_strong_lines_are_found_and_what_is_found_is_there(run: Run) -> None:
    strong_found, strong, good, judged, lines = 0, 0, 0, 0, 0
    for s, t in zip(run.seen, run.truth, strict=True):
        is_strong = (t.share > 0.5) & (t.contrast > 12.0)
        strong_found += int(np.sum(np.min(_apart(t.bearing[is_strong], s.bearing_rad), axis=1) < NEAR))
        strong += int(np.sum(is_strong))
        there = (t.share > 0.15) & (t.contrast > 5.0)
        right = np.min(_apart(s.bearing_rad, t.bearing[there]), axis=1) < NEAR
        neither = np.min(_apart(s.bearing_rad, t.moving), axis=1, initial=np.pi) < NEAR
        good += int(np.sum(right))
        judged += int(np.sum(right | ~neither))
        lines += s.track_id.size
    assert lines / len(run.seen) > 45  # measured 55
    assert strong_found / strong > 0.88  # measured 0.93
    assert good / judged > 0.90  # measured 0.94


def test_bearings_are_sharp_and_their_sigmas_true(run: Run) -> None:
    error, normalised = [], []
    for s, t in zip(run.seen, run.truth, strict=True):
        there = (t.share > 0.15) & (t.contrast > 5.0)
        alone = np.sum(_apart(t.bearing, t.bearing[there]) < np.deg2rad(1.2), axis=1) == 1
        for bearing in t.bearing[alone & (t.share > 0.5) & (t.contrast > 12.0)]:
            i = int(np.argmin(np.abs(wrap(s.bearing_rad - bearing))))
            off = float(wrap(float(s.bearing_rad[i] - bearing)))
            if abs(off) < NEAR:
                error.append(off)
                normalised.append(off / s.std_rad[i])
    assert len(error) > 800
    assert 1.4826 * np.median(np.abs(error)) < 0.9e-3  # measured 0.76 mrad
    assert 0.7 < 1.4826 * np.median(np.abs(normalised)) < 1.3  # measured 0.97
    assert np.mean(np.abs(normalised) > 4.0) < 0.03  # measured 0.010


def test_identities_stay_with_their_lines(run: Run) -> None:
    """Links between consecutive frames: the same true edge lies at both ends."""
    correct, false = 0, 0
    for k in range(1, len(run.seen)):
        old, new, t_old, t_new = run.seen[k - 1], run.seen[k], run.truth[k - 1], run.truth[k]
        _, i, j = np.intersect1d(old.track_id, new.track_id, return_indices=True)
        _, p, q = np.intersect1d(t_old.line_id, t_new.line_id, return_indices=True)
        at_old = _apart(old.bearing_rad[i], t_old.bearing[p]) < NEAR
        at_new = _apart(new.bearing_rad[j], t_new.bearing[q]) < NEAR
        known = np.any(at_old, axis=1) & (np.min(_apart(new.bearing_rad[j], t_new.bearing), axis=1) < NEAR)
        one_edge = np.any(at_old & at_new, axis=1)
        correct += int(np.sum(known & one_edge))
        false += int(np.sum(known & ~one_edge))
    assert correct / len(run.seen) > 38  # measured 45
    assert false / (correct + false) < 0.01  # measured 0.003


def test_tracks_are_few_and_long(run: Run) -> None:
    tracks = {int(t) for s in run.seen for t in s.track_id}
    links = sum(s.track_id.size for s in run.seen)
    assert links / len(tracks) > 25.0  # measured 44 frames a track
    assert max(int(s.age_frames.max()) for s in run.seen) == len(run.seen) - 1
