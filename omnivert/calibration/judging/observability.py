"""What the drive has shown of the mount, from the information gathered; not from the wheels' noise.

At one fixed centre of rotation (a turn on the spot, one circle) the bearings stay the same when camera and lines are
scaled and turned about that centre. A solution slides along this valley, and the jitter of the wheels then looks like
excitation. So the information is also taken on the nominal way: the simplest one that the wheels cannot be told from,
made of pieces with one centre of rotation each. The larger sigma counts.

Why: let C be the centre. A turn of the robot by a about C carries a camera at c to C + R(a) (c - C). Scale by s and
turn by b everything about C: camera, its heading, lines. Rotations about C commute with that, so at every instant all
sights keep their angles to the camera's heading: the bearings do not change. Unseen are therefore the two ways to
slide, seen is at most what both leave alone, the camera's heading relative to the direction C -> camera:
    a line straight on  C at infinity along y: sliding is any shift of the camera; seen is the heading, phi + psi
    a turn on the spot  C = 0: sliding changes phi (with phi + psi) and rho; seen is psi
    a circle            C = (0, R): seen is neither phi, rho, psi nor a sum of them, only eta - arg(c - C)
Two clearly different centres leave no way to slide on both, so all three are seen, if lines are near enough.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from omnivert.angles import wrap
from omnivert.calibration.kalman.model import polar_from_cartesian
from omnivert.calibration.symmetric import evened

Array = NDArray[np.float64]

STRAIGHT = 0.035  # slant up to which a circle is as good as a straight line: 14 times as wide as the robot
ON_THE_SPOT = np.pi / 2.0 - 0.1  # slant from which it is as good as a turn on the spot
ROUGHLY_M = 0.1  # what is known of the camera's place to this is more than noise
APART = 0.17  # slants of clearly different centres
BRIDGE = 1.7  # a Brownian bridge of unit variance exceeds this in 1 of 160 cases


class Kind(StrEnum):
    """Of motion about one centre."""

    STRAIGHT = "straight"
    TURN = "turn"
    CIRCLE = "circle"


class Unseen(StrEnum):
    """What the drive has not shown of the mount to its limits."""

    NOTHING = "nothing"  # all is seen
    PLACE = "place"  # the camera may be anywhere; seen is phi + psi alone
    PHI_AND_RHO = "phi_and_rho"  # seen is psi alone
    SLIDE = "slide_about_centre"  # seen is the camera's heading relative to the direction centre -> camera alone
    PHI_AGAINST_PSI = "phi_against_psi"  # seen are rho and phi + psi
    RHO = "rho"  # seen are phi and psi
    HEADING = "heading"  # seen are phi and rho
    EVERYTHING = "everything"  # no direction is seen


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """How well the drive shows each parameter and what they have in common: sigmas, 100 rad or m when not at all."""

    phi_rad: float
    rho_m: float
    psi_rad: float
    sum_rad: float  # of phi + psi
    to_centre_rad: float  # of the heading relative to the direction centre of rotation -> camera, the place held
    place_m: float  # of the camera's place, where it is known least
    unseen: Unseen
    weakest: Array  # (3,) direction of eta, cx, cy, in units of their limits, of length 1

    @property
    def is_nothing(self) -> bool:
        """Whether what was fitted to the drive is noise: no direction is seen to its limit, nor roughly the place.

        One near line shows a mount long before it shows it to the limits.
        """
        return self.unseen is Unseen.EVERYTHING and not self.place_m < ROUGHLY_M


@dataclass(frozen=True, slots=True)
class Piece:
    """Part of the way with one centre of rotation, as far as the wheels tell."""

    steps: int
    right_m: float
    left_m: float
    way_m: float  # sum of |way|
    turned_rad: float  # sum of |heading change|

    @property
    def slant(self) -> float:
        """Direction in the plane of wheel displacements, mod pi: 0 straight, pi/2 on the spot, alike = same centre."""
        return float(wrap(2.0 * np.arctan2(self.right_m - self.left_m, self.right_m + self.left_m)) / 2.0)

    @property
    def kind(self) -> Kind:
        slant = abs(self.slant)
        return Kind.STRAIGHT if slant < STRAIGHT else Kind.TURN if slant > ON_THE_SPOT else Kind.CIRCLE

    @property
    def centre_m(self) -> Array:
        """(2,) the centre of rotation, robot frame; at infinity for a straight line."""
        radius = {Kind.STRAIGHT: np.inf, Kind.TURN: 0.0}.get(self.kind, self.way_m / max(self.turned_rad, 1e-9))
        return np.array([0.0, radius if self.slant >= 0.0 else -radius])


def pieces(wheels: Array, base: float, noise_k: float, tick_m: float) -> list[Piece]:
    """The way cut where the ratio of the wheels changes by more than their noise explains.

    wheels   (S, 2)  m  right, left displacement of each step
    base             m
    noise_k          m  K
    tick_m           m  one count
    """
    found: list[Piece] = []
    first = 0
    while first < wheels.shape[0]:
        # How far one ratio holds, by doubling and halving: a step at a time would be slow on a long way.
        last, reach = first + 1, 1
        while reach and last < wheels.shape[0]:
            trial = min(last + reach, wheels.shape[0])
            if _one_ratio(wheels[first:trial], noise_k, tick_m):
                last, reach = trial, 2 * reach
            else:
                reach //= 2
        part = wheels[first:last]
        right, left = part.sum(axis=0)
        found.append(
            Piece(
                last - first,
                float(right),
                float(left),
                float(np.abs(part.sum(axis=1)).sum() / 2.0),
                float(np.abs(part[:, 0] - part[:, 1]).sum()) / base,
            )
        )
        first = last
    return found


def covariance_from_information(information: Array) -> Array:
    """Inverse (3, 3) of eta, cx, cy; what nothing is known of gets a sigma of 100 rad or m."""
    return np.asarray(np.linalg.inv(evened(information) + 1e-4 * np.eye(3)), dtype=np.float64)


def larger(first: Array, second: Array) -> Array:
    """The smallest covariance that is at least as large as both in every direction that they share as axes."""
    value, vector = eigh(second, first)
    # first = V^-T V^-1 and second = V^-T diag(value) V^-1
    back = first @ vector
    return np.asarray(back @ np.diag(np.maximum(value, 1.0)) @ back.T)


def centres(found: list[Piece]) -> list[Piece]:
    """The pieces long enough to count, one for each clearly different centre of rotation."""
    kept: list[Piece] = []
    for piece in sorted(found, key=lambda p: -(p.way_m + 0.2 * p.turned_rad)):
        if piece.way_m < 0.25 and piece.turned_rad < np.deg2rad(25.0):
            continue
        if all(abs(wrap(2.0 * (piece.slant - k.slant))) / 2.0 > APART for k in kept):
            kept.append(piece)
    return kept


def seen(information: Array, mount: Array, centres: tuple[Piece, ...], limit_rad: float, limit_m: float) -> Seen:
    """What the information gathered shows.

    information  (3, 3)  on eta, cx, cy, of the nominal way
    mount        (3,)    eta, cx, cy that it was taken at
    centres      clearly different centres of rotation of the drive
    limit_rad, limit_m   a direction is seen when its sigma, in these units, is at most 1
    """
    unit = np.array([limit_rad, limit_m, limit_m])
    information = evened(information)
    value, vector = np.linalg.eigh(unit[:, None] * information * unit)
    covariance = covariance_from_information(information)
    slope = polar_from_cartesian(mount)[1]
    phi, rho, psi = np.sqrt(np.diag(slope @ covariance @ slope.T)).tolist()
    # Its slope by eta is 1 whatever the centre, so with c held it is as well known as eta.
    to_centre = float(1.0 / np.sqrt(max(information[0, 0], 0.0) + 1e-4))
    place = float(np.sqrt(np.linalg.eigvalsh(covariance[1:, 1:])[1]))
    name = _name(value, vector, unit, mount, centres)
    return Seen(phi, rho, psi, float(np.sqrt(covariance[0, 0])), to_centre, place, name, vector[:, 0])


def _name(value: Array, scaled: Array, unit: Array, mount: Array, centres: tuple[Piece, ...]) -> Unseen:
    """From eigenvalues (3,), growing, and eigenvectors (3, 3), columns, of eta, cx, cy in units of the limits."""
    count = int((value >= 1.0).sum())
    if count == 0 or not centres:
        return Unseen.EVERYTHING
    if len(centres) == 1:
        # More than one direction can not be seen: what else the information holds comes from a place too near to C.
        return _BESIDE[centres[0].kind]
    if count == 3:
        return Unseen.NOTHING
    _, cx, cy = mount
    if count == 1:
        closeness = [abs(float(scaled[:, 2] @ _unit(_by_heading(mount, c) * unit))) for c in centres]
        return _BESIDE[centres[int(np.argmax(closeness))].kind]
    open_ways = {
        Unseen.PHI_AGAINST_PSI: np.array([0.0, -cy, cx]),
        Unseen.RHO: np.array([0.0, cx, cy]),
        Unseen.HEADING: np.array([1.0, 0.0, 0.0]),
    }
    return max(open_ways, key=lambda name: abs(float(scaled[:, 0] @ _unit(open_ways[name] / unit))))


_BESIDE = {Kind.STRAIGHT: Unseen.PLACE, Kind.TURN: Unseen.PHI_AND_RHO, Kind.CIRCLE: Unseen.SLIDE}


def _by_heading(mount: Array, piece: Piece) -> Array:
    """Slope of eta - arg(c - C) by eta, cx, cy."""
    if piece.kind is Kind.STRAIGHT:
        return np.array([1.0, 0.0, 0.0])
    x, y = mount[1:] - piece.centre_m
    r2 = max(float(x**2 + y**2), 1e-12)
    return np.array([1.0, y / r2, -x / r2])


def _unit(vector: Array) -> Array:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _one_ratio(wheels: Array, noise_k: float, tick_m: float) -> bool:
    """Whether displacements (S, 2) may be of one ratio right : left throughout."""
    total = wheels.sum(axis=0)
    length = float(np.hypot(*total))
    if length < 1e-9:
        return bool(np.abs(wheels).max() < 4.0 * tick_m)
    direction = total / length
    off = wheels[:, 0] * direction[1] - wheels[:, 1] * direction[0]
    variance = noise_k * (np.abs(wheels[:, 0]) * direction[1] ** 2 + np.abs(wheels[:, 1]) * direction[0] ** 2)
    bound = BRIDGE * np.sqrt(float(variance.sum())) + 3.0 * tick_m
    return bool(np.abs(np.cumsum(off)).max() < bound)
