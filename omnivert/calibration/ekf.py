"""The multi-line filter (eqs. 28-30); its algebra is filterpy's, its state and order of things are here."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration import model
from omnivert.odometry import Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things stand in the state: line by line (distance, heading), then phi, rho, psi.

    The first of a line is its inverse distance, or in paper mode its distance.
    """

    lines: int

    @property
    def size(self) -> int:
        return 2 * self.lines + 3

    @property
    def distance(self) -> slice:
        return slice(0, 2 * self.lines, 2)

    @property
    def heading(self) -> slice:
        return slice(1, 2 * self.lines, 2)

    @property
    def mount(self) -> slice:
        return slice(2 * self.lines, 2 * self.lines + 3)


@dataclass(frozen=True, slots=True)
class Rules:
    """What the filter may do."""

    inverse: bool = True  # 1/D and exact motion, or D and first order as printed
    base_m: float = 0.4  # first order only: wheel base, and K with its factor
    noise_k_m: float = 2e-4
    enters: bool = True  # new lines enter here; else only with the next seed
    start: float = 0.45  # of a new line, 1/m or m
    start_std: float = 0.35
    gate: float = 3.5  # sigmas of an innovation given all others
    unseen: int = 3  # updates without a sight after which a line leaves
    most_lines: int = 40
    range: tuple[float, float] = (0.01, 5.0)  # of the first of a line; outside it leaves


@dataclass(frozen=True, slots=True)
class Innovation:
    """What one update made of its bearings."""

    used: int
    new: int
    rejected: int


