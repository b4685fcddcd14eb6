"""Which simple manoeuvre would help most: each one's Fisher information, foreseen among the lines now in sight.

A manoeuvre is foreseen as driven exactly as told, with the wheels' noise marginalised as increments: so the noise is
never credited as excitation. Only covariances are carried on (the model is linear about the nominal way), one pass of
predicting and updating for all manoeuvres, because those that begin alike share their beginning. Backward shows as much
as forward, and right as much as left: the centres of rotation are the same. So neither is in the set.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.observability import covariance_from_information
from omnivert.calibration.kalman.model import cartesian_from_polar, polar_from_cartesian
from omnivert.calibration.solver.normal import W_STD, bearing_slope
from omnivert.compiled import compiled

Array = NDArray[np.float64]
Leg = tuple[float, float]  # way in m, turn on the spot in rad; one of them is zero

WAYS_M = (0.3, 0.7, 1.5)
TURNS_DEG = (45.0, 90.0, 180.0)
SPEED = 0.15  # m/s, what a manoeuvre's duration is counted with
TURN_RATE = np.deg2rad(9.0)  # rad/s
MOST_LINES = 12  # that are carried along; more are stood for by these, each seen as much better
DIRECTION_STD = 3.0  # rad: a new line may stand anywhere
NEAREST_M = 0.3  # a camera does not pass a line closer than this


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """The lines now in sight, as the filter holds them."""

    w: Array  # (N,) 1/m, 1/D
    theta: Array  # (N,) rad
    w_std: Array  # (N,) 1/m; inf: not known yet


@dataclass(frozen=True, slots=True)
class Outlook:
    """How the robot will drive and see."""

    base_m: float
    noise_k_m: float  # K
    bearing_std_rad: float
    frame_m: float = 0.05  # way from frame to frame
    frame_rad: float = float(np.deg2rad(3.0))  # turn from frame to frame
    longest_m: float = 1.5  # straight in one go
    longest_turn_deg: float = 180.0  # on the spot in one go
    life_frames: float = 40.0  # that a line stays tracked, on average; then it comes back as a new one. inf: forever


@dataclass(frozen=True, slots=True, eq=False)
class Manoeuvre:
    """What to drive next, and what it will bring."""

    legs: tuple[Leg, ...]
    covariance: Array | None  # (3, 3) phi, rho, psi after it; None where nothing could be foreseen
    brings: str  # "phi 3.8 -> 0.6 deg"; empty where nothing could be foreseen

    @property
    def text(self) -> str:
        return in_words(self.legs)

    @property
    def seconds(self) -> float:
        return float(sum(abs(way) / SPEED + abs(turn) / TURN_RATE for way, turn in self.legs))


TURN_AND_DRIVE = Manoeuvre(((0.0, np.pi / 2.0), (0.7, 0.0)), None, "")
DRIVE = Manoeuvre(((0.7, 0.0),), None, "")
TURN = Manoeuvre(((0.0, np.pi / 2.0),), None, "")


def within(manoeuvre: Manoeuvre, longest_m: float, longest_turn_deg: float) -> Manoeuvre:
    """The same, with no leg longer than the robot may go; of one that is cut nothing is foreseen."""
    turn = float(np.deg2rad(longest_turn_deg))
    legs = tuple((min(way, longest_m), min(turned, turn)) for way, turned in manoeuvre.legs)
    return manoeuvre if legs == manoeuvre.legs else Manoeuvre(legs, None, "")


def _up_to(lengths: tuple[float, ...], longest: float) -> tuple[float, ...]:
    """The shorter ones, and the longest."""
    return *(length for length in lengths if length < longest), longest


def in_words(legs: tuple[Leg, ...]) -> str:
    """ "turn about 90 deg on the spot, then drive 0.7 m straight" """
    return ", then ".join(
        f"drive {way:.2g} m straight" if way else f"turn about {np.degrees(abs(turn)):.0f} deg on the spot"
        for way, turn in legs
    )


def best_manoeuvre(mount: Array, information: Array, lines: Lines, outlook: Outlook, limit: Array) -> Manoeuvre:
    """The quickest that reaches the limits; else the one that goes farthest towards them per second.

    mount        (3,)    phi, rho, psi
    information  (3, 3)  on eta, cx, cy so far
    limit        (3,)    rad, m, rad: sigmas of phi, rho, psi that are wanted
    """
    found = foreseen(mount, information, lines, outlook)
    if not found:
        return within(TURN_AND_DRIVE, outlook.longest_m, outlook.longest_turn_deg)
    before = _polar(mount, covariance_from_information(information))
    # Information towards the limit in the worst direction adds up from one manoeuvre to the next, sigmas do not.
    reached = _progress(before, limit)
    progress = np.array([_progress(m.covariance, limit) for m in found])
    seconds = np.array([m.seconds for m in found])
    done = (progress >= 1.0) & (reached < 1.0)
    rate = np.where(done, 1.0, 0.0 if done.any() else progress - reached) / seconds
    good = [m for m, r in zip(found, rate, strict=True) if r >= 0.9 * rate.max()]
    chosen = min(good, key=lambda m: (len(m.legs), m.seconds))
    assert chosen.covariance is not None
    return Manoeuvre(chosen.legs, chosen.covariance, _brings(before, chosen.covariance, limit))


def foreseen(mount: Array, information: Array, lines: Lines, outlook: Outlook) -> list[Manoeuvre]:
    """Every manoeuvre of the set with the covariance after it; none without lines or knowledge of what was seen."""
    w, theta, w_std, std = _carried(lines, outlook.bearing_std_rad)
    if not w.size or not (np.isfinite(information).all() and np.isfinite(mount).all()):
        return []
    cartesian, _ = cartesian_from_polar(mount)
    size = 6 + 2 * w.size
    covariance = np.zeros((size, size))
    covariance[3:6, 3:6] = covariance_from_information(information)
    covariance[np.arange(6, size, 2), np.arange(6, size, 2)] = DIRECTION_STD**2
    covariance[np.arange(7, size, 2), np.arange(7, size, 2)] = np.minimum(w_std, W_STD) ** 2
    # Lives of lines that leave at random, by their quantiles; scattered, so that neighbours do not leave together.
    share = (np.arange(w.size) * 0.618034 + 0.5) % 1.0
    life = np.full(w.size, 1 << 40, dtype=np.int64)
    if np.isfinite(outlook.life_frames):
        life = np.maximum(np.ceil(-outlook.life_frames * np.log(share)), 2.0).astype(np.int64)
    world = (cartesian, np.pi - theta, w, life, std**2, W_STD, DIRECTION_STD, NEAREST_M)
    here = _Place(covariance, np.zeros(3), 0)
    _see(here.covariance, here.pose, here.frame, *world)

    ways = [(way, 0.0) for way in _up_to(WAYS_M, outlook.longest_m)]
    turns = [(0.0, float(np.deg2rad(turn))) for turn in _up_to(TURNS_DEG, outlook.longest_turn_deg)]
    found: list[Manoeuvre] = []
    for first, second in ((ways, turns), (turns, ways)):
        for leg, place in zip(first, _along(here, first, outlook, world), strict=True):
            found.append(Manoeuvre((leg,), _polar(mount, place.covariance[3:6, 3:6]), ""))
            for then, end in zip(second, _along(place, second, outlook, world), strict=True):
                found.append(Manoeuvre((leg, then), _polar(mount, end.covariance[3:6, 3:6]), ""))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Somewhere on a manoeuvre: covariance of pose, mount and lines (u, w); nominal pose; frames since the start."""

    covariance: Array
    pose: Array
    frame: int


