"""How noisy wheels and bearings are, from what the solution leaves of them.

Residuals are smaller than the noise, because the solution follows it: of each kind their squares sum up to its
redundancy, the count of measurements less what the unknowns have taken from them (Helmert's variance components).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.solver.normal import Flags, bearing_slope, step_errors, step_slope
from omnivert.calibration.solver.problem import Index
from omnivert.calibration.solver.smoother import Search, Solution
from omnivert.compiled import compiled
from omnivert.messages import Correction

Array = NDArray[np.float64]

SIGNIFICANT = 4.0  # sigmas by which a noise must differ from the configured one before it replaces it
HARMLESS = float(np.log(1.1))  # of a variance: less than this changes nothing worth a word
LEAST = 60.0  # redundancy from which on a noise can be told at all
LARGEST = 100.0  # factor of variance that is believed


@dataclass(frozen=True, slots=True)
class Noise:
    """Variances as multiples of those told."""

    wheels: float = 1.0  # of K
    bearings: float = 1.0  # of the square of each sigma


@dataclass(frozen=True, slots=True)
class Component:
    """One kind of residuals."""

    squares: float  # sum, each by its variance
    redundancy: float

    @property
    def ratio(self) -> float:
        """Variance found / variance used."""
        return self.squares / max(self.redundancy, 1e-9)

    @property
    def std(self) -> float:
        """Of the ratio's logarithm."""
        return float(np.sqrt(2.0 / max(self.redundancy, 1e-9)))


def components(search: Search, solution: Solution) -> tuple[Component, Component]:
    """Of the wheels' increments and of the bearings, at a solution."""
    problem, x = search.problem, solution.x
    layout, weight = solution.normal.layout, solution.weight
    moved = problem.increments(x.corrections)
    z = search.bearing_errors(x) / problem.std
    step = step_errors(x.pose, moved.step)
    information = search.information
    taken_steps, taken_bearings = _taken(
        layout.pose,
        layout.line,
        layout.shared,
        layout.first,
        layout.start,
        solution.spans,
        problem.frame,
        problem.line,
        x.pose,
        x.shared,
        x.anchor,
        x.u,
        x.w,
        weight / problem.std**2,
        moved.slope,
        information,
        problem.prior.free,
        problem.broken,
    )
    known = ~problem.broken
    squares = np.einsum("ni,nij,nj->n", step, information, step)[known].sum()
    return (
        Component(float(squares), 3.0 * float(known.sum()) - taken_steps),
        Component(float(np.sum(weight * z**2)), float(weight.sum()) - taken_bearings),
    )


def updated(before: Noise, wheels: Component, bearings: Component) -> Noise:
    """The noise to go on with: what is configured, unless the residuals say clearly that it is another."""

    def one(used: float, found: Component) -> float:
        if found.redundancy < LEAST:
            return used
        value = used * found.ratio
        if abs(np.log(max(value, 1e-9))) <= max(SIGNIFICANT * found.std, HARMLESS):
            return 1.0
        return float(np.clip(value, 1.0 / LARGEST, LARGEST))

    # Part of a bearing's error is the line's own and stays from frame to frame, where residuals do not show it: so no
    # bearing is believed better than it is told.
    return Noise(one(before.wheels, wheels), max(1.0, one(before.bearings, bearings)))


def told(noise: Noise, used: tuple[Component, Component], k: float) -> tuple[Correction, ...]:
    """For people: K (m), and the bearings' sigmas as a multiple of those that came with them."""
    told = []
    for name, value, component, factor in (
        ("noise_k", k * noise.wheels, used[0], noise.wheels),
        ("bearing_noise", float(np.sqrt(noise.bearings)), used[1], 0.5 * noise.bearings),
    ):
        freed = factor not in (1.0, 0.5)
        few = f"held: {component.redundancy:.0f} spare measurements are too few to tell"
        agree = f"held: the residuals agree with it, {component.ratio:.2f} times the variance"
        reason = "" if freed else few if component.redundancy < LEAST else agree
        told.append(Correction(name, value, min(value * component.std, 1e6), freed, reason))
    return tuple(told)


@compiled
def _taken(
    at_pose: Index,
    at_line: Index,
    at_shared: int,
    first: Index,
    start: Index,
    covariance: Array,
    frame: Index,
    line: Index,
    pose: Array,
    shared: Array,
    anchor: Array,
    u: Array,
    w: Array,
    weight: Array,
    by_corrections: Array,
    information: Array,
    free: Flags,
    broken: NDArray[np.bool_],
) -> tuple[float, float]:
    """How many measurements' worth the unknowns have taken from the increments, and from the bearings."""
    row, slope = np.empty(8, dtype=np.int64), np.empty(8)
    bearings = 0.0
    for m in range(weight.size):
        f, k = frame[m], line[m]
        bearing_slope(pose[f], shared, anchor[k], u[k], w[k], at_pose[f], at_line[k], at_shared, row, slope)
        begin = 0 if f else 3
        variance = 0.0
        for i in range(begin, 8):
            if i >= 5 and not free[i - 5]:
                continue
            base = start[row[i]] - first[row[i]]
            for j in range(begin, i + 1):
                if j >= 5 and not free[j - 5]:
                    continue
                twice = 1.0 if i == j else 2.0
                variance += twice * slope[i] * slope[j] * covariance[base + row[j]]
        bearings += weight[m] * variance
    rows, slopes = np.empty(9, dtype=np.int64), np.empty((3, 9))
    steps = 0.0
    for n in range(broken.size):
        if broken[n]:
            continue
        step_slope(pose[n], pose[n + 1], by_corrections[n], free, at_pose[n], at_pose[n + 1], at_shared, rows, slopes)
        begin = 0 if n else 3
        for i in range(begin, 9):
            base = start[rows[i]] - first[rows[i]]
            for j in range(begin, i + 1):
                heavy = 0.0
                for k in range(3):
                    for p in range(3):
                        heavy += slopes[k, i] * information[n, k, p] * slopes[p, j]
                steps += (1.0 if i == j else 2.0) * heavy * covariance[base + rows[j]]
    return steps, bearings
