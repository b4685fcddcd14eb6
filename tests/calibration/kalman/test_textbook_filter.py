"""The filter beside an extended Kalman filter as a textbook has it: dense, one step after the other, nothing shared."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman.blocks import agreeing
from omnivert.calibration.kalman.ekf import Filter, Rules
from omnivert.config import Encoder
from omnivert.odometry import Motion, Odometer, Samples, after

Array = NDArray[np.float64]

BASE, K, STD = 0.4, 2e-4, 0.003
MOUNT = np.array([-0.34, 0.23, 0.33])
SPREAD = np.diag([0.02**2, 0.005**2, 0.02**2])
STEP = 1e-20  # of the complex step: slopes right to the last digit, and from the values alone


def motion_from_wheels(right: Array, left: Array) -> Motion:
    """Steps of the wheels (N,), one after the other."""
    right, left = (np.concatenate([[0.0], np.cumsum(way)]) for way in (right, left))
    samples = Samples(0.02 * np.arange(right.size, dtype=np.float64), right, left)
    return Odometer(Encoder(noise_k_m=K, ticks_per_rev=10_000_000), BASE).motion(samples)


def sight(state: Array) -> complex:
    """Bearing of one line; state (5,) 1/D, theta, phi, rho, psi."""
    w, theta, phi, rho, psi = state
    line = np.array([-np.cos(theta), np.sin(theta)]) / w  # in the robot's frame
    camera = rho * np.array([np.cos(phi), np.sin(phi)])
    x, y = line - camera
    # The angle of a complex point is the imaginary part of log(x + iy), which knows no complex x and y; so by turning.
    turned = np.arctan2(y.real, x.real)
    rest = (-np.sin(turned) * x + np.cos(turned) * y) / (np.cos(turned) * x + np.sin(turned) * y)
    return complex(turned + np.arctan(rest) - phi - psi)


def place(state: Array) -> Array:
    """1/D and theta of one line after a motion; state (5,) 1/D, theta, dx, dy, turn."""
    w, theta, dx, dy, turn = state
    x, y = -np.cos(theta) / w - dx, np.sin(theta) / w - dy
    turned = np.arctan2(y.real, x.real)
    rest = (-np.sin(turned) * x + np.cos(turned) * y) / (np.cos(turned) * x + np.sin(turned) * y)
    return np.array([1.0 / np.sqrt(x * x + y * y), np.pi - turned - np.arctan(rest) + turn])


def slope(function: object, at: Array) -> Array:
    """(…, n) by complex steps."""
    assert callable(function)
    return np.stack([np.imag(function(at + 1j * STEP * e)) / STEP for e in np.eye(at.size)], axis=-1)


@dataclass
class Textbook:
    """x, P and the order of the lines, as plain as can be."""

    rules: Rules
    x: Array
    P: Array
    tracks: list[int] = field(default_factory=list)
    unseen: dict[int, int] = field(default_factory=dict)

    def own(self, line: int) -> list[int]:
        n = 2 * len(self.tracks)
        return [2 * line, 2 * line + 1, n, n + 1, n + 2]

    def predict(self, motion: Motion) -> None:
        size = self.x.size
        F, G, x = np.eye(size), np.zeros((size, 3)), self.x.copy()
        for k in range(len(self.tracks)):
            at = np.append(self.x[2 * k : 2 * k + 2], motion.pose).astype(complex)
            x[2 * k : 2 * k + 2] = np.real(place(at))
            by = slope(place, at)
            F[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = by[:, :2]
            G[2 * k : 2 * k + 2] = by[:, 2:]
        self.x, self.P = x, F @ self.P @ F.T + G @ motion.covariance @ G.T

    def update(self, track: list[int], beta: Array) -> int:
        """Known lines correct, by the gate; then lines leave, then new ones enter."""
        known = [(self.tracks.index(t), b) for t, b in zip(track, beta.tolist(), strict=True) if t in self.tracks]
        while known:
            H = np.zeros((len(known), self.x.size))
            nu = np.zeros(len(known))
            for i, (line, b) in enumerate(known):
                at = self.x[self.own(line)].astype(complex)
                H[i, self.own(line)] = slope(sight, at)
                nu[i] = wrap(b - sight(at).real)
            S = H @ self.P @ H.T + STD**2 * np.eye(len(known))
            odd = []
            for i in range(len(known)):  # each against what the others foretell of it
                others = [j for j in range(len(known)) if j != i]
                gain = S[i, others] @ np.linalg.inv(S[np.ix_(others, others)])
                rest = nu[i] - gain @ nu[others]
                odd.append(abs(rest) / np.sqrt(S[i, i] - gain @ S[others, i]))
            if max(odd) <= self.rules.gate:
                gain = self.P @ H.T @ np.linalg.inv(S)
                self.x = self.x + gain @ nu
                self.P = (np.eye(self.x.size) - gain @ H) @ self.P
                break
            del known[int(np.argmax(odd))]
        used = {self.tracks[line] for line, _ in known}
        fresh = [(t, b) for t, b in zip(track, beta.tolist(), strict=True) if t not in self.tracks]
        for t in self.tracks:
            self.unseen[t] = 0 if t in used else self.unseen[t] + 1
        low, high = self.rules.range
        stay = [
            k for k, t in enumerate(self.tracks)
            if self.unseen[t] <= self.rules.unseen and low <= self.x[2 * k] <= high
        ]  # fmt: skip
        rows = [i for k in stay for i in (2 * k, 2 * k + 1)] + [self.x.size - 3, self.x.size - 2, self.x.size - 1]
        self.x, self.P = self.x[rows], self.P[np.ix_(rows, rows)]
        self.tracks = [self.tracks[k] for k in stay]
        for t, b in fresh[: self.rules.most_lines - len(self.tracks)]:
            self.enter(t, b)
        return len(used)

    def enter(self, track: int, beta: float) -> None:
        """theta such that the line is seen at beta, found by bisection; slopes by the implicit function."""
        n, mount = self.x.size - 3, self.x[-3:]
        low, high = -np.pi, np.pi
        guess = np.pi - beta - mount[0] - mount[2]
        for _ in range(80):
            middle = 0.5 * (low + high)
            at = np.array([self.rules.start, guess + middle, *mount], dtype=complex)
            low, high = (middle, high) if wrap(sight(at).real - beta) > 0.0 else (low, middle)
        at = np.array([self.rules.start, guess + low, *mount], dtype=complex)
        h = slope(sight, at)
        J = np.zeros((n + 5, n + 5))  # new x by (old lines, start of 1/D, bearing, mount)
        J[:n, :n], J[n, n], J[n + 2 :, n + 2 :] = np.eye(n), 1.0, np.eye(3)
        J[n + 1, n], J[n + 1, n + 1], J[n + 1, n + 2 :] = -h[0] / h[1], 1.0 / h[1], -h[2:] / h[1]
        inputs = np.zeros((n + 5, n + 5))
        old = [*range(n), n + 2, n + 3, n + 4]
        inputs[np.ix_(old, old)] = self.P
        inputs[n, n], inputs[n + 1, n + 1] = self.rules.start_std**2, STD**2
        self.x = np.concatenate([self.x[:n], [self.rules.start, guess + low], mount])
        self.P = J @ inputs @ J.T
        self.tracks.append(track)
        self.unseen[track] = 0


@pytest.mark.parametrize("outliers", [0.0, 0.15])
def test_state_and_covariance_are_those_of_a_plain_dense_filter(outliers: float) -> None:
    rng = np.random.default_rng(3)
    rules = Rules(most_lines=9)
    lines = {k: rng.uniform(1.3, 3.0) * np.array([np.cos(k), np.sin(k)]) for k in range(30)}
    ours, plain = Filter(MOUNT.copy(), SPREAD.copy(), rules), Textbook(rules, MOUNT.copy(), SPREAD.copy())
    pose, rejected, left = np.zeros(3), 0, 0
    for frame in range(40):
        wheels = np.full((10, 2), 0.005) if frame % 20 < 10 else np.tile([0.002, -0.002], (10, 1))
        motion = motion_from_wheels(wheels[:, 0], wheels[:, 1])
        pose = after(pose, motion.pose)
        ours.predict(motion)
        plain.predict(motion)
        names = [k for k in lines if frame // 5 <= k < frame // 5 + 10 and rng.random() > 0.1]  # they come and go
        camera = pose[:2] + MOUNT[1] * np.array([np.cos(pose[2] + MOUNT[0]), np.sin(pose[2] + MOUNT[0])])
        off = np.array([lines[k] for k in names]) - camera
        beta = np.arctan2(off[:, 1], off[:, 0]) - pose[2] - MOUNT[0] - MOUNT[2] + STD * rng.standard_normal(len(names))
        beta = wrap(np.where(rng.random(beta.size) < outliers, rng.uniform(-3.0, 3.0, beta.size), beta))
        before = set(ours.tracks)
        told = ours.update(np.array(names), beta, np.full(beta.size, STD))
        assert told.used == plain.update(names, beta)
        assert ours.tracks == plain.tracks
        rejected += told.rejected
        left += len(before - set(ours.tracks))
        off_x = ours.x - plain.x
        off_x[1:-3:2] = wrap(off_x[1:-3:2])
        np.testing.assert_allclose(off_x, 0.0, atol=1e-9)
        np.testing.assert_allclose(ours.P, plain.P, atol=1e-9)
        assert ours.is_sound
    assert left > 3
    assert (rejected > 10) == (outliers > 0.0)


def test_the_gate_by_rank_one_steps_is_the_gate_by_new_inverses() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        n = int(rng.integers(2, 30))
        root = rng.standard_normal((n, 3))
        S = 0.03**2 * root @ root.T + STD**2 * np.eye(n)
        nu = np.linalg.cholesky(S) @ rng.standard_normal(n)
        wrong = rng.random(n) < 0.3
        nu[wrong] = rng.uniform(-3.0, 3.0, int(wrong.sum()))
        kept = list(range(n))
        while kept:
            B = np.linalg.inv(S[np.ix_(kept, kept)])
            odd = np.abs(B @ nu[kept]) / np.sqrt(np.diag(B))
            if odd.max() <= 3.5:
                break
            del kept[int(np.argmax(odd))]
        assert agreeing(nu, np.asarray(np.linalg.inv(S), dtype=np.float64), 3.5).tolist() == kept
