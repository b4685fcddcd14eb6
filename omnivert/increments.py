"""The wheels' way between keyframes, at the encoders' own rate, and how it depends on what they really measure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SPEED_S = 0.025  # half the time over which a speed is taken


@dataclass(frozen=True, slots=True, eq=False)
class Wheels:
    """What the encoders have told."""

    time_s: Array  # (S,)
    right_m: Array  # (S,) cumulative
    left_m: Array  # (S,)
    base_m: float  # as configured
    noise_k_m: float  # K of eq. 31
    tick_m: float  # one count


@dataclass(frozen=True, slots=True, eq=False)
class Increments:
    """From keyframe to keyframe, seen from the earlier one."""

    step: Array  # (F-1, 3) m, m, rad
    covariance: Array  # (F-1, 3, 3)
    slope: Array  # (F-1, 3, 3) of the step by time offset (s), wheel ratio - 1, base / configured - 1
    wheels_m: Array  # (F-1, 2) right, left, as the encoders tell


def increments(wheels: Wheels, stamp_s: Array, broken: Flags, corrections: Array) -> Increments:
    """The way between the stamps (eqs. 14, 15), with a variance of K per metre of each wheel (eq. 31).

    stamp_s      (F,)    of the keyframes, as the camera tells; the picture was taken `corrections[0]` earlier
    broken       (F-1,)  the way is unknown: the step is nothing
    corrections  (3,)    time offset (s), wheel ratio right : left - 1, base / configured - 1
    """
    step, covariance, slope, told = _increments(
        wheels.time_s,
        wheels.right_m,
        wheels.left_m,
        stamp_s,
        broken,
        corrections,
        wheels.base_m,
        wheels.noise_k_m,
        wheels.tick_m,
    )
    return Increments(step, covariance, slope, told)


@compiled
def _at(time: Array, way: Array, t: float, k: int) -> float:
    """The way at t, on the line through samples k and k + 1."""
    return float(way[k] + (way[k + 1] - way[k]) * (t - time[k]) / (time[k + 1] - time[k]))


@compiled
def _sample(time: Array, t: float) -> int:
    """The last sample at or before t that has one behind it; the first or the last pair beyond the ends."""
    low, high = 0, time.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if time[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@compiled
def _speeds(time: Array, right: Array, left: Array, t: float) -> tuple[float, float]:
    a, b = t - SPEED_S, t + SPEED_S
    i, j = _sample(time, a), _sample(time, b)
    scale = 0.5 / SPEED_S
    return (
        (_at(time, right, b, j) - _at(time, right, a, i)) * scale,
        (_at(time, left, b, j) - _at(time, left, a, i)) * scale,
    )


@compiled
def _increments(
    time: Array,
    right: Array,
    left: Array,
    stamp: Array,
    broken: Flags,
    corrections: Array,
    base: float,
    noise: float,
    tick: float,
) -> tuple[Array, Array, Array, Array]:
    count = stamp.size - 1
    step = np.zeros((count, 3))
    covariance = np.zeros((count, 3, 3))
    slope = np.zeros((count, 3, 3))
    told = np.zeros((count, 2))
    by_end = np.zeros((3, 2))  # of the end, summed over the arcs: what a rounded count does
    by_wheel = np.zeros((3, 2))
    carried = np.zeros((3, 3))
    scale_r, scale_l = 1.0 + 0.5 * corrections[1], 1.0 - 0.5 * corrections[1]
    e = base * (1.0 + corrections[2])
    for f in range(count):
        if broken[f]:
            continue
        t, end = stamp[f] - corrections[0], stamp[f + 1] - corrections[0]
        k = _sample(time, t)
        at_r, at_l = _at(time, right, t, k), _at(time, left, t, k)
        began_r, began_l = at_r, at_l
        x, y, h, arcs = 0.0, 0.0, 0.0, 0
        p, d = covariance[f], slope[f]
        by_end[:] = 0.0
        while t < end:
            last = k + 2 >= time.size or time[k + 1] >= end
            t_next = end if last else time[k + 1]
            r_next, l_next = _at(time, right, t_next, k), _at(time, left, t_next, k)
            dr, dl = (r_next - at_r) * scale_r, (l_next - at_l) * scale_l
            way, turn = 0.5 * (dr + dl), (dr - dl) / e
            c, s = np.cos(h + 0.5 * turn), np.sin(h + 0.5 * turn)
            half = 0.5 * turn
            chord = way * (np.sin(half) / half if abs(half) > 1e-8 else 1.0)
            dx, dy = chord * c, chord * s
            # d end / d (right, left): along the chord, and by the turn.
            for side in range(2):
                sign = 1.0 if side == 0 else -1.0
                by_wheel[0, side] = 0.5 * c - 0.5 * dy * sign / e
                by_wheel[1, side] = 0.5 * s + 0.5 * dx * sign / e
                by_wheel[2, side] = sign / e
            # What was off in heading turns the arc that follows: F = [[1, 0, -dy], [0, 1, dx], [0, 0, 1]].
            for i in range(3):
                for j in range(3):
                    carried[i, j] = p[i, j]
            for j in range(3):
                carried[0, j] -= dy * p[2, j]
                carried[1, j] += dx * p[2, j]
            for i in range(3):
                p[i, 0] = carried[i, 0] - dy * carried[i, 2]
                p[i, 1] = carried[i, 1] + dx * carried[i, 2]
                p[i, 2] = carried[i, 2]
            q_r, q_l = noise * abs(r_next - at_r), noise * abs(l_next - at_l)
            for i in range(3):
                for j in range(3):
                    p[i, j] += by_wheel[i, 0] * q_r * by_wheel[j, 0] + by_wheel[i, 1] * q_l * by_wheel[j, 1]
            for m in range(2):
                by_end[0, m] += by_wheel[0, m] - dy * by_end[2, m]
                by_end[1, m] += by_wheel[1, m] + dx * by_end[2, m]
                by_end[2, m] += by_wheel[2, m]
            d[0, 1] += 0.5 * (by_wheel[0, 0] * (r_next - at_r) - by_wheel[0, 1] * (l_next - at_l)) - dy * d[2, 1]
            d[1, 1] += 0.5 * (by_wheel[1, 0] * (r_next - at_r) - by_wheel[1, 1] * (l_next - at_l)) + dx * d[2, 1]
            d[2, 1] += 0.5 * (by_wheel[2, 0] * (r_next - at_r) - by_wheel[2, 1] * (l_next - at_l))
            less = turn / (1.0 + corrections[2])
            d[0, 2] += 0.5 * dy * less - dy * d[2, 2]
            d[1, 2] += -0.5 * dx * less + dx * d[2, 2]
            d[2, 2] -= less
            x, y, h = x + dx, y + dy, h + turn
            at_r, at_l, t = r_next, l_next, t_next
            arcs += 1
            if not last:
                k += 1
        step[f, 0], step[f, 1], step[f, 2] = x, y, h
        told[f, 0], told[f, 1] = at_r - began_r, at_l - began_l
        rounding = tick * tick / 6.0 / max(arcs * arcs, 1)  # both ends, each uniform over a count
        for i in range(3):
            for j in range(3):
                p[i, j] += rounding * (by_end[i, 0] * by_end[j, 0] + by_end[i, 1] * by_end[j, 1])
        # A later look at the same wheels: the start and the end of the way move on at their speeds.
        r0, l0 = _speeds(time, right, left, stamp[f] - corrections[0])
        r1, l1 = _speeds(time, right, left, end)
        v0, w0 = 0.5 * (r0 * scale_r + l0 * scale_l), (r0 * scale_r - l0 * scale_l) / e
        v1, w1 = 0.5 * (r1 * scale_r + l1 * scale_l), (r1 * scale_r - l1 * scale_l) / e
        d[0, 0] = -(v1 * np.cos(h) - v0 + w0 * y)
        d[1, 0] = -(v1 * np.sin(h) - w0 * x)
        d[2, 0] = -(w1 - w0)
    return step, covariance, slope, told
