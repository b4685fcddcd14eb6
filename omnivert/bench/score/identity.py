"""Do identities stay with their lines? Links judged as in the paper's Table III (IX-A), but against a truth."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnivert.bench.score.circle import apart, clusters
from omnivert.bench.score.detection import Pair, found_clusters, ratio
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.truth import FrameTruth, Sighting

Edges = frozenset[int]


@dataclass(frozen=True, slots=True)
class Identity:
    """Figures of identity over consecutive frames; percentages of the three kinds of links together.

    A detection is of every visible edge within 0.7 deg. One of a track that was seen before is a link to its last
    sighting.

    correct_percent    links to a detection of the same edge
    false_percent      links to a detection of another edge
    false_new_percent  detections whose track is new although the edge was detected in the last 20 frames, under
                       another identity that no other detection of the edge carries on
    links              all three together; new tracks on edges not seen lately are no links, and links from what was
                       no true edge (a shadow, a silhouette) cannot be judged
    repeatability      share of the lines strong in both of two consecutive frames and found in the first that are
                       found in the second, too
    purity             share of the sightings of tracks that are of the edge that the track was mostly on, a detection
                       being of the nearest edge and those at most 0.3 deg farther off: falls when an identity creeps
                       from line to line while they cross, which no single link shows
    """

    links: int
    correct_percent: float
    false_percent: float
    false_new_percent: float
    repeatability: float
    purity: float


def identity(pairs: Sequence[Pair], rules: Rules) -> Identity:
    """The figures over all frames, which follow each other."""
    correct, false, false_new = _links(pairs, rules)
    links = correct + false + false_new
    return Identity(
        links=links,
        correct_percent=100.0 * ratio(correct, links),
        false_percent=100.0 * ratio(false, links),
        false_new_percent=100.0 * ratio(false_new, links),
        repeatability=_repeatability(pairs, rules),
        purity=_purity(pairs, rules),
    )


def _edges_of(sighting: Sighting, truth: FrameTruth, rules: Rules) -> list[tuple[Edges, Edges]]:
    """For each detection the visible edges that it is of, and with them the edges that it may be of, seen or not."""
    near = apart(sighting.bearing_rad, truth.bearing_rad) <= rules.tolerance_rad
    visible = rules.visible(truth)
    return [(frozenset(truth.line_id[row & visible].tolist()), frozenset(truth.line_id[row].tolist())) for row in near]


def _nearest_edges(sighting: Sighting, truth: FrameTruth, rules: Rules) -> list[list[int]]:
    """For each detection the visible edge that it is nearest to, and those hardly farther off."""
    visible = rules.visible(truth)
    distance = apart(sighting.bearing_rad, truth.bearing_rad[visible])
    reach = np.minimum(np.min(distance, axis=1, initial=np.inf) + rules.same_edge_rad, rules.tolerance_rad)
    return [truth.line_id[visible][row].tolist() for row in distance <= reach[:, None]]


def _links(pairs: Sequence[Pair], rules: Rules) -> tuple[int, int, int]:
    """Correct and false links, and false new tracks."""
    correct = false = false_new = 0
    last: dict[int, Edges] = {}  # track -> what it may have been of when it was seen last
    carried: defaultdict[int, dict[int, int]] = defaultdict(dict)  # edge -> track -> frame of its last sighting there
    for frame, (sighting, truth) in enumerate(pairs):
        seen = list(zip(sighting.track_id.tolist(), _edges_of(sighting, truth, rules), strict=True))
        on = {edge for track, (edges, _) in seen for edge in edges if track in carried[edge]}  # carried on from before
        for track, (edges, _) in seen:
            if not edges:
                continue
            if track not in last:
                lost = edges - on
                false_new += any(frame - k <= rules.lookback_frames for e in lost for k in carried[e].values())
            elif last[track]:
                same = not edges.isdisjoint(last[track])
                correct, false = correct + same, false + (not same)
        for track, (edges, perhaps) in seen:
            last[track] = perhaps
            for edge in edges:
                carried[edge][track] = frame
    return correct, false, false_new


def _repeatability(pairs: Sequence[Pair], rules: Rules) -> float:
    before = again = 0
    for (old, old_truth), (new, new_truth) in pairwise(pairs):
        both = np.intersect1d(
            old_truth.line_id[rules.strong(old_truth)], new_truth.line_id[rules.strong(new_truth)], assume_unique=True
        )
        _, _, i = np.intersect1d(both, old_truth.line_id, assume_unique=True, return_indices=True)
        _, _, j = np.intersect1d(both, new_truth.line_id, assume_unique=True, return_indices=True)
        label = clusters(old_truth.bearing_rad[i], rules.cluster_rad)
        first = found_clusters(old, _part(old_truth, i), np.ones(i.size, dtype=np.bool_), rules, label)
        second = found_clusters(new, _part(new_truth, j), np.ones(j.size, dtype=np.bool_), rules, label)
        before, again = before + int(np.sum(first)), again + int(np.sum(first & second))
    return ratio(again, before)


def _purity(pairs: Sequence[Pair], rules: Rules) -> float:
    sightings: Counter[int] = Counter()
    on_edge: defaultdict[int, Counter[int]] = defaultdict(Counter)
    for sighting, truth in pairs:
        for track, edges in zip(sighting.track_id.tolist(), _nearest_edges(sighting, truth, rules), strict=True):
            if edges:
                sightings[track] += 1
                on_edge[track].update(edges)
    return ratio(sum(max(edges.values()) for edges in on_edge.values()), sum(sightings.values()))


def _part(truth: FrameTruth, rows: NDArray[np.intp]) -> FrameTruth:
    return FrameTruth(
        truth.line_id[rows],
        truth.bearing_rad[rows],
        truth.visible_fraction[rows],
        truth.contrast[rows],
        truth.neither_rad,
        truth.center_px,
    )
