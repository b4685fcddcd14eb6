"""A whole synthetic drive as messages, with its exact truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Ticks
from omnivert.simulation import robot, world

Array = NDArray[np.float64]
SECOND = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Knock:
    """Somebody hits the camera: from `at_s` on it sits elsewhere."""

    at_s: float  # since the start of the drive, by the time of the picture
    yaw_rad: float = 0.0  # turn of the camera about its own axis, counter-clockwise: phi + psi grows by it
    forward_m: float = 0.0  # shift along the robot's x axis
    left_m: float = 0.0  # shift along the robot's y axis

    def moved(self, mount: Array) -> Array:
        """phi, rho, psi after it, from those before."""
        phi, rho, psi = mount.tolist()
        x, y = rho * np.cos(phi) + self.forward_m, rho * np.sin(phi) + self.left_m
        after = float(np.arctan2(y, x))
        return np.array([after, np.hypot(x, y), wrap(phi + psi + self.yaw_rad - after)])


@dataclass(frozen=True, slots=True)
class Scene:
    """What can be varied. The defaults are a careful robot in a room, filmed three times a second."""

    path: robot.Path = "alternate"
    mount: tuple[float, float, float] | None = None  # phi, rho, psi; None: anything, rho 0.08 to 0.40 m
    bearing_std_rad: float = 0.003
    outliers: float = 0.05  # share of bearings that point anywhere
    visible: float = 10.0  # lines seen in a frame, on average
    lines: int | None = None  # in the world; None: three times as many as are seen
    lasting: bool = False  # lines neither die nor leave
    distance_scale: float = 1.0  # makes all lines far
    frame_s: float = 1.0 / 3.0
    sample_s: float = 0.0196
    radius_m: float = 0.5  # of path "arc"
    repeat: int = 1  # times the path is driven
    time_offset_s: float = 0.0  # the camera stamps late by this: a message carries t + offset, its picture shows t
    wheel_ratio: float = 1.0  # right diameter / left diameter of the true wheels; the encoders take them as equal
    base_factor: float = 1.0  # true wheel base / configured one
    knock: Knock | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    messages: tuple[Ticks | Bearings, ...]  # by stamp
    mount: Array  # (3,) phi, rho, psi; before the knock, where there is one
    pose: Array  # (F, 3) the robot at each frame
    line_of_track: dict[int, Array]  # track -> (2,) m
    inlier: tuple[NDArray[np.bool_], ...]  # by frame, beside its bearings
    scene: Scene
    time_s: Array  # (F,) when each picture was really taken
    sample_time_s: Array  # (S,) of the encoder samples
    sample_wheels_m: Array  # (S, 2) right, left, cumulative, as told by the encoders before rounding to counts
    sample_pose: Array  # (S, 3) the robot at each sample
    mount_at: Array  # (F, 3) phi, rho, psi at each frame


def recorded(scene: Scene, config: Config, seed: int) -> Drive:
    """The messages that bridge and vision would have sent."""
    rng = np.random.default_rng(seed)
    scale = config.encoder.metres_per_tick
    mount = np.array(scene.mount or (rng.uniform(-np.pi, np.pi), rng.uniform(0.08, 0.40), rng.uniform(-np.pi, np.pi)))
    trip = robot.drive(
        scene.path,
        config.robot.wheel_base_m,
        config.encoder.noise_k_m,
        scene.sample_s,
        rng,
        scene.radius_m,
        scene.repeat,
        scene.wheel_ratio,
        scene.base_factor,
    )
    # Every stamp lies within those of the encoders, whichever way the camera's clock is off.
    offset = scene.time_offset_s
    time = np.arange(max(0.0, -offset), trip.time_s[-1] - max(0.0, offset), scene.frame_s)
    pose = np.stack([np.interp(time, trip.time_s, trip.pose[:, k]) for k in range(3)], axis=1)
    count = int(3 * scene.visible) if scene.lines is None else scene.lines
    lines = world.lines_beside(trip.pose[:, :2], count, rng)
    if scene.lasting:
        seen = np.ones((time.size, count), dtype=np.bool_)
    else:
        seen = world.seen_lines(lines, pose[:, :2], scene.visible, rng)
    lines = lines * scene.distance_scale
    track = _tracks(seen)
    messages: list[Ticks | Bearings] = [
        Ticks(round(t * SECOND), round(left / scale), round(right / scale))
        for t, (right, left) in zip(trip.time_s.tolist(), trip.wheels_m.tolist(), strict=True)
    ]
    inlier = []
    mounts = np.tile(mount, (time.size, 1))
    if scene.knock is not None:
        mounts[time >= scene.knock.at_s] = scene.knock.moved(mount)
    for frame, t in enumerate(time.tolist()):
        x, y, heading = pose[frame]
        phi, rho, psi = mounts[frame]
        camera = np.array([x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi)])
        index = np.flatnonzero(seen[frame])
        sight = lines[index] - camera
        beta = np.arctan2(sight[:, 1], sight[:, 0]) - heading - phi - psi
        beta = beta + scene.bearing_std_rad * rng.standard_normal(index.size)
        good = rng.random(index.size) >= scene.outliers
        beta = np.where(good, beta, rng.uniform(-np.pi, np.pi, index.size))
        inlier.append(good)
        messages.append(
            Bearings(
                stamp_ns=round((t + offset) * SECOND),
                track_id=track[frame, index],
                bearing_rad=wrap(beta),
                std_rad=np.full(index.size, scene.bearing_std_rad),
                age_frames=np.zeros(index.size, dtype=np.int32),
                strength=np.ones(index.size, dtype=np.float32),
            )
        )
    messages.sort(key=lambda m: (m.stamp_ns, isinstance(m, Bearings)))
    place = {int(k): lines[j] for j in range(count) for k in np.unique(track[seen[:, j], j])}
    mounts[:, [0, 2]] = wrap(mounts[:, [0, 2]])
    return Drive(
        messages=tuple(messages),
        mount=np.array([wrap(mount[0]), mount[1], wrap(mount[2])]),
        pose=pose,
        line_of_track=place,
        inlier=tuple(inlier),
        scene=scene,
        time_s=time,
        sample_time_s=trip.time_s,
        sample_wheels_m=trip.wheels_m,
        sample_pose=trip.pose,
        mount_at=mounts,
    )


def _tracks(seen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Identities (F, L): a line that stays unseen for more than three frames comes back as a new one."""
    track = np.full(seen.shape, -1, dtype=np.int64)
    fresh = 0
    for line in range(seen.shape[1]):
        last = -100
        for frame in np.flatnonzero(seen[:, line]):
            if frame - last > 4:
                fresh += 1
            track[frame, line] = fresh
            last = int(frame)
    return track
