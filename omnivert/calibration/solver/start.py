"""The start that needs no guess.

With the sum eta = phi + psi held, every sight says that line, camera and direction are collinear, which is linear in
the lines' and the camera's position. So: one linear least squares for each eta on a circle, angular errors as score;
then Gauss-Newton on everything from the best few, with bearing sigmas that shrink; then a look at how clearly the best
one wins. Paper: start from hand measurement. Here: this, because the filter diverges unless D is known to about 10 %.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.problem import GLOBALS, Index, Problem, dead_reckoned, with_lines
from omnivert.calibration.solver.smoother import Search, Solution
from omnivert.calibration.solver.triangulation import anchors, triangulated
from omnivert.compiled import compiled
from omnivert.increments import Increments

Array = NDArray[np.float64]

ETAS = 60  # on the circle
FINALISTS = 3  # of the starts, that are annealed to the end
ROUGH = 0.1  # rad: what dead reckoning may be off by
STAGES = (0.3, 0.15, 0.08, 0.04, 0.02, 0.01, 0.005)  # rad, the annealing
LINEAR_ROUNDS = 5
DOUBTS = (1.0, 3.0)  # times K, where the wheels are in doubt: after how long a turn dead reckoning is lost
PLACES = (None, np.zeros(2))  # there: the camera anywhere, or at first on the axis, which keeps it out of many valleys


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    solution: Solution
    gap: float  # -2 log likelihood by which the next best, different solution is worse; inf when there is none


def started(
    problem: Problem,
    max_rho: float,
    starts: int,
    lines: int,
    place: Array | None = None,
    finalists: int = FINALISTS,
) -> Start | None:
    """The best mount for a whole stretch, from nothing; None when no start leads anywhere.

    starts     values of eta that are followed up
    lines      at most this many for the rough part, those seen most often
    place      (2,)  m, where the camera is held on the robot; None: anywhere
    finalists  of the starts, that are annealed to the end
    """
    if place is not None:
        free = problem.prior.free & ~np.isin(np.arange(GLOBALS), (1, 2))
        problem = replace(problem, prior=replace(problem.prior, free=free))
    corrections = problem.held
    moved = problem.increments(corrections)
    pose = dead_reckoned(moved.step)
    rough = _split(problem, _stretches(moved))
    count = np.bincount(rough.line, minlength=rough.lines) if rough.line.size else np.zeros(0)
    often = np.sort(np.argsort(-count, kind="stable")[:lines])
    rough = with_lines(rough, often[count[often] >= 3])
    if rough.frames < 3 or rough.beta.size < 6:
        return None
    half = len(STAGES) // 2
    search = Search(rough)
    warm = [
        search.annealed(unknowns(rough, pose, np.concatenate([mount, corrections])), STAGES[:half], 4, STAGES[half])
        for mount in candidates(rough, pose, max_rho, starts, place)
    ]
    warm.sort(key=lambda s: s.score)
    found = [search.annealed(s.x, STAGES[half:], 4) for s in warm[:finalists]]
    found = [s for s in found if float(np.hypot(*s.x.mount[1:])) <= 1.5 * max_rho]
    if not found:
        return None
    found.sort(key=lambda s: s.score)
    best = found[0]
    try:
        information = best.mount_information
    except ArithmeticError:
        return None
    gap = float("inf")
    for other in found[1:]:
        off = other.x.mount - best.x.mount
        off[0] = wrap(float(off[0]))
        if float(off @ information @ off) > 16.0:
            gap = min(gap, other.score - best.score)
    whole = Search(problem)
    return Start(whole.annealed(unknowns(problem, best.x.pose, best.x.shared), STAGES[-3:], 4), gap)


def started_wide(problem: Problem, corrections: Array, max_rho: float, starts: int, lines: int) -> Start | None:
    """The same where wheels or clocks are not what is configured: from other corrections, with more starts.

    corrections  (3,) to start from; those that the problem frees are then solved for with all else
    """
    held = replace(problem.prior, held=corrections, free=np.arange(GLOBALS) < 3)
    search = Search(problem)
    found: list[Start] = []
    for doubt, place in product(DOUBTS, PLACES):
        wheels = replace(problem.wheels, noise_k_m=doubt * problem.wheels.noise_k_m)
        rough = started(
            replace(problem, prior=held, wheels=wheels), max_rho, 2 * starts, lines, place, finalists=2 * FINALISTS
        )
        if rough is not None:
            found.append(Start(search.annealed(rough.solution.x, STAGES[-4:], 6), rough.gap))
    return min(found, key=lambda start: start.solution.score, default=None)


def unknowns(problem: Problem, pose: Array, shared: Array) -> Unknowns:
    """All lines triangulated from the given poses and mount, with a sigma that forgives dead reckoning."""
    anchor = anchors(problem, pose)
    lines = problem.lines
    std = np.maximum(problem.std, 0.3 * ROUGH)
    empty = np.zeros(lines)
    u, w = triangulated(problem, pose, shared[:3], std, anchor, empty, empty, np.arange(lines))
    return Unknowns(pose, shared.copy(), anchor, u, w)


def candidates(problem: Problem, pose: Array, max_rho: float, count: int, held: Array | None = None) -> list[Array]:
    """The best mounts (eta, cx, cy) of the scan over eta, best first."""
    half: Array = np.linspace(0.0, 0.5 * TURN, ETAS // 2, endpoint=False)
    # The equation does not tell a sight from its opposite: eta and eta + pi share a solution, the score decides.
    eta = wrap(np.concatenate([half, half + np.pi]))
    place, toward, away = _scan(
        problem.frame,
        problem.line,
        problem.lines,
        problem.beta,
        pose,
        half,
        max_rho,
        LINEAR_ROUNDS,
        np.full(2, np.nan) if held is None else held,
    )
    score = np.concatenate([toward, away])
    lowest = (score <= np.roll(score, 1)) & (score <= np.roll(score, -1))
    order = np.argsort(np.where(lowest, score, score + 1e9), kind="stable")
    return [np.array([eta[k], *place[k % half.size]]) for k in order[:count].tolist()]


def _stretches(moved: Increments) -> Index:
    """The stretch that each keyframe lies in (F,); at a stretch's end dead reckoning has lost ROUGH rad."""
    lost = np.cumsum(moved.covariance[:, 2, 2])
    return np.concatenate([[0], np.floor(lost / ROUGH**2)]).astype(np.int64)


