"""Are the lines there that should be, and is what was found really there?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnivert.bench.score.circle import apart, clusters, covered, nearest
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.truth import FrameTruth, Int, Mask, Sighting

Pair = tuple[Sighting, FrameTruth]


@dataclass(frozen=True, slots=True)
class Detection:
    """Figures of detection over some frames; nan where there is nothing to judge.

    recall                   share of strong lines (edges clustered within 0.7 deg) with a detection within 0.7 deg of
                             one of their edges
    precision                share of detections within 0.7 deg of a visible edge; those that are not, but lie as near
                             to a silhouette or a moving thing, are neither right nor wrong and left out
    precision_chance         the precision of detections strewn evenly over the circle
    correct_lines_per_frame  different visible lines (clustered as above) that a detection is nearest to, mean
    lines_per_frame          detections, mean
    """

    recall: float
    precision: float
    precision_chance: float
    correct_lines_per_frame: float
    lines_per_frame: float


def detection(pairs: Sequence[Pair], rules: Rules) -> Detection:
    """The figures over all frames."""
    strong = found = right = wrong = correct = lines = 0
    chance = []
    for sighting, truth in pairs:
        is_strong, is_visible = rules.strong(truth), rules.visible(truth)
        hit = found_clusters(sighting, truth, is_strong, rules)
        strong, found = strong + hit.size, found + int(np.sum(hit))
        edges = truth.bearing_rad[is_visible]
        is_right = nearest(sighting.bearing_rad, edges) <= rules.tolerance_rad
        is_neither = ~is_right & (nearest(sighting.bearing_rad, truth.neither_rad) <= rules.tolerance_rad)
        right, wrong = right + int(np.sum(is_right)), wrong + int(np.sum(~is_right & ~is_neither))
        correct += _distinct(sighting, truth, is_visible, is_right, rules)
        lines += sighting.bearing_rad.size
        at_edge = covered(edges, rules.tolerance_rad)
        at_either = covered(np.concatenate((edges, truth.neither_rad)), rules.tolerance_rad)
        chance.append((at_edge, 1.0 - (at_either - at_edge)))
    covered_share, judged_share = np.sum(chance, axis=0) if chance else (0.0, 0.0)
    return Detection(
        recall=ratio(found, strong),
        precision=ratio(right, right + wrong),
        precision_chance=ratio(covered_share, judged_share),
        correct_lines_per_frame=ratio(correct, len(pairs)),
        lines_per_frame=ratio(lines, len(pairs)),
    )


def found_clusters(sighting: Sighting, truth: FrameTruth, chosen: Mask, rules: Rules, label: Int | None = None) -> Mask:
    """(C,) whether each line, a cluster of the chosen edges, was found.

    label  (chosen edges,)  clusters to judge by, instead of those at this frame
    """
    edges = truth.bearing_rad[chosen]
    label = clusters(edges, rules.cluster_rad) if label is None else label
    hit = np.zeros(int(label.max(initial=-1)) + 1, dtype=np.bool_)
    hit[label[nearest(edges, sighting.bearing_rad) <= rules.tolerance_rad]] = True
    return hit


def _distinct(sighting: Sighting, truth: FrameTruth, visible: Mask, right: Mask, rules: Rules) -> int:
    if not np.any(right):
        return 0
    edges = truth.bearing_rad[visible]
    label = clusters(edges, rules.cluster_rad)
    return int(np.unique(label[np.argmin(apart(sighting.bearing_rad[right], edges), axis=1)]).size)


def ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else float("nan")