class Filter:
    """State with covariance, and which track each line is."""

    def __init__(self, mount: Array, covariance: Array, rules: Rules) -> None:
        assert mount.shape == (3,)
        assert covariance.shape == (3, 3)
        self.rules = rules
        self.tracks: list[int] = []
        self._unseen: list[int] = []  # updates since the last accepted sight, by line
        self.x = mount.copy()
        self.P = covariance.copy()

    @property
    def layout(self) -> Layout:
        return Layout(len(self.tracks))

    @property
    def mount(self) -> Array:
        """phi, rho, psi with rho >= 0 and angles in (-pi, pi]."""
        phi, rho, psi = self.x[self.layout.mount]
        if rho < 0.0:
            phi, rho, psi = phi + np.pi, -rho, psi - np.pi
        return np.array([wrap(float(phi)), rho, wrap(float(psi))])

    @property
    def mount_covariance(self) -> Array:
        block = self.P[self.layout.mount, self.layout.mount]
        if self.x[self.layout.mount][1] >= 0.0:
            return block.copy()
        turned = np.diag([1.0, -1.0, 1.0])
        return np.asarray(turned @ block @ turned)

    @property
    def is_sound(self) -> bool:
        """Whether state and variances are still numbers that can be."""
        return bool(np.isfinite(self.x).all() and np.isfinite(self.P).all() and (np.diag(self.P) > 0.0).all())

    def seed(self, mount: Array, lines: Array, covariance: Array, tracks: list[int]) -> None:
        """Everything anew: mount (3,), lines (N, 2) as the layout holds them, their joint covariance in its order."""
        layout = Layout(len(tracks))
        assert mount.shape == (3,)
        assert lines.shape == (len(tracks), 2)
        assert covariance.shape == (layout.size, layout.size)
        self.tracks = list(tracks)
        self._unseen = [0] * len(tracks)
        self.x = np.concatenate([lines.ravel(), mount])
        self.P = covariance.copy()

    def predict(self, motion: Motion) -> None:
        """The robot has moved; the mount has not."""
        layout = self.layout
        if not layout.lines:
            return
        n = layout.lines
        distance, heading = self.x[layout.distance], self.x[layout.heading]
        right, left = motion.wheels_m
        if self.rules.inverse:
            new_distance, new_heading, by_state, by_input = model.moved_exactly(distance, heading, motion.pose)
            noise = motion.covariance
        else:
            new_distance, new_heading, by_state, by_input = model.moved_first_order(
                distance, heading, right, left, self.rules.base_m
            )
            noise = self.rules.noise_k_m * np.diag(np.abs(motion.wheels_m))  # eq. 31
        f = np.eye(layout.size)
        blocks = f[: 2 * n, : 2 * n].reshape(n, 2, n, 2)
        blocks[np.arange(n), :, np.arange(n), :] = by_state
        g = np.zeros((layout.size, noise.shape[0]))
        g[: 2 * n] = by_input.reshape(2 * n, noise.shape[0])
        kalman = self._kalman(0)
        kalman.F = f
        kalman.Q = g @ noise @ g.T
        kalman.predict()
        assert kalman.P.shape == (layout.size, layout.size)
        self.P = 0.5 * (kalman.P + kalman.P.T)
        self.x = self.x.copy()
        self.x[layout.distance] = new_distance
        self.x[layout.heading] = wrap(new_heading)

    def update(self, track: Index, beta: Array, std: Array) -> Innovation:
        """All lines seen in a frame: known ones correct the state, new ones enter it, lost ones leave.

        track  (M,)  unique
        beta   (M,)  rad
        std    (M,)  rad
        """
        assert track.shape == beta.shape == std.shape
        place = {t: k for k, t in enumerate(self.tracks)}
        known = np.array([k for k, t in enumerate(track.tolist()) if t in place], dtype=np.int64)
        fresh = [k for k, t in enumerate(track.tolist()) if t not in place]
        accepted = np.zeros(0, dtype=np.int64)
        if known.size:
            lines = np.array([place[t] for t in track[known].tolist()], dtype=np.int64)
            kept = self._correct(lines, beta[known], std[known])
            accepted = lines[kept]
        seen = set(accepted.tolist())
        self._unseen = [0 if k in seen else n + 1 for k, n in enumerate(self._unseen)]
        self._leave()
        room = self.rules.most_lines - len(self.tracks) if self.rules.enters else 0
        entering = fresh[: max(room, 0)]
        if entering:
            self._enter(track[entering], beta[entering], std[entering])
        return Innovation(len(seen), len(fresh), int(known.size) - len(seen))

    def forget_lines(self) -> None:
        """Keep only the mount."""
        self._keep([])

    def expected(self) -> tuple[Array, Array]:
        """Predicted bearing of every line (Z,) and its slope by the state (Z, 2 Z + 3)."""
        layout = self.layout
        n = layout.lines
        phi, rho, psi = self.x[layout.mount]
        distance, heading = self.x[layout.distance], self.x[layout.heading]
        if self.rules.inverse:
            beta = model.bearing_inverse(distance, heading, phi, rho, psi)
            slopes = model.bearing_inverse_slopes(distance, heading, phi, rho)
        else:
            beta = model.bearing(distance, heading, phi, rho, psi)
            slopes = model.bearing_slopes(distance, heading, phi, rho)
        h = np.zeros((n, layout.size))
        every = np.arange(n)
        h[every, 2 * every] = slopes[:, 0]
        h[every, 2 * every + 1] = slopes[:, 1]
        h[:, layout.mount] = slopes[:, 2:]
        return beta, h

    def _correct(self, lines: Index, beta: Array, std: Array) -> Index:
        predicted, h = self.expected()
        h = h[lines]
        innovation = wrap(beta - predicted[lines])
        kept = agreeing(innovation, h @ self.P @ h.T + np.diag(std**2), self.rules.gate)
        if not kept.size:
            return kept
        h, innovation, r = h[kept], innovation[kept], np.diag(std[kept] ** 2)
        kalman = self._kalman(kept.size)
        kalman.update(innovation, HJacobian=lambda _: h, Hx=lambda _: np.zeros(kept.size), R=r)
        assert kalman.x.shape == self.x.shape
        assert kalman.P.shape == self.P.shape
        self.x = kalman.x
        self.x[self.layout.heading] = wrap(self.x[self.layout.heading])
        self.P = 0.5 * (kalman.P + kalman.P.T)
        return kept

    def _enter(self, track: Index, beta: Array, std: Array) -> None:
        """New lines behind the known ones, correlated with the mount: theta follows from beta, mount and 1/D."""
        rules, old = self.rules, self.layout
        n = track.size
        phi, rho, psi = self.x[old.mount]
        first = np.full(n, rules.start)
        w = first if rules.inverse else 1.0 / first
        heading = model.heading_from_bearing(beta, w, phi, rho, psi)
        slopes = (
            model.bearing_inverse_slopes(first, heading, phi, rho)
            if rules.inverse
            else model.bearing_slopes(first, heading, phi, rho)
        )
        # h(first, theta, mount) = beta: what changes one of them changes theta by the others' slopes.
        by_first = -slopes[:, 0] / slopes[:, 1]
        by_mount = -slopes[:, 2:] / slopes[:, 1:2]
        by_beta = 1.0 / slopes[:, 1]
        new = Layout(old.lines + n)
        m = 2 * old.lines
        carried = np.zeros((new.size, old.size))
        carried[:m, :m] = np.eye(m)
        carried[m + 1 : m + 2 * n : 2, old.mount] = by_mount
        carried[new.mount, old.mount] = np.eye(3)
        self.P = carried @ self.P @ carried.T
        for k in range(n):
            own = np.array([[rules.start_std, 0.0], [by_first[k] * rules.start_std, by_beta[k] * std[k]]])
            at = slice(m + 2 * k, m + 2 * k + 2)
            self.P[at, at] += own @ own.T
        self.x = np.concatenate([self.x[:m], np.stack([first, heading], axis=1).ravel(), self.x[old.mount]])
        self.tracks += track.tolist()
        self._unseen += [0] * n

    def _leave(self) -> None:
        low, high = self.rules.range
        first = self.x[self.layout.distance]
        self._keep(
            [k for k in range(len(self.tracks)) if self._unseen[k] <= self.rules.unseen and low <= first[k] <= high]
        )

    def _keep(self, lines: list[int]) -> None:
        if len(lines) == len(self.tracks):
            return
        m = 2 * len(self.tracks)
        rows = [i for k in lines for i in (2 * k, 2 * k + 1)] + [m, m + 1, m + 2]
        self.x = self.x[rows]
        self.P = self.P[np.ix_(rows, rows)]
        self.tracks = [self.tracks[k] for k in lines]
        self._unseen = [self._unseen[k] for k in lines]

    def _kalman(self, bearings: int) -> ExtendedKalmanFilter:
        kalman = ExtendedKalmanFilter(dim_x=self.layout.size, dim_z=bearings)
        kalman.x = self.x.copy()
        kalman.P = self.P.copy()
        return kalman


def agreeing(innovation: Array, covariance: Array, gate: float) -> Index:
    """Which innovations agree with each other: the worst, given all others, goes until none is beyond the gate."""
    kept = np.arange(innovation.size)
    while kept.size:
        inverse = np.linalg.inv(covariance[np.ix_(kept, kept)])
        # S^-1 nu / sqrt(diag S^-1) is each innovation minus what the others foretell, in its own sigma.
        odd = np.abs(inverse @ innovation[kept]) / np.sqrt(np.diag(inverse))
        worst = int(np.argmax(odd))
        if odd[worst] <= gate:
            break
        kept = np.delete(kept, worst)
    return kept


def rules_of_the_paper(base_m: float, noise_k_m: float) -> Rules:
    """Paper: D, first order in the way, 5 K (VIII-B). It is silent on how D of a new line starts: 3 m +- 2 m."""
    return Rules(
        inverse=False, base_m=base_m, noise_k_m=5.0 * noise_k_m, start=3.0, start_std=2.0, range=(0.05, 1000.0)
    )