def _split(problem: Problem, stretch: Index) -> Problem:
    """Lines that are seen in several stretches become one for each: over longer ways dead reckoning places none."""
    own = problem.line * (int(stretch[-1]) + 1) + stretch[problem.frame]
    _, line = np.unique(own, return_inverse=True)
    return replace(problem, line=line.astype(np.int64))


@compiled
def _scan(
    frame: Index,
    line: Index,
    lines: int,
    beta: Array,
    pose: Array,
    etas: Array,
    max_rho: float,
    rounds: int,
    held: Array,
) -> tuple[Array, Array, Array]:
    """For each eta the camera's place on the robot that fits best, the lines free; robust by reweighting.

    held     (2,) m, the camera's place where it is given; else not a number
    returns  place (E, 2) m, then how badly the sights miss the lines' places if they look there, and if they look away
    """
    count = beta.size
    place, toward, away = np.zeros((etas.size, 2)), np.zeros(etas.size), np.zeros(etas.size)
    weight, sight = np.empty(count), np.empty((count, 7))
    own, spot = np.empty((lines, 9)), np.empty((lines, 2))
    for e in range(etas.size):
        for m in range(count):
            x, y, heading = pose[frame[m], 0], pose[frame[m], 1], pose[frame[m], 2]
            c, s = np.cos(heading), np.sin(heading)
            g = heading + etas[e] + beta[m]
            nx, ny = -np.sin(g), np.cos(g)
            # The sight's normal in the world, in the robot's frame, and what it says of the robot's place.
            sight[m, 0], sight[m, 1] = nx, ny
            sight[m, 2], sight[m, 3] = nx * c + ny * s, -nx * s + ny * c
            sight[m, 4] = nx * x + ny * y
            sight[m, 5], sight[m, 6] = c, s
            weight[m] = 1.0 / (2.0 * ROUGH) ** 2
        px, py = 0.0, 0.0
        for _ in range(rounds):
            own[:] = 0.0
            m00, m01, m11, v0, v1 = 1.0 / max_rho**2, 0.0, 1.0 / max_rho**2, 0.0, 0.0
            for m in range(count):
                k, w = line[m], weight[m]
                nx, ny, ax, ay, told = sight[m, 0], sight[m, 1], sight[m, 2], sight[m, 3], sight[m, 4]
                own[k, 0] += w * nx * nx
                own[k, 1] += w * nx * ny
                own[k, 2] += w * ny * ny
                own[k, 3] += w * nx * ax
                own[k, 4] += w * nx * ay
                own[k, 5] += w * ny * ax
                own[k, 6] += w * ny * ay
                own[k, 7] += w * nx * told
                own[k, 8] += w * ny * told
                m00 += w * ax * ax
                m01 += w * ax * ay
                m11 += w * ay * ay
                v0 -= w * ax * told
                v1 -= w * ay * told
            for k in range(lines):
                a, b, d = own[k, 0] + 0.01, own[k, 1], own[k, 2] + 0.01
                det = a * d - b * b
                ia, ib, ic = d / det, -b / det, a / det
                # (line) = inverse (B p + t): what the lines take from the place's equations.
                x0, y0 = ia * own[k, 3] + ib * own[k, 5], ib * own[k, 3] + ic * own[k, 5]
                x1, y1 = ia * own[k, 4] + ib * own[k, 6], ib * own[k, 4] + ic * own[k, 6]
                xt, yt = ia * own[k, 7] + ib * own[k, 8], ib * own[k, 7] + ic * own[k, 8]
                m00 -= own[k, 3] * x0 + own[k, 5] * y0
                m01 -= own[k, 3] * x1 + own[k, 5] * y1
                m11 -= own[k, 4] * x1 + own[k, 6] * y1
                v0 += own[k, 3] * xt + own[k, 5] * yt
                v1 += own[k, 4] * xt + own[k, 6] * yt
                own[k, 0], own[k, 1], own[k, 2] = x0, x1, xt
                own[k, 3], own[k, 4], own[k, 5] = y0, y1, yt
            det = m00 * m11 - m01 * m01
            px, py = (m11 * v0 - m01 * v1) / det, (m00 * v1 - m01 * v0) / det
            if not np.isnan(held[0]):
                px, py = held[0], held[1]
            for k in range(lines):
                spot[k, 0] = own[k, 0] * px + own[k, 1] * py + own[k, 2]
                spot[k, 1] = own[k, 3] * px + own[k, 4] * py + own[k, 5]
            for m in range(count):
                k = line[m]
                sx, sy = spot[k, 0] - pose[frame[m], 0], spot[k, 1] - pose[frame[m], 1]
                error = sight[m, 0] * sx + sight[m, 1] * sy - sight[m, 2] * px - sight[m, 3] * py
                distance = min(max(np.hypot(sx, sy), 0.5), 20.0)
                off = error / distance / ROUGH
                weight[m] = 1.0 / (ROUGH * distance) ** 2 / (1.0 + off * off) ** 2
        place[e, 0], place[e, 1] = px, py
        for m in range(count):
            k, c, s = line[m], sight[m, 5], sight[m, 6]
            sx = spot[k, 0] - pose[frame[m], 0] - c * px + s * py
            sy = spot[k, 1] - pose[frame[m], 1] - s * px - c * py
            # The normal is the direction turned by a quarter.
            cross = sight[m, 0] * sx + sight[m, 1] * sy
            along = sight[m, 1] * sx - sight[m, 0] * sy
            off = np.arctan2(cross, along) / ROUGH
            back = np.arctan2(-cross, -along) / ROUGH
            toward[e] += min(off * off, 9.0)
            away[e] += min(back * back, 9.0)
    return place, toward, away
