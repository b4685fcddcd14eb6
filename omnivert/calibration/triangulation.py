"""Where a line stands, from sights of it at known poses; wrong sights among them do no harm."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.problem import Index, Problem

Array = NDArray[np.float64]

PAIRS = 24  # two-ray hypotheses a line
LIMIT = 9.0  # a squared error in sigmas counts at most this much


def camera_sights(problem: Problem, pose: Array, mount: Array) -> tuple[Array, Array]:
    """World position of the camera (M, 2) and world direction of the sight (M,) of every bearing."""
    eta, cx, cy = mount
    at = pose[problem.frame]
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    eye = at[:, :2] + np.stack([c * cx - s * cy, s * cx + c * cy], axis=1)
    return eye, problem.beta + at[:, 2] + eta


def line_from_sights(eye: Array, direction: Array, std: Array, anchor: Array) -> tuple[float, float, float]:
    """The two-ray hypothesis that the other rays like best.

    eye        (N, 2)  m    camera
    direction  (N,)    rad  of the sight, world
    std        (N,)    rad
    anchor     (2,)    m
    returns    direction u from the anchor, inverse distance w, sum of limited squared errors
    """
    across = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
    # n . ((cos u, sin u) + w (anchor - eye)) = 0 is linear in (cos u, sin u, w): two rays cross in a vector product.
    plane = np.column_stack([across, np.einsum("ni,ni->n", across, anchor - eye)])
    first, second = _pairs(direction.size)
    a, b = plane[first].T, plane[second].T
    crossing = np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], axis=1)
    length = np.hypot(crossing[:, 0], crossing[:, 1])
    crossing = crossing[length > 1e-12] / length[length > 1e-12, None]
    middle = direction.size // 2
    far = np.array([[np.cos(direction[k]), np.sin(direction[k]), 0.0] for k in (0, middle, direction.size - 1)])
    guess = np.concatenate([crossing, -crossing, far])
    guess = guess[(guess[:, 2] >= 0.0) & (guess[:, 2] < 5.0)]
    back = anchor - eye
    sight_x = guess[:, :1] + guess[:, 2:] * back[:, 0]
    sight_y = guess[:, 1:2] + guess[:, 2:] * back[:, 1]
    error = wrap(np.arctan2(sight_y, sight_x) - direction)
    score = np.minimum((error / std) ** 2, LIMIT).sum(axis=1)
    best = int(np.argmin(score))
    return float(np.arctan2(guess[best, 1], guess[best, 0])), float(guess[best, 2]), float(score[best])


def triangulated(
    problem: Problem, pose: Array, mount: Array, std: Array, anchor: Array, u: Array, w: Array, which: Index
) -> tuple[Array, Array]:
    """u and w with the lines of `which` placed anew from all their sights."""
    eye, direction = camera_sights(problem, pose, mount)
    order = np.argsort(problem.line, kind="stable")
    bounds = np.searchsorted(problem.line[order], np.arange(u.size + 1))
    u, w = u.copy(), w.copy()
    for j in which.tolist():
        own = order[bounds[j] : bounds[j + 1]]
        if own.size:
            u[j], w[j], _ = line_from_sights(eye[own], direction[own], std[own], anchor[j])
    return u, w


def anchors(problem: Problem, pose: Array) -> Array:
    """For each line the robot's place halfway through its sights, (L, 2) m."""
    order = np.argsort(problem.line, kind="stable")
    bounds = np.searchsorted(problem.line[order], np.arange(problem.lines + 1))
    middle = order[np.minimum((bounds[:-1] + bounds[1:]) // 2, order.size - 1)]
    return pose[problem.frame[middle], :2].copy()


@lru_cache(maxsize=4096)
def _pairs(count: int) -> tuple[Index, Index]:
    """Pairs of different sights, wide ones first; the same for the same count."""
    first, second = [], []
    for apart in (1.0, 0.66, 0.5, 0.33, 0.2):
        gap = max(1, round(apart * (count - 1)))
        starts = np.unique(np.linspace(0, count - 1 - gap, 5).round().astype(np.int64)) if count > gap else ()
        for k in starts:
            first.append(int(k))
            second.append(int(k) + gap)
    return np.array(first[:PAIRS], dtype=np.int64), np.array(second[:PAIRS], dtype=np.int64)
