"""A room with a robot's camera and laser: what both see from a pose at a time. It knows no clock; a seed repeats it."""

from dataclasses import dataclass
from math import cos, radians, sin, tau

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Frame, PixelFormat, Scan
from omnivert.simulation.columns import columns, nearest
from omnivert.simulation.fixtures import built
from omnivert.simulation.mirror import Mirror, level_from_mirror
from omnivert.simulation.panorama import Hall
from omnivert.simulation.picture import Darkroom, Lens, Picture, Standpoint
from omnivert.simulation.place import Place
from omnivert.simulation.surfaces import MOVING, Surfaces, surfaces
from omnivert.simulation.vertical_edges import SeenEdges, Sensor, seen_edges
from omnivert.simulation.walkers import bodies

Array = NDArray[np.float64]

JPEG_QUALITY = 92
FARTHEST_PX = 3.0  # sigmas of vibration: the ring moves no farther
SWING_S = 40.0  # of the exposure
_CENTER, _PICTURE, _LASER = range(3)  # what is drawn by chance for each picture, each from a seed of its own


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A picture before it is taken.

    pose       (3,)  m, m, rad: the robot
    turn_rad_s       how fast it turns meanwhile
    """

    index: int
    time_s: float  # since the start
    pose: Array
    center_px: tuple[float, float]
    stops: float
    turn_rad_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """What camera and laser saw.

    range_m  (N,)  of the laser's beams, to the millimetre; 0: no echo
    """

    shot: Shot
    picture: Picture
    things: Surfaces
    range_m: NDArray[np.float32]

    def frame(self, stamp_ns: int) -> Frame:
        height, width = self.picture.grey.shape
        done, data = cv2.imencode(".jpg", self.picture.grey, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        assert done
        return Frame(stamp_ns, PixelFormat.JPEG, width, height, np.asarray(data, dtype=np.uint8).ravel())

    def scan(self, stamp_ns: int) -> Scan:
        return Scan(stamp_ns, -np.pi, tau / self.range_m.size, self.range_m)


class Stage:
    """
    config  of the robot: picture, ring, sense of the image
    people  how many walk about; None: those of the world. Beyond these the same ways are walked again, later.
    """

    def __init__(self, config: Config, place: Place, seed: int, people: int | None = None) -> None:
        camera = place.camera
        self.place, self.config, self.seed = place, config, seed
        self.room, self.edges = surfaces(*built(place))
        self.mirror = Mirror.fitted(camera.eccentricity, camera.top_deg, config.ring.r_max_px)
        self.mount = (float(wrap(radians(camera.phi_deg))), camera.rho_m, float(wrap(radians(camera.psi_deg))))
        self._lens = Lens(noise_grey=camera.noise_grey)
        self._tilt = radians(camera.tilt_deg), radians(camera.tilt_toward_deg)
        self._darkroom = Darkroom(config, self.mirror, self._lens, self._tilt, FARTHEST_PX * camera.vibration_px)
        above = place.ceiling
        self._hall = Hall(above.high_m, place.floor_brightness, above.brightness, above.lamps_x_m, above.lamps_y_m)
        self._walking = len(place.person) if people is None or not place.person else people

    def shot(self, index: int, time_s: float, pose: Array, turn_rad_s: float) -> Shot:
        """The picture of this number; where its ring lies and how it is exposed."""
        camera, (u, v) = self.place.camera, self.config.ring.center_px
        off = np.clip(self._rng(index, _CENTER).standard_normal(2), -FARTHEST_PX, FARTHEST_PX) * camera.vibration_px
        stops = camera.exposure_stops * sin(tau * time_s / SWING_S)
        return Shot(index, time_s, pose, (u + float(off[0]), v + float(off[1])), stops, turn_rad_s)

    def taken(self, shot: Shot) -> Taken:
        """What there is to see."""
        people = bodies(self.place.person, self._walking, shot.time_s)
        things = self.room.beside(people, MOVING)
        phi, rho, psi = self.mount
        x, y, heading = shot.pose.tolist()
        camera = self.place.camera
        standpoint = Standpoint(
            x + rho * cos(heading + phi),
            y + rho * sin(heading + phi),
            camera.height_m,
            float(wrap(heading + phi + psi)),
            shot.center_px,
            shot.stops,
            abs(shot.turn_rad_s) * camera.shutter_s,
        )
        picture = self._darkroom.developed(things, self._hall, standpoint, self._rng(shot.index, _PICTURE))
        return Taken(shot, picture, things, self._swept(things, x, y, heading, shot.index))

    def edges_in(self, taken: Taken) -> SeenEdges:
        """The truth of a picture's lines, before its noise."""
        ring, picture = self.config.ring, taken.picture
        first = round(ring.r_min_px - picture.inner_px)
        rows = round(ring.r_max_px - ring.r_min_px)
        sensor = Sensor(picture.gain, self._lens.response, first, rows)
        return seen_edges(picture.columns, picture.panorama, taken.things, sensor)

    def image_angle(self, azimuth: Array) -> Array:
        """Where level rays of these azimuths lie on the ring, counter-clockwise on the screen."""
        level = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)])
        x, y, _ = level_from_mirror(*self._tilt).T @ level
        return np.asarray(wrap(self.config.camera.bearing_sign * np.arctan2(y, x)))

    def _swept(self, things: Surfaces, x: float, y: float, heading: float, index: int) -> NDArray[np.float32]:
        laser = self.place.laser
        azimuth: Array = -np.pi + tau / laser.beams * np.arange(laser.beams, dtype=np.float64)
        level = nearest(columns(things.place, things.flat, x, y, heading), things.heights, azimuth, laser.height_m)
        told = level + laser.noise_m * self._rng(index, _LASER).standard_normal(laser.beams)
        heard = (level > 0.0) & (told > 0.0) & (told <= laser.range_m)
        return np.where(heard, np.round(told, 3), 0.0).astype(np.float32)

    def _rng(self, index: int, what: int) -> np.random.Generator:
        return np.random.default_rng((self.seed, index, what))


def with_camera(place: Place, **values: float | None) -> Place:
    """The world with other values of its camera; None: as it was."""
    given = {name: value for name, value in values.items() if value is not None}
    camera = type(place.camera).model_validate({**place.camera.model_dump(), **given})
    return Place.model_validate({**place.model_dump(), "camera": camera.model_dump()})
