"""The multi-line filter (eqs. 28-30); its algebra is filterpy's, its state and order of things are here."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import blocks, model
from omnivert.calibration.kalman.definite import factor, inverse
from omnivert.calibration.kalman.structured import Moved, Slopes, Spread
from omnivert.calibration.symmetric import evened
from omnivert.odometry import Motion

Array = NDArray[np.float64]
Index = NDArray[np.int64]


FARTHEST_M = 100.0  # a camera beyond it is on no robot, and no message can tell it
SWEEP = 32  # updates after which tracks that are gone are swept out: until then they only take room


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


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The known lines of one update as they came in, before any was rejected."""

    age: Index  # (N,) frames in which the track was seen, this one included
    nu: Array  # (N,) rad, the innovation
    precision: Array  # (N, N) S^-1
    shift: Array  # (N, C) how far what is followed moves the innovation; the last three are a jump right now


@dataclass(frozen=True, slots=True)
class Innovation:
    """What one update made of its bearings."""

    used: int
    new: int
    rejected: int
    evidence: Evidence | None = None  # None when no line was known


class Algebra(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """filterpy's filter, with a motion model that is not linear: `foreseen` is the state after the motion."""

    def __init__(self) -> None:
        super().__init__(dim_x=3, dim_z=1)
        self.foreseen = np.zeros(3)

    def predict_x(self, u: float = 0) -> None:
        self.x = self.foreseen


class Filter:
    """State with covariance, and which track each line is."""

    def __init__(self, mount: Array, covariance: Array, rules: Rules) -> None:
        assert mount.shape == (3,)
        assert covariance.shape == (3, 3)
        self.rules = rules
        self.tracks: list[int] = []
        self._unseen: list[int] = []  # updates since the last accepted sight, by line
        self._updates = 0
        self._sights: dict[int, tuple[int, int]] = {}  # of each recent track, in the state or not: how many, the last
        self._is_definite = True
        self._algebra = Algebra()
        self.follows = False
        self.followed = np.zeros((3, 0))
        """(M, C) what is left in the state of jumps of the mount, three columns each: truth less state for a jump of
        one radian of yaw, one metre forward, one to the left. With `follows` each update begins a new one."""
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
        """Whether the state is made of numbers, the camera is on the robot, and the covariance is positive definite."""
        # All of it, by a Cholesky: a tenth of an update. What is not a number fails it, too.
        somewhere = bool(np.isfinite(self.x).all()) and abs(float(self.x[self.layout.mount][1])) <= FARTHEST_M
        return self._is_definite and somewhere and factor(self.P) is not None

    def seed(self, mount: Array, lines: Array, covariance: Array, tracks: list[int]) -> None:
        """Everything anew: mount (3,), lines (N, 2) as the layout holds them, their joint covariance in its order.

        How often a track was seen stays known.
        """
        layout = Layout(len(tracks))
        assert mount.shape == (3,)
        assert lines.shape == (len(tracks), 2)
        assert covariance.shape == (layout.size, layout.size)
        before = {t: k for k, t in enumerate(self.tracks)}
        m, carried = self.layout.size - 3, self.followed
        self.tracks = list(tracks)
        self._unseen = [0] * len(tracks)
        self._is_definite = True
        self.x = np.concatenate([lines.ravel(), mount])
        self.P = covariance.copy()
        # Where smoother and filter have the same data they err alike; a line that only the smoother knew is bent to
        # the mount that it has, as one that enters is.
        self.followed = np.concatenate([np.zeros((2 * len(tracks), carried.shape[1])), carried[m:]])
        if carried.shape[1] and tracks:
            slopes = self.expected()[1]
            bent = -slopes[:, 2:] / slopes[:, 1:2] @ carried[m:]
            for k, t in enumerate(tracks):
                if t in before:
                    self.followed[2 * k : 2 * k + 2] = carried[2 * before[t] : 2 * before[t] + 2]
                else:
                    self.followed[2 * k + 1] = bent[k]

    def predict(self, motion: Motion) -> None:
        """The robot has moved; the mount has not."""
        layout = self.layout
        if not layout.lines:
            return
        mount = self.x[layout.mount]
        distance, heading = self.x[layout.distance].copy(), self.x[layout.heading].copy()
        right, left = motion.wheels_m
        if self.rules.inverse:
            new_distance, new_heading, by_state, by_input = model.moved_exactly(distance, heading, motion.pose)
            noise = motion.covariance
        else:
            new_distance, new_heading, by_state, by_input = model.moved_first_order(
                distance, heading, right, left, self.rules.base_m
            )
            noise = self.rules.noise_k_m * np.diag(np.abs(motion.wheels_m))  # eq. 31
        x = np.empty(layout.size)
        x[layout.distance], x[layout.heading], x[layout.mount] = new_distance, new_heading, mount
        kalman, moved = self._kalman(), Moved(by_state)
        kalman.foreseen, kalman.F, kalman.Q = x, moved, blocks.driven(by_input, noise)
        kalman.predict()
        assert kalman.x.shape == self.x.shape
        assert kalman.P.shape == (layout.size, layout.size)
        self.x = kalman.x
        self.P = kalman.P  # symmetric, as F P F' and Q are
        if self.followed.shape[1]:
            self.followed = moved.moved(self.followed)

    def update(self, track: Index, beta: Array, std: Array) -> Innovation:
        """All lines seen in a frame: known ones correct the state, new ones enter it, lost ones leave.

        track  (M,)  unique
        beta   (M,)  rad
        std    (M,)  rad
        """
        assert track.shape == beta.shape == std.shape
        names = track.tolist()
        self._count(names)
        place = {t: k for k, t in enumerate(self.tracks)}
        known = np.array([k for k, t in enumerate(names) if t in place], dtype=np.int64)
        fresh = [k for k, t in enumerate(names) if t not in place]
        seen: set[int] = set()
        evidence = None
        if known.size:
            lines = np.array([place[names[k]] for k in known.tolist()], dtype=np.int64)
            kept, evidence = self._correct(lines, beta[known], std[known])
            seen = set(lines[kept].tolist())
        self._unseen = [0 if k in seen else n + 1 for k, n in enumerate(self._unseen)]
        self._leave()
        room = self.rules.most_lines - len(self.tracks) if self.rules.enters else 0
        entering = fresh[: max(room, 0)]
        if entering:
            self._enter(track[entering], beta[entering], std[entering])
        return Innovation(len(seen), len(fresh), int(known.size) - len(seen), evidence)

    def forget_lines(self) -> None:
        """Keep only the mount."""
        self._keep([])

    def follow(self, follows: bool) -> None:
        """Jumps are followed from the next update on, or no more."""
        self.follows, self.followed = follows, self.followed[:, :0]

    def expected(self) -> tuple[Array, Array]:
        """Predicted bearing of every line (Z,) and its slope by the line's own two and by phi, rho, psi (Z, 5)."""
        layout = self.layout
        phi, rho, psi = self.x[layout.mount].tolist()
        distance, heading = self.x[layout.distance].copy(), self.x[layout.heading].copy()
        if self.rules.inverse:
            return (
                model.bearing_inverse(distance, heading, phi, rho, psi),
                model.bearing_inverse_slopes(distance, heading, phi, rho),
            )
        return model.bearing(distance, heading, phi, rho, psi), model.bearing_slopes(distance, heading, phi, rho)

    def _count(self, names: list[int]) -> None:
        """Another sight of each; a track that was not seen for some updates is forgotten."""
        self._updates += 1
        now, sights = self._updates, self._sights
        oldest = now - 1 - self.rules.unseen
        for name in names:
            count, last = sights.get(name, (0, now))
            sights[name] = (count + 1 if last >= oldest else 1, now)
        if now % SWEEP == 0:
            self._sights = {name: seen for name, seen in sights.items() if seen[1] > oldest}

    def _correct(self, lines: Index, beta: Array, std: Array) -> tuple[Index, Evidence | None]:
        predicted, slopes = self.expected()
        slopes = slopes[lines]
        spread = blocks.foretold(self.P, slopes, lines, std)
        innovation = model.wrapped(beta - predicted[lines])
        precision = inverse(spread)
        if precision is None:
            self._is_definite = False
            return np.zeros(0, dtype=np.int64), None
        age = np.array([self._sights[self.tracks[k]][0] for k in lines.tolist()], dtype=np.int64)
        if self.follows:
            jump = np.zeros((self.layout.size, 3))
            jump[self.layout.mount] = model.polar_by_cartesian(self.x[self.layout.mount])
            self.followed = np.concatenate([self.followed, jump], axis=1)
        shift = Slopes(slopes, lines).left_of(self.followed) if self.followed.shape[1] else np.zeros((lines.size, 0))
        evidence = Evidence(age, innovation, precision, shift)
        kept = blocks.agreeing(innovation, precision, self.rules.gate)
        if not kept.size:
            return kept, evidence
        used, r = Slopes(slopes[kept], lines[kept]), Spread(std[kept] ** 2)
        kalman = self._kalman()
        kalman.update(innovation[kept], HJacobian=lambda _: used, Hx=lambda _: np.zeros(kept.size), R=r)
        assert kalman.x.shape == self.x.shape
        assert kalman.P.shape == self.P.shape
        self.x = kalman.x
        self.x[self.layout.heading] = model.wrapped(self.x[self.layout.heading].copy())
        self.P = evened(kalman.P)
        if self.followed.shape[1]:
            self.followed = self.followed - kalman.K @ shift[kept]
        return kept, evidence

    def _enter(self, track: Index, beta: Array, std: Array) -> None:
        """New lines behind the known ones, correlated with the mount: theta follows from beta, mount and 1/D."""
        rules, old = self.rules, self.layout
        phi, rho, psi = self.x[old.mount].tolist()
        first = np.full(track.size, rules.start)
        w = first if rules.inverse else 1.0 / first
        heading = model.heading_from_bearing(beta, w, phi, rho, psi)
        slopes = (
            model.bearing_inverse_slopes(first, heading, phi, rho)
            if rules.inverse
            else model.bearing_slopes(first, heading, phi, rho)
        )
        # h(first, theta, mount) = beta: what changes one of them changes theta by the others' slopes.
        by_beta = 1.0 / slopes[:, 1]
        by_first, by_mount = -slopes[:, 0] * by_beta, -slopes[:, 2:] * by_beta[:, None]
        self.P = blocks.entered(self.P, by_first, by_mount, by_beta, rules.start_std, std)
        m = 2 * old.lines
        self.x = np.concatenate([self.x[:m], np.stack([first, heading], axis=1).ravel(), self.x[old.mount]])
        if self.followed.shape[1]:
            rows = np.zeros((2 * track.size, self.followed.shape[1]))
            rows[1::2] = by_mount @ self.followed[m:]
            self.followed = np.concatenate([self.followed[:m], rows, self.followed[m:]])
        else:
            self.followed = np.zeros((self.x.size, 0))
        self.tracks += track.tolist()
        self._unseen += [0] * track.size

    def _leave(self) -> None:
        low, high = self.rules.range
        first = self.x[self.layout.distance]
        stays = zip(self._unseen, first.tolist(), strict=True)
        self._keep([k for k, (unseen, w) in enumerate(stays) if unseen <= self.rules.unseen and low <= w <= high])

    def _keep(self, lines: list[int]) -> None:
        if len(lines) == len(self.tracks):
            return
        m = 2 * len(self.tracks)
        rows = np.array([i for k in lines for i in (2 * k, 2 * k + 1)] + [m, m + 1, m + 2], dtype=np.int64)
        self.x = self.x[rows]
        self.P = blocks.picked(self.P, rows)
        self.followed = self.followed[rows]
        self.tracks = [self.tracks[k] for k in lines]
        self._unseen = [self._unseen[k] for k in lines]

    def _kalman(self) -> "Algebra":
        """filterpy's filter with this state; made once, for to make it costs as much as its use.

        What it holds of a size of its own is replaced with each use (x, P, F, Q, H, R), or stands for an identity.
        """
        kalman = self._algebra
        kalman.dim_x = self.x.size
        kalman.x, kalman.P = self.x, self.P
        return kalman


def rules_of_the_paper(base_m: float, noise_k_m: float) -> Rules:
    """Paper: D, first order in the way, 5 K (VIII-B). It is silent on how D of a new line starts: 3 m +- 2 m."""
    return Rules(
        inverse=False, base_m=base_m, noise_k_m=5.0 * noise_k_m, start=3.0, start_std=2.0, range=(0.05, 1000.0)
    )
