"""The posterior Cramér-Rao bound of a synthetic drive: what no estimator can do better.

Written from the geometry alone and on purpose without `omnivert.calibration`, so that one checks the other.

The unknowns are the mount, every line, every wheel displacement, and where asked time offset, wheel ratio and base. The
noise of one wheel sample moves all that comes later as one rigid body, about the middle m of that sample's chord. In
world coordinates that is a twist eta = (a, delta): a pose at p, later on, goes to p + a + perp(p) delta and turns by
delta, with perp(x, y) = (-y, x). A twist does not depend on the later pose, so the twists of all samples between two
frames add up, and one 3 x 3 covariance an interval says all that is known of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.messages import Bearings
from omnivert.odometry import after, arc
from omnivert.simulation.recording import Drive

Array = NDArray[np.float64]

MOUNT = ("phi", "rho", "psi")  # rad, m, rad
CORRECTIONS = ("time_offset", "wheel_ratio", "wheel_base")  # s, right / left, true / configured
WEAK = (
    10.0  # sigma of a prior on each of these, in its unit: so what is not seen has a large sigma, and none is infinite
)


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """The least covariance that an unbiased estimate from this drive can have."""

    names: tuple[str, ...]  # phi, rho, psi and the corrections that are unknown
    covariance: Array  # (n, n)

    @property
    def mount(self) -> Array:
        """(3, 3) phi, rho, psi."""
        return self.covariance[:3, :3]

    def std(self, name: str) -> float:
        return float(np.sqrt(self.covariance[self.names.index(name), self.names.index(name)]))


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """How each bearing changes with what it depends on; N bearings, divided by their sigma."""

    at: Array  # (F, 3) poses of the frames
    frame: NDArray[np.int64]  # (N,)
    track: NDArray[np.int64]  # (N,)
    std: Array  # (N,) rad
    pose: Array  # (N, 3) x, y, heading of the robot at the frame
    line: Array  # (N, 2) x, y of the line
    mount: Array  # (N, 3) phi, rho, psi


def bound_of(
    drive: Drive, config: Config, free: tuple[str, ...] = (), nominal: bool = False, until_s: float = np.inf
) -> Bound:
    """The bound of what the bearings of real lines and the wheels tell together.

    free     corrections that are unknown, too
    nominal  at the motion that the encoders tell, which has no noise in it: at the true motion the wheels' noise counts
             as excitation, which no estimator can use (at a fixed centre of rotation it is all the excitation there is)
    until_s  only pictures taken before; a drive with a knock counts up to it
    """
    names = tuple(name for name in CORRECTIONS if name in free)
    knock = drive.scene.knock
    until = until_s if knock is None else min(until_s, knock.at_s)
    samples = _nominal_pose(drive, config) if nominal else drive.sample_pose
    slopes, covariance, shifts = _until(drive, config, samples, until)
    direct = np.stack([shifts[name] for name in names], axis=-1) if names else np.zeros((*slopes.at.shape, 0))
    outer = np.concatenate([slopes.mount, np.einsum("ni,nik->nk", slopes.pose, direct[slopes.frame])], axis=1)
    return Bound((*MOUNT, *names), _inverse(_information(slopes, outer, covariance)))


def knock_bound(drive: Drive, config: Config, until_s: float) -> Array:
    """The least covariance (3, 3) of a knock, in yaw (rad), forward and to the left (m), for who knows when it came.

    Mount and lines are unknown as ever. What is seen before until_s counts; the knock's own size is small enough not
    to change how the bearings depend on it.
    """
    assert drive.scene.knock is not None
    slopes, covariance, _ = _until(drive, config, _nominal_pose(drive, config), until_s)
    heading = slopes.at[slopes.frame, 2]
    by_place, std = slopes.pose[:, :2], slopes.std
    out = np.column_stack([np.cos(heading), np.sin(heading)])
    side = np.column_stack([-out[:, 1], out[:, 0]])
    jump = np.column_stack([-1.0 / std, (by_place * out).sum(axis=1), (by_place * side).sum(axis=1)])
    jump[drive.time_s[slopes.frame] < drive.scene.knock.at_s] = 0.0
    information = _information(slopes, np.concatenate([slopes.mount, jump], axis=1), covariance)
    return _inverse(information)[3:, 3:]


def _until(drive: Drive, config: Config, samples: Array, until_s: float) -> tuple["Slopes", Array, dict[str, Array]]:
    """Slopes of all pictures before a time with the robot on this way, and what the wheels leave open between them."""
    frames = drive.time_s[drive.time_s < until_s]
    pose = np.stack([np.interp(frames, drive.sample_time_s, samples[:, k]) for k in range(3)], axis=1)
    return slopes_of(drive, pose), *_wheels(drive, config, samples, frames, pose)


def _inverse(information: Array) -> Array:
    weak = information + np.eye(information.shape[0]) / WEAK**2
    return np.asarray(np.linalg.inv(weak), dtype=np.float64)


def slopes_of(drive: Drive, pose: Array) -> Slopes:
    """The inliers' slopes with the robot at these poses.

    pose  (F, 3)  one for each of the first F frames
    """
    messages = [m for m in drive.messages if isinstance(m, Bearings)][: pose.shape[0]]
    frame = np.concatenate([np.full(good.sum(), k) for k, good in enumerate(drive.inlier[: pose.shape[0]])])
    track = np.concatenate([m.track_id[good] for m, good in zip(messages, drive.inlier, strict=False)])
    std = np.concatenate([m.std_rad[good] for m, good in zip(messages, drive.inlier, strict=False)])
    if not track.size:
        empty = np.zeros((0, 3))
        return Slopes(pose, frame.astype(np.int64), track, std, empty, empty[:, :2], empty)
    line = np.array([drive.line_of_track[k] for k in track.tolist()])
    phi, rho, _ = drive.mount
    along = pose[frame, 2] + phi
    out = np.stack([np.cos(along), np.sin(along)], axis=1)
    side = np.stack([-out[:, 1], out[:, 0]], axis=1)
    sight = line - pose[frame, :2] - rho * out
    turn = np.stack([-sight[:, 1], sight[:, 0]], axis=1) / (sight**2).sum(axis=1)[:, None]  # d beta / d line
    by_heading = -rho * (turn * side).sum(axis=1) - 1.0
    return Slopes(
        pose,
        frame.astype(np.int64),
        track,
        std,
        np.column_stack([-turn, by_heading]) / std[:, None],
        turn / std[:, None],
        np.column_stack([by_heading, -(turn * out).sum(axis=1), np.full(frame.size, -1.0)]) / std[:, None],
    )


def twists(before: Array, wheels: Array, base: float) -> Array:
    """The twist about the world's origin that a small displacement of each wheel adds to a sample.

    before   (S, 3)     pose before the sample
    wheels   (S, 2)  m  what the right and the left wheel rolled in it
    base             m
    returns  (S, 3, 2)  per metre of the right and of the left wheel
    """
    step = arc(wheels[:, 0], wheels[:, 1], base)
    along = before[:, 2] + 0.5 * step[:, 2]
    middle = before[:, :2] + 0.5 * np.hypot(step[:, 0], step[:, 1])[:, None] * np.where(
        wheels.sum(axis=1) < 0.0, -1.0, 1.0
    )[:, None] * np.column_stack([np.cos(along), np.sin(along)])
    found = np.empty((wheels.shape[0], 3, 2))
    for side, sign in enumerate((1.0, -1.0)):
        delta = sign / base
        found[:, 0, side] = 0.5 * np.cos(along) + middle[:, 1] * delta
        found[:, 1, side] = 0.5 * np.sin(along) - middle[:, 0] * delta
        found[:, 2, side] = delta
    return found


def _nominal_pose(drive: Drive, config: Config) -> Array:
    """(S, 3) dead reckoning from what the encoders tell, with the true wheels."""
    told = np.diff(drive.sample_wheels_m, axis=0) * wheel_slopes(drive.scene.wheel_ratio)[0]
    base = config.robot.wheel_base_m * drive.scene.base_factor
    pose = np.zeros((told.shape[0] + 1, 3))
    for i, step in enumerate(arc(told[:, 0], told[:, 1], base)):
        pose[i + 1] = after(pose[i], step)
    return pose


def wheel_slopes(ratio: float) -> tuple[Array, Array]:
    """True over told displacement of the right and the left wheel, (2,), and its slope by the ratio, (2,).

    The mean of both wheels is what is configured: bearings do not show it.
    """
    return (
        np.array([2.0 * ratio, 2.0]) / (1.0 + ratio),
        np.array([2.0, -2.0]) / (1.0 + ratio) ** 2,
    )


def _wheels(drive: Drive, config: Config, samples: Array, frames: Array, pose: Array) -> tuple[Array, dict[str, Array]]:
    """What the wheels leave open.

    returns  (F - 1, 3, 3) covariance of the twist between frames, and for each correction (F, 3) how the pose at each
             frame changes with it. Both go by what the encoders tell, which no noise has touched: with the true speed,
             the offset would be seen by the wheels' noise.
    """
    told = np.diff(drive.sample_wheels_m, axis=0)
    base = config.robot.wheel_base_m * drive.scene.base_factor
    factor, slope = wheel_slopes(drive.scene.wheel_ratio)
    spread = twists(samples[:-1], told * factor, base)
    variance = config.encoder.noise_k_m * np.abs(told)
    each = np.einsum("sik,sk,sjk->sij", spread, variance, spread)
    added = {"wheel_ratio": np.einsum("sik,sk->si", spread, told * slope)}
    turned = (told * factor) @ np.array([1.0, -1.0]) / base
    # A larger base turns less, about the same middle: the twist of a turn alone.
    alone = 0.5 * (spread[:, :, 0] - spread[:, :, 1]) * base
    added["wheel_base"] = -alone * (turned / drive.scene.base_factor)[:, None]
    at = np.searchsorted(drive.sample_time_s, frames, side="right") - 1
    at = np.clip(at, 0, told.shape[0] - 1)
    share = (frames - drive.sample_time_s[at]) / (drive.sample_time_s[at + 1] - drive.sample_time_s[at])

    def until(values: Array) -> Array:
        """Sum of the samples before each frame; of the one that the frame lies in, its part."""
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(total[at] + part * values[at])

    shifts = {name: _carried(until(values), pose) for name, values in added.items()}
    seconds = np.diff(drive.sample_time_s)[at]
    speed = (told * factor)[at].mean(axis=1) / seconds
    # A stamp that is late by more means that the picture was taken earlier.
    shifts["time_offset"] = -np.column_stack(
        [speed * np.cos(pose[:, 2]), speed * np.sin(pose[:, 2]), turned[at] / seconds]
    )
    return np.diff(until(each), axis=0), shifts


def _carried(twist: Array, pose: Array) -> Array:
    """Twists about the origin (F, 3), as changes of the poses (F, 3)."""
    return np.column_stack(
        [twist[:, 0] - pose[:, 1] * twist[:, 2], twist[:, 1] + pose[:, 0] * twist[:, 2], twist[:, 2]]
    )


def _information(slopes: Slopes, outer: Array, covariance: Array) -> Array:
    """(n, n) of the outer unknowns: lines, then wheels are eliminated (Schur).

    outer       (N, n)        slope of each bearing by mount and corrections
    covariance  (F - 1, 3, 3) of the twist between frames
    """
    count, n = covariance.shape[0] + 1, outer.shape[1]
    # By the twist up to its frame: the pose's slope carried to the world's origin.
    x, y = slopes.at[slopes.frame, 0], slopes.at[slopes.frame, 1]
    twist = slopes.pose.copy()
    twist[:, 2] += slopes.pose[:, 1] * x - slopes.pose[:, 0] * y
    among = np.zeros((3 * count, 3 * count))
    across = np.zeros((3 * count, n))
    own = np.zeros((n, n))
    for track in np.unique(slopes.track):
        rows = np.flatnonzero(slopes.track == track)
        left, size, _ = np.linalg.svd(slopes.line[rows], full_matrices=False)
        left = left[:, size > 1e-9 * size[0]]
        blocks = np.zeros((rows.size, 3 * rows.size))
        for k, row in enumerate(rows):
            blocks[k, 3 * k : 3 * k + 3] = twist[row]
        blocks -= left @ (left.T @ blocks)  # what the line's own place can not explain
        rest = outer[rows] - left @ (left.T @ outer[rows])
        where = (3 * slopes.frame[rows][:, None] + np.arange(3)).ravel()
        among[np.ix_(where, where)] += blocks.T @ blocks
        across[where] += blocks.T @ rest
        own += rest.T @ rest
    if count < 2:
        return own
    # The twist up to a frame is the sum of those of all intervals before, each by three numbers of variance one. No
    # covariance is inverted: a wheel that stands has none.
    value, axis = np.linalg.eigh(covariance)
    root = axis * np.sqrt(np.maximum(value, 0.0))[:, None, :]
    summed = among.reshape(count, 3, count, 3)[::-1, :, ::-1].cumsum(axis=0).cumsum(axis=2)[::-1, :, ::-1][1:, :, 1:]
    half = np.einsum("kia,kilj->kalj", root, summed)
    wheels = np.einsum("kalj,ljb->kalb", half, root).reshape(3 * count - 3, 3 * count - 3)
    tied = across.reshape(count, 3, n)[::-1].cumsum(axis=0)[::-1][1:]
    tied = np.einsum("kia,kin->kan", root, tied).reshape(-1, n)
    wheels[np.diag_indices_from(wheels)] += 1.0
    return np.asarray(own - tied.T @ np.linalg.solve(wheels, tied))