_World = tuple[Array, Array, Array, NDArray[np.int64], float, float, float, float]


def _along(start: _Place, legs: list[Leg], outlook: Outlook, world: _World) -> list[_Place]:
    """Where each of some legs of one kind ends; they lie on one another, so each goes on from the one before."""
    stride, step, noise = _straight(outlook) if legs[0][0] > 0.0 else _on_the_spot(outlook)
    places, at, done = [], start, 0
    for way, turn in legs:
        frames = max(done + 1, round((way + turn) / stride))
        covariance, pose = at.covariance.copy(), at.pose.copy()
        _drive(covariance, pose, at.frame, step, noise, frames - done, *world)
        at, done = _Place(covariance, pose, at.frame + frames - done), frames
        places.append(at)
    return places


def _straight(outlook: Outlook) -> tuple[float, Array, Array]:
    """One frame of it: its length, the step (3,) and its covariance (3, 3) by wheel noise (eq. 31) all along the way.

    Both wheels roll the way L. Heading errors made on the way carry what is left of it aside: integrals of L - s.
    """
    way = outlook.frame_m
    turned = 2.0 * outlook.noise_k_m / outlook.base_m**2  # rad^2/m
    noise = np.zeros((3, 3))
    noise[0, 0] = outlook.noise_k_m * way / 2.0
    noise[1, 1], noise[2, 2] = turned * way**3 / 3.0, turned * way
    noise[1, 2] = noise[2, 1] = turned * way**2 / 2.0
    return way, np.array([way, 0.0, 0.0]), noise


def _on_the_spot(outlook: Outlook) -> tuple[float, Array, Array]:
    """The same of a turn: each wheel rolls e a / 2; what they roll together moves the robot where it just heads to."""
    turn = outlook.frame_rad
    moved = outlook.noise_k_m * outlook.base_m / 4.0  # m^2/rad
    noise = np.zeros((3, 3))
    noise[0, 0] = moved * (turn / 2.0 + np.sin(2.0 * turn) / 4.0)
    noise[1, 1] = moved * (turn / 2.0 - np.sin(2.0 * turn) / 4.0)
    noise[0, 1] = noise[1, 0] = moved * np.sin(turn) ** 2 / 2.0
    noise[2, 2] = outlook.noise_k_m * turn / outlook.base_m
    return turn, np.array([0.0, 0.0, turn]), noise


