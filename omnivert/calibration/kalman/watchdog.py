"""Has somebody knocked the camera? Three questions, asked of a mount that was once sure.

While driving: do the bearings of known lines, taken together, fit better if the mount jumped in one of the last frames?
A jump that is not seen at once bends the filter's state; what it then does to later bearings is followed through the
filter's own gain, so that what the filter swallows still tells (generalised likelihood ratio). While standing: have the
bearings jumped although no wheel turned? On the whole: is the mount that the last part of the drive shows still the one
that was converged upon? That one is held here, and no later solution changes it: a smoother that has swallowed a knock
cannot talk it away.

All of it in yaw of the camera, and its place forward and left on the robot: the direction phi of a small rho is no
measure of how far anything moved.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from omnivert.angles import wrap
from omnivert.calibration.kalman.ekf import Evidence, Filter
from omnivert.calibration.kalman.jump import scored
from omnivert.calibration.kalman.model import cartesian_from_polar, polar_by_cartesian

Array = NDArray[np.float64]
Index = NDArray[np.int64]


# A jump that no line shows is taken to be within a radian and a metre: it keeps every sum invertible, and the
# chi-square of few lines on the small side.
_LEAST = np.eye(3)


@dataclass(frozen=True, slots=True)
class WatchRules:
    """When an alarm is raised."""

    chance: float = 1e-7  # of a jump at a given frame to look as sure as that when there was none
    support: float = -2.0  # log likelihood that the next frames must at least leave to a jump that looks sure
    fine: int = 4  # the jump may have been in any of so many last frames,
    coarse: int = 16  # or in every `fine`th of so many,
    longest: int = 192  # or in every `coarse`th of so many, or where it looks likeliest
    ripe_s: float = 60.0  # a better mount may have swallowed a knock: it is held against the drive after so long
    slow_chance: float = 1e-5  # the same for mounts that are compared
    in_a_row: int = 2  # frames at rest, or mounts, that must say so
    age: int = 8  # frames in which a line must have been seen
    unsure: float = 3.0  # times the median sigma: a bearing foretold worse is of a line too near or bent for one slope
    yaw_std: float = float(np.deg2rad(4.0))  # a knock to be expected: no bearing is rejected for such a one
    place_std: float = 0.03  # m
    gate: float = 3.5  # sigmas of a bearing given all others, such a knock allowed
    plain_gate: float = 6.0  # the same, no knock allowed: wide, for a knock is what it looks for
    enough: int = 5  # lines that a knock must explain to be believed rather than that some of them are wrong
    most_still: int = 1000  # lines that are remembered at rest, beyond those of one frame
    standing_frames: int = 2  # of stillness before bearings can be compared


class Kind(StrEnum):
    DRIVING = "driving"
    STANDING = "standing"
    SLOW = "slow"


@dataclass(frozen=True, slots=True, eq=False)
class Alarm:
    """The camera no longer sits where it did."""

    stamp_ns: int  # first frame that shows it; of a slow one, the first frame of the drive's part that does
    kind: Kind
    moved: Array  # (3,) yaw, forward, left; rad, m, m
    covariance: Array  # (3, 3) of it

    @property
    def text(self) -> str:
        """For a person: what has moved, as far as that is seen."""
        yaw, forward, left = self.moved.tolist()
        std = np.sqrt(np.diag(self.covariance)).tolist()
        parts = []
        for value, sigma, words, unit, scale, digits in (
            (yaw, std[0], ("counter-clockwise", "clockwise"), "deg", np.rad2deg(1.0), 1),
            (forward, std[1], ("forward", "backward"), "cm", 100.0, 1),
            (left, std[2], ("to the left", "to the right"), "cm", 100.0, 1),
        ):
            if abs(value) > 2.0 * sigma:
                number = f"{abs(value) * scale:.{digits}f} +- {max(sigma * scale, 0.1):.{digits}f} {unit}"
                parts.append(f"{number} {words[0] if value > 0.0 else words[1]}")
        what = "the camera, or the robot under it, moved" if self.kind is Kind.STANDING else "the camera moved"
        return f"{what} by {', '.join(parts)}" if parts else f"{what}; how far is not seen yet"


@dataclass(slots=True, eq=False)
class Jump:
    """What speaks for one at a frame."""

    stamp_ns: int
    number: int  # of the frame
    support: float | None = None  # what frames have added since it looked sure; None while it does not


class Watchdog:
    """Watches one converged mount until the first alarm; then that alarm stands until `trust` gives it a new mount."""

    def __init__(self, mount: Array, covariance: Array, rules: WatchRules | None = None, stamp_ns: int = 0) -> None:
        self.rules = rules or WatchRules()
        self._jumps: list[Jump] = []
        self._scores, self._informations, self.chi = np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
        self._doubt = np.array([self.rules.yaw_std, self.rules.place_std, self.rules.place_std])
        self._limit = float(chdtri(3.0, self.rules.chance))
        self._slow_limit = float(chdtri(3.0, self.rules.slow_chance))
        self.trust(mount, covariance, stamp_ns)

    def trust(self, mount: Array, covariance: Array, stamp_ns: int = 0) -> None:
        """From here on this is where the camera sits: phi, rho, psi and covariance (3, 3); known since a stamp."""
        self.alarm: Alarm | None = None
        self._next: tuple[int, Array, Array] | None = None  # a better mount that is not ripe
        self._hold(stamp_ns, mount, covariance)
        self.frames = 0
        self._forget_jumps()
        self._odd_mounts = 0
        self._still: dict[int, tuple[int, float, float]] = {}  # of a track: sights at rest, mean bearing, std of one
        self._still_frames = 0
        self._odd_still: list[int] = []  # stamps

    def renew(self, stamp_ns: int, mount: Array, covariance: Array) -> None:
        """The same camera is known better, as of a stamp; what was asked of the frames before goes on being asked.

        Were each better mount held at once, one that has followed a knock half the way would hide the knock.
        """
        if self._next is None:
            self._next = stamp_ns, mount.copy(), covariance.copy()
        elif stamp_ns - self._next[0] >= self.rules.ripe_s * 1e9:
            self._hold(*self._next)
            self._next = stamp_ns, mount.copy(), covariance.copy()

    def _hold(self, stamp_ns: int, mount: Array, covariance: Array) -> None:
        self._mount, slope = cartesian_from_polar(mount)
        self._covariance = slope @ covariance @ slope.T
        self._since_ns = stamp_ns

    def step(self, stamp_ns: int, known: Filter, evidence: Evidence | None) -> Alarm | None:
        """After each update of the filter, with what it had expected."""
        if self.alarm is not None:
            known.follow(False)
            return None
        if evidence is None:
            return None
        if not known.follows or evidence.shift.shape[1] != 3 * len(self._jumps) + 3:  # a new filter, or a new mount
            known.follow(True)
            self._forget_jumps()
            return None
        self.frames += 1
        self._jumps.append(Jump(stamp_ns, self.frames))
        self._scores = np.concatenate([self._scores, np.zeros((1, 3))])
        self._informations = np.concatenate([self._informations, _LEAST[None]])
        before, score, information = self.chi, self._scores.copy(), self._informations.copy()
        self.chi = scored(
            evidence.nu,
            evidence.precision,
            evidence.shift,
            (evidence.age >= self.rules.age) & _foretold(evidence, self.rules.unsure),
            self._doubt,
            self.rules.gate,
            self.rules.plain_gate,
            self.rules.enough,
            self._scores,
            self._informations,
        )
        for k in np.flatnonzero(before > self._limit).tolist():
            # Wrong bearings can look like a jump for a frame. The next frames deny such a one by far; of a real one
            # they may add little, for the filter has swallowed much of it.
            jump = np.linalg.solve(information[k], score[k])
            new = self._scores[k] - score[k]
            more = float(jump @ new - 0.5 * jump @ (self._informations[k] - information[k]) @ jump)
            self._jumps[k].support = (self._jumps[k].support or 0.0) + more
        sure = [
            k for k, jump in enumerate(self._jumps) if jump.support is not None and jump.support > self.rules.support
        ]
        if sure and self.chi[sure].max() > self._limit:
            first = sure[int(np.argmax(self.chi[sure]))]
            return self._raised(
                self._jumps[first].stamp_ns, self._scores[first], self._informations[first], Kind.DRIVING
            )
        likeliest = int(np.argmax(self.chi))
        stay = [k for k, jump in enumerate(self._jumps) if self._stays(jump, k == likeliest)]
        if len(stay) < len(self._jumps):
            self._jumps = [self._jumps[k] for k in stay]
            self._scores, self._informations = self._scores[stay], self._informations[stay]
            self.chi = self.chi[stay]
            size = known.followed.shape[0]
            known.followed = known.followed.reshape(size, -1, 3)[:, stay].reshape(size, -1)
        return None

    def stand(self, stamp_ns: int, still: bool, track: Index, beta: Array, std: Array, known: Filter) -> Alarm | None:
        """Every frame, update of the filter or not.

        still  no wheel turned since the frame before
        """
        if self.alarm is not None:
            return None
        if not still:
            self._still, self._still_frames, self._odd_still = {}, 0, []
        elif self._still_frames >= self.rules.standing_frames:
            found = self._jumped(track, beta, std, known)
            if found is not None and found[0] @ np.linalg.solve(found[1], found[0]) > self._limit:
                self._odd_still.append(stamp_ns)
                if len(self._odd_still) >= self.rules.in_a_row:
                    return self._raised(self._odd_still[0], *found, Kind.STANDING)
                return None  # what it stood like before stays as it is until this is decided
            self._odd_still = []
        self._still_frames += 1
        if len(self._still) > self.rules.most_still + track.size:  # tracks come and go for hours
            self._still = {name: self._still[name] for name in track.tolist() if name in self._still}
        for name, bearing, sigma in zip(track.tolist(), beta.tolist(), std.tolist(), strict=True):
            count, mean, most = self._still.get(name, (0, bearing, sigma))
            off = wrap(bearing - mean)
            if count and abs(off) > self.rules.plain_gate * sigma:  # one of the two is wrong; of a few, the earlier
                count, mean, off = (0, bearing, 0.0) if count < 3 else (count - 1, mean, 0.0)
            self._still[name] = (count + 1, wrap(mean + off / (count + 1)), max(most, sigma))
        return None

    def compare(self, since_ns: int, mount: Array, covariance: Array) -> Alarm | None:
        """Now and then: the mount as the last part of the drive alone has it, which began at a stamp.

        None, too, while that part holds frames by which the mount that is held was found.
        """
        if self.alarm is not None or since_ns < self._since_ns:
            return None
        there, slope = cartesian_from_polar(mount)
        moved = there - self._mount
        moved[0] = wrap(float(moved[0]))
        spread = slope @ covariance @ slope.T + self._covariance
        odd = float(moved @ np.linalg.solve(spread, moved)) > self._slow_limit
        self._odd_mounts = self._odd_mounts + 1 if odd else 0
        if self._odd_mounts < self.rules.in_a_row:
            return None
        information: Array = np.asarray(np.linalg.inv(spread), dtype=np.float64)
        return self._raised(since_ns, information @ moved, information, Kind.SLOW)

    def _raised(self, stamp_ns: int, score: Array, information: Array, kind: Kind) -> Alarm:
        covariance: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
        self.alarm = Alarm(stamp_ns, kind, covariance @ score, 0.5 * (covariance + covariance.T))
        return self.alarm

    def _forget_jumps(self) -> None:
        self._jumps = []
        self._scores, self._informations = np.zeros((0, 3)), np.zeros((0, 3, 3))
        self.chi = np.zeros(0)  # of the last step, by jump: chi-square of 3 if there was none

    def _stays(self, jump: Jump, is_likeliest: bool) -> bool:
        """Whether a jump at that frame is still asked about after the next one."""
        rules, age = self.rules, self.frames - jump.number + 1
        every = 1 if age < rules.fine else rules.fine if age < rules.coarse else rules.coarse
        return age < rules.longest and (is_likeliest or jump.number % every == 0)

    def _jumped(self, track: Index, beta: Array, std: Array, known: Filter) -> tuple[Array, Array] | None:
        """Score and information of a jump since the robot stands, from lines seen before it and now."""
        _, slopes = known.expected()
        place = {name: k for k, name in enumerate(known.tracks)}
        rows = [
            (k, place[name], *self._still[name])
            for k, name in enumerate(track.tolist())
            if name in place and name in self._still
        ]
        if not rows:
            return None
        now, line = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
        count, mean, most = (np.array([float(r[k]) for r in rows]) for k in (2, 3, 4))
        off = wrap(beta[now] - mean)
        score, information = np.zeros((1, 3)), _LEAST[None].copy()
        scored(
            off,
            np.diag(1.0 / (std[now] ** 2 + most**2 / count)),
            slopes[line, 2:] @ polar_by_cartesian(known.x[known.layout.mount]),
            np.ones(off.size, dtype=np.bool_),
            self._doubt,
            self.rules.gate,
            self.rules.plain_gate,
            self.rules.enough - 1,  # no unknown turn of the robot
            score,
            information,
        )
        return score[0], information[0]


def _foretold(evidence: Evidence, unsure: float) -> NDArray[np.bool_]:
    """Lines (N,) of which the bearing was foretold about as well as of most."""
    spread = np.sqrt(np.diag(np.linalg.inv(evidence.precision)))
    return np.asarray(spread < unsure * np.median(spread))
