"""What the filter goes on from: the lines of the last keyframe as it holds them, and how all of them err together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.judging.manoeuvre import Lines
from omnivert.calibration.kalman import model
from omnivert.calibration.solver.normal import Unknowns
from omnivert.calibration.solver.problem import Index
from omnivert.calibration.solver.smoother import Solution, joint
from omnivert.calibration.symmetric import evened

Array = NDArray[np.float64]

LOOSE = 0.3  # 1/m, sigma of 1/D from which on a line bends too much for one slope,
BENT = 0.15  # 1/m^2, and its product with 1/D: how its bearing bends along the way


@dataclass(frozen=True, slots=True, eq=False)
class Seed:
    """Lines with the joint covariance of lines and mount, in the filter's order."""

    lines: Array  # (N, 2) 1/D, theta
    covariance: Array  # (2 N + 3, 2 N + 3)
    tracks: tuple[int, ...]

    def without_loose(self) -> "Seed":
        """Only the lines of which the distance is known well enough for a filter.

        One that was seen along the way alone may be anywhere on it. From the next bearings across, a filter makes a
        distance that is wrong by many of its own sigmas; the solver finds the right one.
        """
        n = len(self.tracks)
        std = np.sqrt(np.diag(self.covariance)[: 2 * n : 2])
        firm = np.flatnonzero((std < LOOSE) & (std * self.lines[:, 0] < BENT))
        rows = np.concatenate([(2 * firm[:, None] + [0, 1]).ravel(), 2 * n + np.arange(3)])
        names = tuple(self.tracks[k] for k in firm.tolist())
        return Seed(self.lines[firm], self.covariance[np.ix_(rows, rows)], names)


def seed_of(line: Index, track: Index, names: Index, solution: Solution, x: Unknowns) -> Seed:
    """The seed at the last keyframe.

    line, track  (N,)  that it sees
    names        (L,)  of the solution's lines
    x                  the solution's unknowns, or their means
    """
    number = {name: i for i, name in enumerate(names.tolist())}
    tracks, index = [], []
    for name, own in zip(line.tolist(), track.tolist(), strict=True):
        i = number.get(name)
        if i is not None and 0.0 < x.w[i] < 4.0:
            tracks.append(own)
            index.append(i)
    lines = np.array(index, dtype=np.int64)
    covariance = joint(solution, lines)
    px, py, heading = x.pose[-1]
    # (cos u, sin u) + w (anchor - p) is the line from the robot, in units of 1 / w.
    u, w = x.u[lines], x.w[lines]
    back = x.anchor[lines] - [px, py]
    sight = np.stack([np.cos(u) + w * back[:, 0], np.sin(u) + w * back[:, 1]], axis=1)
    length = np.hypot(sight[:, 0], sight[:, 1])
    unit = sight / length[:, None]
    inverse = w / length
    theta = wrap(np.pi + heading - np.arctan2(sight[:, 1], sight[:, 0]))
    n = lines.size
    slope = np.zeros((2 * n + 3, 6 + 2 * n))
    slope[2 * n :, 3:6] = model.polar_from_cartesian(x.mount)[1]
    # How the length and the direction of the sight change with p, u, w.
    across = np.stack([-unit[:, 1], unit[:, 0]], axis=1) / length[:, None]
    by_u = np.stack([-np.sin(u), np.cos(u)], axis=1)
    for k in range(n):
        by = np.column_stack([[-w[k], 0.0], [0.0, -w[k]], by_u[k], back[k]])  # d sight / d (px, py, u, w)
        columns = [0, 1, 6 + 2 * k, 7 + 2 * k]
        slope[2 * k, columns] = -inverse[k] / length[k] * (unit[k] @ by)
        slope[2 * k, 7 + 2 * k] += 1.0 / length[k]
        slope[2 * k + 1, columns] = -(across[k] @ by)
        slope[2 * k + 1, 2] += 1.0
    joined = slope @ covariance @ slope.T
    return Seed(np.stack([inverse, theta], axis=1), evened(joined), tuple(tracks))


def in_sight(seed: Seed) -> Lines:
    """Its lines, for foreseeing manoeuvres."""
    n = seed.lines.shape[0]
    return Lines(seed.lines[:, 0], seed.lines[:, 1], np.sqrt(np.diag(seed.covariance)[: 2 * n : 2]))
