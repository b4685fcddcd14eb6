"""The judge is judged: truth scores full marks, chance scores chance, and planted errors are counted one by one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.angles import TURN, wrap
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.score import Score, score
from omnivert.bench.score.truth import FrameTruth, Sighting

RULES = Rules()
FRAMES = 30
EDGES = 20  # 18 deg apart


def truth_at(frame: int, edges: int = EDGES) -> FrameTruth:
    """Strong edges, evenly round the circle, all turning by 5 deg a frame; one silhouette between the first two."""
    ids = np.arange(edges)
    bearing = wrap(np.deg2rad(360.0 / edges) * ids + np.deg2rad(5.0) * frame)
    silhouette = wrap(bearing[:1] + np.deg2rad(6.0))
    return FrameTruth(100 + ids, bearing, np.full(edges, 0.8), np.full(edges, 30.0), silhouette, (320.0, 240.0))


@pytest.fixture
def truths() -> list[FrameTruth]:
    return [truth_at(frame) for frame in range(FRAMES)]


@pytest.fixture
def perfect(truths: list[FrameTruth]) -> list[Sighting]:
    """Everything found where it is, under one identity each, with the sigma 1 mrad."""
    return [
        Sighting(truth.line_id.copy(), truth.bearing_rad.copy(), np.full(EDGES, 1e-3), truth.center_px)
        for truth in truths
    ]


def judged(sightings: list[Sighting], truths: list[FrameTruth]) -> Score:
    result = score(sightings, truths, RULES)
    assert result is not None
    return result


def without(sighting: Sighting, *rows: int) -> Sighting:
    kept = np.delete(np.arange(sighting.track_id.size), rows)
    std = None if sighting.std_rad is None else sighting.std_rad[kept]
    return replace(sighting, track_id=sighting.track_id[kept], bearing_rad=sighting.bearing_rad[kept], std_rad=std)


def renamed(sighting: Sighting, row: int, track: int) -> Sighting:
    track_id = sighting.track_id.copy()
    track_id[row] = track
    return replace(sighting, track_id=track_id)


def with_line(sighting: Sighting, track: int, bearing: float) -> Sighting:
    return replace(
        sighting,
        track_id=np.append(sighting.track_id, track),
        bearing_rad=np.append(sighting.bearing_rad, wrap(bearing)),
        std_rad=None if sighting.std_rad is None else np.append(sighting.std_rad, 1e-3),
    )


def test_the_truth_scores_a_hundred_percent(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    found = judged(perfect, truths)
    assert (found.detection.recall, found.detection.precision) == (1.0, 1.0)
    assert found.detection.correct_lines_per_frame == found.detection.lines_per_frame == EDGES
    assert found.identity.links == EDGES * (FRAMES - 1)
    assert found.identity.correct_percent == 100.0
    assert (found.identity.repeatability, found.identity.purity) == (1.0, 1.0)
    assert (found.sharpness.sigma_mrad, found.sharpness.ring_rms_px) == (0.0, 0.0)
    assert found.sharpness.residuals == EDGES * FRAMES
    assert found.frames == FRAMES


@pytest.mark.parametrize("seed", range(4))
def test_lines_strewn_at_random_have_the_precision_of_chance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = truth_at(0)
    strewn = Sighting(np.arange(20_000), rng.uniform(-np.pi, np.pi, 20_000))
    found = judged([strewn], [truth]).detection
    assert found.precision_chance == pytest.approx(EDGES * 1.4 / (360.0 - 1.4))
    assert found.precision == pytest.approx(found.precision_chance, abs=0.012)


def test_shuffled_identities_are_right_by_chance_only(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    rng = np.random.default_rng(1)
    found = judged([replace(s, track_id=rng.permutation(s.track_id)) for s in perfect], truths)
    assert found.detection.recall == 1.0
    assert found.identity.correct_percent == pytest.approx(100.0 / EDGES, abs=3.0)
    assert found.identity.purity < 0.25


@given(missed=st.sets(st.integers(0, EDGES - 1), max_size=EDGES))
def test_each_missed_line_costs_its_share_of_recall(missed: set[int]) -> None:
    truth = truth_at(0)
    sighting = Sighting(truth.line_id, truth.bearing_rad)
    found = judged([without(sighting, *missed)], [truth]).detection
    assert found.recall == pytest.approx(1.0 - len(missed) / EDGES)
    assert found.correct_lines_per_frame == EDGES - len(missed)


@given(clutter=st.integers(0, 15), silhouettes=st.integers(0, 3))
def test_clutter_is_wrong_and_a_silhouette_neither(clutter: int, silhouettes: int) -> None:
    truth = truth_at(0)
    sighting = Sighting(truth.line_id, truth.bearing_rad)
    for k in range(clutter):
        sighting = with_line(sighting, 1000 + k, np.deg2rad(9.0 + 18.0 * (k + 1)))
    for k in range(silhouettes):
        sighting = with_line(sighting, 2000 + k, float(truth.neither_rad[0]) + 0.001 * k)
    found = judged([sighting], [truth]).detection
    assert found.precision == pytest.approx(EDGES / (EDGES + clutter))
    assert found.lines_per_frame == EDGES + clutter + silhouettes


def test_many_detections_of_one_line_are_one_correct_line(truths: list[FrameTruth]) -> None:
    bearing = truths[0].bearing_rad[3] + np.linspace(-0.01, 0.01, 7)
    found = judged([Sighting(np.arange(7), bearing)], truths[:1]).detection
    assert found.correct_lines_per_frame == 1
    assert found.precision == 1.0
    assert found.recall == pytest.approx(1 / EDGES)


def test_nearly_coincident_edges_are_one_line(truths: list[FrameTruth]) -> None:
    pair = replace(truths[0], bearing_rad=truths[0].bearing_rad.copy())
    pair.bearing_rad[1] = wrap(pair.bearing_rad[0] + np.deg2rad(0.5))
    sighting = Sighting(np.array([1]), wrap(pair.bearing_rad[:1] - np.deg2rad(0.3)))
    assert judged([sighting], [pair]).detection.recall == pytest.approx(1 / (EDGES - 1))


def test_weak_edges_are_right_but_not_asked_for(truths: list[FrameTruth]) -> None:
    weak = replace(truths[0], visible_fraction=np.full(EDGES, 0.3), contrast=np.full(EDGES, 30.0))
    weak.visible_fraction[0] = 0.8
    sighting = Sighting(weak.line_id[:5], weak.bearing_rad[:5])
    found = judged([sighting], [weak]).detection
    assert (found.recall, found.precision, found.correct_lines_per_frame) == (1.0, 1.0, 5.0)


def test_an_edge_that_cannot_be_seen_is_no_edge(truths: list[FrameTruth]) -> None:
    hidden = replace(truths[0], visible_fraction=np.zeros(EDGES))
    found = judged([Sighting(hidden.line_id, hidden.bearing_rad)], [hidden]).detection
    assert (found.precision, found.correct_lines_per_frame, found.precision_chance) == (0.0, 0.0, 0.0)
    assert np.isnan(found.recall)


def test_a_swap_of_two_identities_is_two_false_links_there_and_two_back(
    perfect: list[Sighting], truths: list[FrameTruth]
) -> None:
    perfect[10] = renamed(renamed(perfect[10], 4, 111), 11, 104)
    found = judged(perfect, truths).identity
    assert found.links == EDGES * (FRAMES - 1)
    assert found.false_percent == pytest.approx(100.0 * 4 / found.links)
    assert found.false_new_percent == 0.0
    assert found.purity == pytest.approx(1.0 - 2 / (EDGES * FRAMES))


@settings(max_examples=20, deadline=None)
@given(planted=st.sets(st.integers(0, EDGES - 1), max_size=8), frame=st.integers(1, 29))
def test_each_new_name_for_a_line_in_sight_is_one_false_new(planted: set[int], frame: int) -> None:
    truths = [truth_at(k) for k in range(FRAMES)]
    sightings = [Sighting(t.line_id.copy(), t.bearing_rad) for t in truths]
    for k in range(frame, FRAMES):
        for row in planted:
            sightings[k].track_id[row] += 1000
    found = judged(sightings, truths).identity
    assert found.links == EDGES * (FRAMES - 1)
    assert found.false_new_percent == pytest.approx(100.0 * len(planted) / found.links)
    assert found.false_percent == 0.0


@pytest.mark.parametrize(("hidden", "false_new"), [(1, 1), (19, 1), (20, 0), (25, 0)])
def test_a_line_is_looked_back_for_over_20_frames(
    perfect: list[Sighting], truths: list[FrameTruth], hidden: int, false_new: int
) -> None:
    for k in range(2, FRAMES):
        perfect[k] = without(perfect[k], 7) if k < 2 + hidden else renamed(perfect[k], 7, 999)
    found = judged(perfect, truths).identity
    assert round(found.false_new_percent * found.links / 100.0) == false_new


def test_a_line_known_again_after_an_occlusion_is_a_correct_link(
    perfect: list[Sighting], truths: list[FrameTruth]
) -> None:
    for k in range(5, 12):
        perfect[k] = without(perfect[k], 7)
    found = judged(perfect, truths).identity
    assert found.correct_percent == 100.0
    assert found.links == EDGES * (FRAMES - 1) - 7


def test_a_second_detection_of_a_line_that_goes_on_is_not_falsely_new(
    perfect: list[Sighting], truths: list[FrameTruth]
) -> None:
    for k in range(10, FRAMES):
        perfect[k] = with_line(perfect[k], 777, float(truths[k].bearing_rad[3]) + np.deg2rad(0.4))
    assert judged(perfect, truths).identity.false_new_percent == 0.0


def test_a_link_from_clutter_is_not_judged(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    before = judged(perfect, truths).identity.links
    perfect[0] = without(perfect[0], 5)
    perfect[0] = with_line(perfect[0], 105, float(truths[0].bearing_rad[5]) + np.deg2rad(5.0))
    found = judged(perfect, truths).identity
    assert (found.links, found.correct_percent) == (before - 1, 100.0)


def test_what_flickers_does_not_repeat(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    flicker = [without(s, *range(k % 2, EDGES, 2)) for k, s in enumerate(perfect)]
    assert judged(flicker, truths).identity.repeatability == 0.0
    perfect[4] = without(perfect[4], 1, 2, 3)
    there = EDGES * (FRAMES - 1) - 3
    assert judged(perfect, truths).identity.repeatability == pytest.approx((there - 3) / there)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), sigma=st.floats(0.1e-3, 3e-3), claimed=st.floats(0.1e-3, 3e-3))
def test_residuals_have_the_sigma_that_was_put_in(seed: int, sigma: float, claimed: float) -> None:
    rng = np.random.default_rng(seed)
    truths = [truth_at(k) for k in range(FRAMES)]
    noisy = [
        Sighting(t.line_id, wrap(t.bearing_rad + rng.normal(0.0, sigma, EDGES)), np.full(EDGES, claimed))
        for t in truths
    ]
    found = judged(noisy, truths).sharpness
    assert found.sigma_mrad == pytest.approx(1e3 * sigma, rel=0.25)
    assert found.normalised_sigma == pytest.approx(sigma / claimed, rel=0.25)
    assert abs(found.bias_mrad) < 0.25e3 * sigma


def test_a_bias_is_said_and_does_not_hide_in_the_sigma(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    shifted = [replace(s, bearing_rad=wrap(s.bearing_rad + 2e-3)) for s in perfect]
    found = judged(shifted, truths).sharpness
    assert found.bias_mrad == pytest.approx(2.0)
    assert found.sigma_mrad == pytest.approx(0.0, abs=1e-9)


def test_lines_with_a_neighbour_are_not_isolated(truths: list[FrameTruth]) -> None:
    close = replace(truths[0], bearing_rad=truths[0].bearing_rad.copy())
    close.bearing_rad[1] = wrap(close.bearing_rad[0] + np.deg2rad(1.0))
    found = judged([Sighting(close.line_id, close.bearing_rad)], [close]).sharpness
    assert found.residuals == EDGES - 2


def test_without_claimed_sigmas_and_centres_there_is_no_figure_of_them(truths: list[FrameTruth]) -> None:
    found = judged([Sighting(t.line_id, t.bearing_rad) for t in truths], truths).sharpness
    assert (found.normalised_sigma, found.ring_rms_px) == (None, None)


def test_the_ring_is_off_by_its_distance(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    off = [replace(s, center_px=(320.3, 240.4)) for s in perfect]
    assert judged(off, truths).sharpness.ring_rms_px == pytest.approx(0.5)


def test_finding_nothing_is_no_crash(truths: list[FrameTruth]) -> None:
    none = Sighting(np.empty(0, dtype=np.int64), np.empty(0))
    found = judged([none] * FRAMES, truths)
    assert (found.detection.recall, found.identity.links) == (0.0, 0)
    assert len(found.words()) == 3
    assert max(map(len, found.words())) <= 100
    nothing = np.empty(0)
    bare = FrameTruth(np.empty(0, dtype=np.int64), nothing, nothing, nothing, nothing)
    assert np.isnan(judged([none], [bare]).detection.recall)


def test_frames_that_the_truth_does_not_know_are_not_judged(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    known: list[FrameTruth | None] = [truth if k < 7 else None for k, truth in enumerate(truths)]
    result = score(perfect, known, RULES)
    assert result is not None
    assert result.frames == 7
    assert score(perfect, [None] * FRAMES, RULES) is None


def test_all_figures_do_not_care_where_the_circle_is_cut(perfect: list[Sighting], truths: list[FrameTruth]) -> None:
    rng = np.random.default_rng(3)
    seen = [replace(s, bearing_rad=wrap(s.bearing_rad + rng.normal(0.0, 0.004, EDGES))) for s in perfect]
    turn = TURN / 7
    turned = [replace(s, bearing_rad=wrap(s.bearing_rad + turn)) for s in seen]
    world = [replace(t, bearing_rad=wrap(t.bearing_rad + turn), neither_rad=wrap(t.neither_rad + turn)) for t in truths]
    here, there = judged(seen, truths).json(), judged(turned, world).json()
    assert there == pytest.approx(here)
