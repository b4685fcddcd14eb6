"""A hyperbolic mirror above a camera that looks up at its focus: where a direction appears, and what a pixel sees.

With the eccentricity eps of the hyperboloid, xi = 2 eps / (1 + eps^2), a ray of elevation e appears at the radius
r = K cos(e) / (xi - sin(e)): every ray passes the mirror's focus (a single viewpoint), and azimuth stays azimuth.
"""

from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.config import Config

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Mirror:
    """A mirror in a picture.

    k_px  scale, K
    xi    form of the hyperboloid, 0 to 1; 1 is a paraboloid
    """

    k_px: float
    xi: float

    @classmethod
    def fitted(cls, eccentricity: float, top_deg: float, rim_px: float) -> "Mirror":
        """The mirror of this form whose rim, at this radius, shows this elevation."""
        xi, top = 2.0 * eccentricity / (1.0 + eccentricity**2), radians(top_deg)
        return cls(rim_px * (xi - sin(top)) / cos(top), xi)

    def radius(self, elevation: Array) -> Array:
        """px, where rays of these elevations (rad) appear"""
        return np.asarray(self.k_px * np.cos(elevation) / (self.xi - np.sin(elevation)))

    def elevation(self, radius: Array) -> Array:
        """rad, of the rays that appear at these radii (px): K cos(e) + r sin(e) = r xi, solved for e"""
        return np.asarray(np.arcsin(self.xi * radius / np.hypot(self.k_px, radius)) - np.arctan2(self.k_px, radius))


@compiled
def seen_by(
    u: Array,
    v: Array,
    center_u: float,
    center_v: float,
    sign: float,
    k: float,
    xi: float,
    tilt: Array,
    azimuth: Array,
    radius: Array,
    own: Array,
) -> None:
    """What each pixel sees: its direction, told as azimuth and as the radius that this elevation has without tilt.

    u, v        (N,)    px
    sign                +1: the image angle, counter-clockwise on the screen, grows with the azimuth; -1: it falls
    k, xi               of the mirror
    tilt        (3, 3)  level_from_mirror: turns a ray of the mirror's frame into the frame whose z axis is vertical
    azimuth     (N,)    rad, -pi to pi, is written
    radius      (N,)    px, is written
    own         (N,)    px, the pixel's own radius, is written
    """
    level = tilt[2, 2] == 1.0
    for i in range(u.size):
        x, y = u[i] - center_u, sign * (center_v - v[i])
        r = np.hypot(x, y)
        own[i] = r
        if level:
            azimuth[i], radius[i] = np.arctan2(y, x), r
            continue
        elevation = np.arcsin(xi * r / np.hypot(k, r)) - np.arctan2(k, r)
        c = np.cos(elevation) / max(r, 1e-9)
        x, y, z = c * x, c * y, np.sin(elevation)
        a = tilt[0, 0] * x + tilt[0, 1] * y + tilt[0, 2] * z
        b = tilt[1, 0] * x + tilt[1, 1] * y + tilt[1, 2] * z
        s = tilt[2, 0] * x + tilt[2, 1] * y + tilt[2, 2] * z
        azimuth[i] = np.arctan2(b, a)
        radius[i] = k * np.sqrt(max(1.0 - s * s, 0.0)) / (xi - s)


def level_from_mirror(tilt_rad: float, toward_rad: float) -> Array:
    """(3, 3) rotation for a mirror whose axis leans by `tilt_rad` toward an azimuth: about the level axis beside it."""
    c, s = cos(tilt_rad), sin(tilt_rad)
    if tilt_rad == 0.0:
        return np.eye(3)
    to = np.array([[cos(toward_rad), -sin(toward_rad), 0.0], [sin(toward_rad), cos(toward_rad), 0.0], [0.0, 0.0, 1.0]])
    lean = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray(to @ lean @ to.T)


def ring_pixels(config: Config, margin_px: float) -> tuple[Array, Array]:
    """u and v of the pixels that may show the world, row by row, when the ring moves by no more than a margin."""
    ring, camera = config.ring, config.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    r = np.hypot(u - ring.center_px[0], v - ring.center_px[1])
    seen = (r > ring.r_min_px - margin_px - 1.0) & (r < ring.r_max_px + margin_px + 1.0)
    return u[seen].astype(np.float64), v[seen].astype(np.float64)
