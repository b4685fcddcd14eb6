"""A whole drive through a room, offline: the sensors' messages in order, and everything that is true of it."""

import json
from collections.abc import Iterator
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Frame, Message, Scan, Ticks
from omnivert.simulation.route import Route, commanded
from omnivert.simulation.stage import Stage, Taken
from omnivert.simulation.surfaces import MOVING, SILHOUETTES
from omnivert.simulation.vehicle import SAMPLE_S, Vehicle

Array = NDArray[np.float64]

SECOND = 1_000_000_000
LINES = "index,line_id,bearing_rad,image_angle_rad,distance_m,visible_fraction,contrast"
HEADS = {  # of the tables of the truth
    "poses": "index,t_s,x_m,y_m,theta_rad",
    "centers": "index,cu_px,cv_px",
    "exposure": "index,exposure_stops",
    "lines": LINES,
    "nonstatic_lines": LINES,
}


def start_of(stage: Stage, route: Route) -> Array:
    """(3,) m, m, rad: where the robot stands first"""
    x, y, heading = route.start or stage.place.start
    return np.array([x, y, radians(heading)])


class Trip:
    """The drive of a path, in the form in which a drive's folder is written as a recording.

    config  of the robot
    counts  messages by type
    notes   none
    raises  DataError when the path leads into something
    """

    def __init__(self, stage: Stage, route: Route, noise_k_m: float) -> None:
        self.config: Config = stage.config
        self.notes: tuple[str, ...] = ()
        self._stage = stage
        told = commanded(route, self.config.robot.wheel_base_m, SAMPLE_S)
        vehicle = Vehicle(self.config, stage.room, start_of(stage, route), noise_k_m, stage.seed, stage.mount[1])
        self._ticks = [vehicle.counts]
        poses = [vehicle.pose]
        for index, step in enumerate(told):
            vehicle.step(step)
            if vehicle.blocked:
                raise self._in_the_way(vehicle.pose, index * SAMPLE_S)
            self._ticks.append(vehicle.counts)
            poses.append(vehicle.pose)
        self._pose = np.array(poses)
        rate = self.config.camera.frame_rate_hz
        self.frames = int(told.shape[0] * SAMPLE_S * rate + 1e-9) + 1
        self.seconds = told.shape[0] * SAMPLE_S
        self.counts = {"Frame": self.frames, "Ticks": len(self._ticks), "Scan": self.frames}
        self._rows: dict[str, list[str]] = {name: [] for name in HEADS}

    def messages(self) -> Iterator[Message]:
        """Everything in order of stamp; at equal stamps ticks, then scans, then frames."""
        self._rows = {name: [] for name in HEADS}
        sent = 0
        for index in range(self.frames):
            time_s = index / self.config.camera.frame_rate_hz
            stamp = round(time_s * SECOND)
            while sent < len(self._ticks) and round(sent * SAMPLE_S * SECOND) <= stamp:
                yield self._ticks_at(sent)
                sent += 1
            scan, frame = self._taken(index, time_s, stamp)
            yield scan
            yield frame
        for late in range(sent, len(self._ticks)):
            yield self._ticks_at(late)

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """meta.json and the truth, in order of name; of the pictures that `messages` has given."""
        yield "meta.json", _json(self._meta())
        tables = {f"truth/{name}.csv": [HEADS[name], *rows] for name, rows in self._rows.items()}
        tables["truth/edges_world.csv"] = ["line_id,x_m,y_m,z_min_m,z_max_m,kind", *self._world()]
        phi, rho, psi = self._stage.mount
        files = {name: ("\n".join(rows) + "\n").encode() for name, rows in tables.items()}
        files["truth/extrinsics.json"] = _json({"phi_rad": phi, "rho_m": rho, "psi_rad": psi})
        yield from sorted(files.items())

    def _taken(self, index: int, time_s: float, stamp: int) -> tuple[Scan, Frame]:
        sample = min(int(time_s / SAMPLE_S + 1e-9), len(self._pose) - 2) if len(self._pose) > 1 else 0
        before, after = self._pose[sample], self._pose[min(sample + 1, len(self._pose) - 1)]
        share = time_s / SAMPLE_S - sample
        pose = before + share * (after - before)
        taken = self._stage.taken(self._stage.shot(index, time_s, pose, (after[2] - before[2]) / SAMPLE_S))
        self._note_truth(taken)
        return taken.scan(stamp), taken.frame(stamp)

    def _note_truth(self, taken: Taken) -> None:
        shot, rows = taken.shot, self._rows
        x, y, heading = shot.pose.tolist()
        rows["poses"].append(f"{shot.index},{shot.time_s:.9f},{x:.9f},{y:.9f},{heading:.9f}")
        rows["centers"].append(f"{shot.index},{shot.center_px[0]:.6f},{shot.center_px[1]:.6f}")
        rows["exposure"].append(f"{shot.index},{shot.stops:.6f}")
        seen = self._stage.edges_in(taken)
        angle = self._stage.image_angle(seen.azimuth)
        for line, *numbers in zip(seen.line.tolist(), seen.azimuth, angle, *seen[2:], strict=True):
            bearing, image, distance, fraction, contrast = numbers
            table = rows["lines" if line < SILHOUETTES else "nonstatic_lines"]
            table.append(f"{shot.index},{line},{bearing:.7f},{image:.7f},{distance:.4f},{fraction:.4f},{contrast:.2f}")

    def _ticks_at(self, sample: int) -> Ticks:
        counts = self._ticks[sample]
        return Ticks(round(sample * SAMPLE_S * SECOND), counts.left, counts.right)

    def _world(self) -> list[str]:
        return [f"{e.line_id},{e.x_m:.5f},{e.y_m:.5f},{e.low_m:.4f},{e.high_m:.4f},{e.kind}" for e in self._stage.edges]

    def _meta(self) -> dict[str, object]:
        config, place, mirror = self.config, self._stage.place, self._stage.mirror
        ring, laser = config.ring, place.laser
        return {
            "image": {"width": config.camera.width_px, "height": config.camera.height_px},
            "ring": {"center_px": list(ring.center_px), "r_min_px": ring.r_min_px, "r_max_px": ring.r_max_px},
            "bearing_sign": config.camera.bearing_sign,
            "robot": {
                "wheel_base_m": config.robot.wheel_base_m,
                "wheel_diameter_m": config.encoder.wheel_diameter_m,
                "ticks_per_rev": config.encoder.ticks_per_rev,
            },
            "frame_rate_hz": config.camera.frame_rate_hz,
            "mirror": {
                "formula": "r_px = K*cos(e)/(xi - sin(e)); e = elevation above the horizon",
                "K_px": mirror.k_px,
                "xi": mirror.xi,
                "r_horizon_px": mirror.k_px / mirror.xi,
            },
            "camera_height_m": place.camera.height_m,
            "laser": {
                "x": 0.0,
                "y": 0.0,
                "yaw": 0.0,
                "z": laser.height_m,
                "angle_min": -np.pi,
                "angle_increment": 2.0 * np.pi / laser.beams,
                "n": laser.beams,
                "range_max": laser.range_m,
                "invalid": 0.0,
            },
            "seed": self._stage.seed,
            "moving_from_line_id": MOVING,
        }

    def _in_the_way(self, pose: Array, time_s: float) -> DataError:
        x, y, heading = pose.tolist()
        where = f"at x = {x:.2f} m, y = {y:.2f} m, heading {degrees(heading):.0f} deg, after {time_s:.1f} s"
        return DataError("OV213", "the path leads into something", where, "begin it elsewhere: start = [x, y, degrees]")


def _json(value: object) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()
