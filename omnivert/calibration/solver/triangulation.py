"""Where a line stands, from sights of it at known poses; wrong sights among them do no harm."""

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.solver.problem import Index, Problem
from omnivert.compiled import compiled

Array = NDArray[np.float64]

APART = np.array([1.0, 0.66, 0.5, 0.33, 0.2])  # how far the two rays of a hypothesis are apart, as a share of all
STARTS = 5  # hypotheses for each of these
LIMIT = 9.0  # a squared error in sigmas counts at most this much


@compiled
def line_from_sights(eye: Array, direction: Array, std: Array, anchor: Array) -> tuple[float, float, float]:
    """The two-ray hypothesis that the other rays like best.

    eye        (N, 2)  m    camera
    direction  (N, 2)       of the sight, world; unit length
    std        (N,)    rad
    anchor     (2,)    m
    returns    direction u from the anchor, inverse distance w, sum of limited squared errors
    """
    count = direction.shape[0]
    best_x, best_y, best_w, best_score = direction[count // 2, 0], direction[count // 2, 1], 0.0, np.inf
    for kind in range(APART.size + 1):
        gap = 0 if kind == APART.size else max(1, int(np.round(APART[kind] * (count - 1))))
        for n in range(STARTS):
            first = int(np.round(n * (count - 1 - gap) / (STARTS - 1)))
            if first < 0 or (n > 0 and first == int(np.round((n - 1) * (count - 1 - gap) / (STARTS - 1)))):
                continue
            a = first
            if gap == 0:  # a line at infinity
                x, y, w = direction[a, 0], direction[a, 1], 0.0
            else:
                b = first + gap
                # n . ((cos u, sin u) + w (anchor - eye)) = 0 is linear in (cos u, sin u, w): two rays cross in a
                # vector product.
                ax, ay, bx, by = -direction[a, 1], direction[a, 0], -direction[b, 1], direction[b, 0]
                az = ax * (anchor[0] - eye[a, 0]) + ay * (anchor[1] - eye[a, 1])
                bz = bx * (anchor[0] - eye[b, 0]) + by * (anchor[1] - eye[b, 1])
                x, y, w = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                length = np.hypot(x, y)
                if length < 1e-12:
                    continue
                if w < 0.0:
                    length = -length
                x, y, w = x / length, y / length, w / length
                if w >= 5.0:
                    continue
            score = 0.0
            for k in range(count):
                sx, sy = x + w * (anchor[0] - eye[k, 0]), y + w * (anchor[1] - eye[k, 1])
                cross = sx * direction[k, 1] - sy * direction[k, 0]
                along = sx * direction[k, 0] + sy * direction[k, 1]
                square = LIMIT
                if along > 0.0:  # the angle's tangent is near enough where it counts
                    square = min(LIMIT, (cross / (along * std[k])) ** 2)
                score += square
                if score >= best_score:
                    break
            if score < best_score:
                best_x, best_y, best_w, best_score = x, y, w, score
    return float(np.arctan2(best_y, best_x)), float(best_w), float(best_score)


@compiled
def _triangulated(
    order: Index,
    bounds: Index,
    frame: Index,
    beta: Array,
    pose: Array,
    mount: Array,
    std: Array,
    anchor: Array,
    u: Array,
    w: Array,
    which: Index,
) -> None:
    eta, cx, cy = mount[0], mount[1], mount[2]
    for n in range(which.size):
        j = which[n]
        count = bounds[j + 1] - bounds[j]
        if count == 0:
            continue
        eye, direction, own = np.empty((count, 2)), np.empty((count, 2)), np.empty(count)
        for k in range(count):
            m = order[bounds[j] + k]
            x, y, heading = pose[frame[m], 0], pose[frame[m], 1], pose[frame[m], 2]
            c, s = np.cos(heading), np.sin(heading)
            eye[k, 0], eye[k, 1] = x + c * cx - s * cy, y + s * cx + c * cy
            direction[k, 0], direction[k, 1] = np.cos(beta[m] + heading + eta), np.sin(beta[m] + heading + eta)
            own[k] = std[m]
        u[j], w[j], _ = line_from_sights(eye, direction, own, anchor[j])


def triangulated(
    problem: Problem, pose: Array, mount: Array, std: Array, anchor: Array, u: Array, w: Array, which: Index
) -> tuple[Array, Array]:
    """u and w with the lines of `which` placed anew from all their sights."""
    order, bounds = sights_by_line(problem, u.size)
    u, w = u.copy(), w.copy()
    _triangulated(order, bounds, problem.frame, problem.beta, pose, mount, std, anchor, u, w, which)
    return u, w


def anchors(problem: Problem, pose: Array) -> Array:
    """For each line the robot's place halfway through its sights, (L, 2) m."""
    order, bounds = sights_by_line(problem, problem.lines)
    middle = order[np.minimum((bounds[:-1] + bounds[1:]) // 2, order.size - 1)]
    return pose[problem.frame[middle], :2].copy()


def sights_by_line(problem: Problem, lines: int) -> tuple[Index, Index]:
    """The bearings in the order of their lines (M,), and where each line's begin (L + 1,)."""
    order = np.argsort(problem.line, kind="stable")
    return order, np.searchsorted(problem.line[order], np.arange(lines + 1))
