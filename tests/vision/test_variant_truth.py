"""The variants' own truth, found out independently: it judges everything else."""

import cv2
import numpy as np
import pytest

from omnivert.angles import TURN, wrap
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.score import score
from omnivert.bench.score.truth import Sighting
from tests.vision.drive import Drive, corridor, image_angle
from tests.vision.lighting import gain
from tests.vision.painting import Bar, center_of, covered, hidden, painted, steps
from tests.vision.reframing import mapped, mirrored, quarter_turned, tilted
from tests.vision.variants import VARIANTS


@pytest.fixture(scope="module")
def pair() -> Drive:
    return corridor(36, 64).picked(slice(0, 2))


H = np.array([[1.01, 0.02, 3.0], [-0.01, 0.98, -4.0], [6e-5, -4e-5, 1.0]])


def _through(u: float, v: float) -> tuple[float, float]:
    w = H @ np.array([u, v, 1.0])
    return float(w[0] / w[2]), float(w[1] / w[2])


def test_points_of_a_line_lie_after_the_homography_on_the_ray_that_the_truth_names(pair: Drive) -> None:
    before = pair.truth[0]
    after, meeting = mapped(before, H, pair.config, pair.config)
    cu, cv = center_of(before)
    for old, new in zip(before.bearing_rad[::7], after.bearing_rad[::7], strict=True):
        for radius in (60.0, 140.0, 220.0):
            u, v = _through(cu + radius * np.cos(old), cv - radius * np.sin(old))
            assert abs(wrap(np.arctan2(meeting[1] - v, u - meeting[0]) - new)) < 1e-12


def test_points_of_the_rim_lie_after_the_homography_on_an_ellipse_about_the_truths_centre(pair: Drive) -> None:
    before = pair.truth[0]
    after, _ = mapped(before, H, pair.config, pair.config)
    cu, cv = center_of(before)
    turn = np.linspace(0.0, TURN, 400, endpoint=False)
    rim = np.array([_through(cu + 225.0 * np.cos(t), cv - 225.0 * np.sin(t)) for t in turn], dtype=np.float32)
    fitted = cv2.fitEllipse(rim)[0]
    assert np.hypot(fitted[0] - center_of(after)[0], fitted[1] - center_of(after)[1]) < 1e-2


def test_a_leaning_camera_that_leans_back_sees_what_it_saw(pair: Drive) -> None:
    before = pair.pictures()[0]
    again = tilted(tilted(pair, 2.0), -2.0).pictures()[0]
    cu, cv = center_of(pair.truth[0])
    v, u = np.mgrid[: before.shape[0], : before.shape[1]]
    inside = np.abs(np.hypot(u - cu, v - cv) - 145.0) < 60.0
    assert np.median(np.abs(before[inside].astype(int) - again[inside])) <= 2


def test_two_mirrors_and_four_quarter_turns_are_nothing(pair: Drive) -> None:
    for again in (mirrored(mirrored(pair)), quarter_turned(quarter_turned(quarter_turned(quarter_turned(pair))))):
        for a, b, p, q in zip(pair.truth, again.truth, pair.pictures(), again.pictures(), strict=True):
            assert np.array_equal(p, q)
            # The sign that two mirrors leave is +1 again only for the bearing, not for the configuration.
            angle = image_angle(b.bearing_rad, again.config)
            assert np.max(np.abs(wrap(angle - image_angle(a.bearing_rad, pair.config)))) < 1e-12
            assert center_of(b) == pytest.approx(center_of(a), abs=1e-9)


def test_half_the_light_is_half_the_contrast(pair: Drive) -> None:
    for old, new in zip(pair.truth, gain(pair, 0.5).truth, strict=True):
        strong = Rules().strong(old)
        assert np.max(np.abs(new.contrast[strong] / old.contrast[strong] - 0.5)) < 0.1


def test_a_picture_covered_whole_shows_no_edge_and_uncovered_all(pair: Drive) -> None:
    picture, truth = pair.pictures()[0], pair.truth[0]
    none = np.zeros(picture.shape, dtype=np.bool_)
    assert np.array_equal(hidden(picture, truth, pair.config, none).visible_fraction, truth.visible_fraction)
    assert np.max(hidden(picture, truth, pair.config, ~none).visible_fraction) == 0.0
    same, left = covered(picture, truth, pair.config, none, picture)
    assert np.array_equal(same, picture)
    assert np.array_equal(left.neither_rad, truth.neither_rad)


def test_a_bar_hides_the_edges_behind_it_and_the_bar_behind_it(pair: Drive) -> None:
    picture, truth = pair.pictures()[0], pair.truth[0]
    behind, before = Bar(1.0, 0.03, 80.0, 200.0, 10.0), Bar(1.035, 0.03, 80.0, 200.0, 240.0)
    after, rest, edges = painted(picture, truth, pair.config, [behind, before])
    assert edges.bearing_rad == pytest.approx([0.97, 1.03, 1.005, 1.065])
    assert edges.visible_fraction[[0, 2, 3]] == pytest.approx(120.0 / 162.0, abs=0.03)
    assert edges.visible_fraction[1] == 0.0
    assert edges.contrast[2] > 150.0
    inside = np.abs(wrap(image_angle(truth.bearing_rad, pair.config) - 1.025)) < 0.05
    assert np.all(rest.visible_fraction[inside] <= truth.visible_fraction[inside])
    assert np.array_equal(rest.visible_fraction[~inside], truth.visible_fraction[~inside])
    assert np.all(steps(after, edges, pair.config)[0][2][20:50] > 100.0)


@pytest.mark.parametrize("name", ["raw", "gain 2.0", "tilted 3 deg", "third rate", "passing cover", "crossing"])
def test_who_says_the_truth_is_right_on_every_variant(name: str) -> None:
    drive, rules = VARIANTS[name](corridor(36, 64).picked(slice(0, 14))), Rules()
    seen = [Sighting(t.line_id[rules.visible(t)], t.bearing_rad[rules.visible(t)]) for t in drive.truth]
    judged = score(seen, drive.truth)
    assert judged is not None
    assert (judged.detection.recall, judged.detection.precision) == (1.0, 1.0)
    assert (judged.identity.correct_percent, judged.identity.repeatability, judged.identity.purity) == (100.0, 1.0, 1.0)