def _carried(lines: Lines, std: float) -> tuple[Array, Array, Array, float]:
    """At most MOST_LINES of the lines, evenly by direction, and the bearing sigma with which they stand for all."""
    # A track that starts has no distance yet, but is as good as any that will come.
    w = np.clip(np.where(np.isfinite(lines.w_std), lines.w, 0.3), 0.0, 1.0 / NEAREST_M)
    if w.size <= MOST_LINES:
        return w, lines.theta, lines.w_std, std
    order = np.argsort(lines.theta, kind="stable")
    some = order[np.linspace(0, w.size - 1, MOST_LINES).round().astype(np.int64)]
    return w[some], lines.theta[some], lines.w_std[some], std * float(np.sqrt(MOST_LINES / w.size))


def _polar(mount: Array, covariance: Array) -> Array:
    slope = polar_from_cartesian(cartesian_from_polar(mount)[0])[1]
    return np.asarray(slope @ covariance @ slope.T)


def _progress(covariance: Array | None, limit: Array) -> float:
    """Information on the worst parameter, as a share of what its limit asks for; 1 is enough."""
    return 0.0 if covariance is None else float((limit**2 / np.diag(covariance)).min())


def _brings(before: Array, after: Array, limit: Array) -> str:
    """What the parameter gains that is known worst."""
    old, new = np.sqrt(np.diag(before)), np.sqrt(np.diag(after))
    most = np.array([np.pi / 2.0, 0.3, np.pi / 2.0])  # as good as unknown
    k = int(np.argmax(np.minimum(old, most) / limit))
    scale, unit = (1e3, "mm") if k == 1 else (180.0 / np.pi, "deg")
    was = "unknown" if old[k] >= most[k] else f"{scale * old[k]:.2g}"
    return f"{('phi', 'rho', 'psi')[k]} {was} -> {scale * new[k]:.2g} {unit}"


@compiled
def _see(
    covariance: Array,
    pose: Array,
    frame: int,
    mount: Array,
    direction: Array,
    w: Array,
    life: NDArray[np.int64],
    variance: float,
    w_std: float,
    direction_std: float,
    nearest: float,
) -> None:
    """Updates the covariance, in place, by a bearing of each line (eq. 16, slopes as in `normal.bearing_slope`).

    covariance  (6 + 2 N, ...)  pose, mount (eta, cx, cy), lines (u, w) about the manoeuvre's start
    pose        (3,)
    direction   (N,)  rad  u, from where the manoeuvre started
    w           (N,)  1/m
    life        (N,)  frames after which a line comes back as a new one, again and again
    variance          rad^2 of a bearing
    """
    n = covariance.shape[0]
    slope = np.empty(8)
    place = np.empty(8, dtype=np.int64)
    column = np.empty(n)
    here = np.zeros(2)
    for i in range(w.size):
        a, b = 6 + 2 * i, 7 + 2 * i
        if frame > 0 and frame % life[i] == 0:
            for k in range(n):
                covariance[a, k] = covariance[k, a] = covariance[b, k] = covariance[k, b] = 0.0
            covariance[a, a], covariance[b, b] = direction_std**2, w_std**2
        bearing_slope(pose, mount, here, direction[i], w[i], 0, a, 3, place, slope)
        # By the camera's place a bearing changes as 1 / distance.
        if slope[0] ** 2 + slope[1] ** 2 > 1.0 / nearest**2:
            continue
        for j in range(n):
            column[j] = 0.0
        for k in range(8):
            for j in range(n):
                column[j] += covariance[place[k], j] * slope[k]
        innovation = variance
        for k in range(8):
            innovation += slope[k] * column[place[k]]
        for j in range(n):
            gain = column[j] / innovation
            for k in range(n):
                covariance[j, k] -= gain * column[k]


@compiled
def _drive(
    covariance: Array,
    pose: Array,
    frame: int,
    step: Array,
    noise: Array,
    frames: int,
    mount: Array,
    direction: Array,
    w: Array,
    life: NDArray[np.int64],
    variance: float,
    w_std: float,
    direction_std: float,
    nearest: float,
) -> None:
    """Carries covariance and pose on, in place, over `frames` equal steps, with bearings after each.

    step   (3,)    m, m, rad  in the robot's own frame
    noise  (3, 3)  of the step
    """
    n = covariance.shape[0]
    for f in range(frames):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        dx, dy = c * step[0] - s * step[1], s * step[0] + c * step[1]
        for j in range(n):
            covariance[0, j] -= dy * covariance[2, j]
            covariance[1, j] += dx * covariance[2, j]
        for j in range(n):
            covariance[j, 0] -= dy * covariance[j, 2]
            covariance[j, 1] += dx * covariance[j, 2]
        turn = np.zeros((3, 3))
        turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1], turn[2, 2] = c, -s, s, c, 1.0
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        covariance[i, j] += turn[i, k] * noise[k, m] * turn[j, m]
        pose[0] += dx
        pose[1] += dy
        pose[2] += step[2]
        _see(
            covariance,
            pose,
            frame + f + 1,
            mount,
            direction,
            w,
            life,
            variance,
            w_std,
            direction_std,
            nearest,
        )
