"""The panorama through the mirror into a picture, as a camera with a lens, an exposure and noise takes it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.compiled import compiled
from omnivert.config import Config
from omnivert.simulation.columns import FULL, GRID, Columns, columns
from omnivert.simulation.mirror import Mirror, level_from_mirror, ring_pixels, seen_by
from omnivert.simulation.panorama import Hall, Light, Panorama, View, panorama
from omnivert.simulation.surfaces import Surfaces
from omnivert.simulation.tiles import tiles

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Grey = NDArray[np.uint8]

OUTSIDE = 0.002  # light beyond the rim
DISC = (0.012, 0.035)  # and of the camera's own image in the mirror, in rings
DISC_RINGS = (0.33, 0.40, 0.52, 0.60, 0.80, 0.92)  # of the inner radius: where the disc changes from one to the other


@dataclass(frozen=True, slots=True)
class Lens:
    """What is between the light and the picture.

    response   grey = 255 (exposure * light) ^ response
    """

    blur_px: float = 1.5  # width over which light is smeared
    response: float = 0.5
    exposure: float = 0.62
    noise_grey: float = 2.0  # sigma


@dataclass(frozen=True, slots=True)
class Standpoint:
    """Where the camera is, and how its picture lies, when it is taken."""

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float  # of its x axis
    center_px: tuple[float, float]
    stops: float = 0.0  # exposure beyond the usual one, as a power of two
    swept_rad: float = 0.0  # that the camera turns while the shutter is open


class Darkroom:
    """Makes the pictures of one camera; what each pixel sees is worked out once, as long as the ring stands still.

    tilt  (leaning, rad, toward which azimuth, rad) of the mirror's axis
    """

    def __init__(self, config: Config, mirror: Mirror, lens: Lens, tilt: tuple[float, float], margin_px: float) -> None:
        ring, camera = config.ring, config.camera
        self._config, self._mirror, self._lens = config, mirror, lens
        self._tilt = level_from_mirror(*tilt)
        self._u, self._v = ring_pixels(config, margin_px)
        self._index = (self._v * camera.width_px + self._u).astype(np.int64)
        self._azimuth, self._radius, self._own = (np.empty(self._u.size) for _ in range(3))
        self._center: tuple[float, float] | None = None
        lean = abs(tilt[0])
        reach = mirror.radius(mirror.elevation(np.array([ring.r_min_px, ring.r_max_px])) + np.array([-lean, lean]))
        self._inner_px = float(np.floor(reach[0]) - 3.0)
        self._rows = int(np.ceil(reach[1]) + 3.0 - self._inner_px)
        self._tiles = tiles()

    def developed(self, things: Surfaces, hall: Hall, at: Standpoint, rng: np.random.Generator) -> "Picture":
        """The picture from a place; its noise is drawn from `rng`."""
        view = View(
            at.x_m, at.y_m, at.z_m, at.heading_rad, self._mirror.k_px, self._mirror.xi, self._inner_px, self._rows
        )
        around = columns(things.place, things.flat, at.x_m, at.y_m, at.heading_rad)
        seen = panorama(around, things, self._tiles, hall, view)
        camera, ring, lens = self._config.camera, self._config.ring, self._lens
        self._look(at.center_px)
        light = self._background(at.center_px)
        _expose(
            self._index,
            self._azimuth,
            self._radius - self._inner_px,
            self._own,
            around,
            seen,
            ring.r_min_px,
            ring.r_max_px,
            lens.blur_px,
            at.swept_rad,
            light,
        )
        gain = lens.exposure * 2.0**at.stops
        noise = rng.standard_normal(light.size, dtype=np.float32)
        grey = _sensed(light, gain, lens.response, lens.noise_grey, noise)
        return Picture(grey.reshape(camera.height_px, camera.width_px), around, seen, self._inner_px, gain)

    def _look(self, center: tuple[float, float]) -> None:
        if center != self._center:
            self._center = center
            sign, mirror = float(self._config.camera.bearing_sign), self._mirror
            seen_by(
                self._u,
                self._v,
                *center,
                sign,
                mirror.k_px,
                mirror.xi,
                self._tilt,
                self._azimuth,
                self._radius,
                self._own,
            )

    def _background(self, center: tuple[float, float]) -> Light:
        """Darkness beyond the rim, and the camera's own image in the middle."""
        camera, ring = self._config.camera, self._config.ring
        light = np.full(camera.width_px * camera.height_px, OUTSIDE, dtype=np.float32)
        _draw_disc(light, camera.width_px, camera.height_px, *center, ring.r_min_px)
        return light


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What the camera took, and what it looked at.

    grey      (H, W)
    inner_px  radius at which the panorama's rows begin
    gain      from light to exposure
    """

    grey: Grey
    columns: Columns
    panorama: Panorama
    inner_px: float
    gain: float


@compiled
def _draw_disc(light: Light, width: int, height: int, center_u: float, center_v: float, radius: float) -> None:
    for v in range(max(int(center_v - radius) - 1, 0), min(int(center_v + radius) + 2, height)):
        for u in range(max(int(center_u - radius) - 1, 0), min(int(center_u + radius) + 2, width)):
            r = np.hypot(u - center_u, v - center_v)
            value = DISC[0]
            for ring in range(0, len(DISC_RINGS), 2):
                inside = min(max(r - DISC_RINGS[ring] * radius + 0.5, 0.0), 1.0)
                outside = min(max(r - DISC_RINGS[ring + 1] * radius + 0.5, 0.0), 1.0)
                value += (DISC[1] - DISC[0]) * (inside - outside)
            share = min(max(radius - r + 0.5, 0.0), 1.0)
            at = v * width + u
            light[at] = share * value + (1.0 - share) * light[at]


@compiled
def _expose(
    index: Ints,
    azimuth: Array,
    row: Array,
    own: Array,
    around: Columns,
    seen: Panorama,
    inner: float,
    outer: float,
    blur: float,
    swept: float,
    light: Light,
) -> None:
    """Adds to each pixel of the ring the mean of the light over what it sees; pixels at its borders have a share of it.

    index         (N,)  pixel
    azimuth, row  (N,)  what it sees: rad; rows of the panorama
    own           (N,)  px from the ring's centre
    """
    rows = seen.light.shape[1]
    for n in range(index.size):
        share = min(max(own[n] - inner + 0.5, 0.0), 1.0) * min(max(outer - own[n] + 0.5, 0.0), 1.0)
        if share <= 0.0:
            continue
        at = min(max(row[n] - 0.5, 0.0), rows - 1.001)
        i = int(at)
        f = at - i
        half = 0.5 * (blur / own[n] + swept)
        low, high = azimuth[n] - half, azimuth[n] + half
        if low < -np.pi:
            value = _upto(around, seen, high, i, f) + _all(seen, i, f) - _upto(around, seen, low + FULL, i, f)
        elif high >= np.pi:
            value = _upto(around, seen, high - FULL, i, f) + _all(seen, i, f) - _upto(around, seen, low, i, f)
        else:
            value = _upto(around, seen, high, i, f) - _upto(around, seen, low, i, f)
        light[index[n]] = share * value / (high - low) + (1.0 - share) * light[index[n]]


@compiled
def _upto(around: Columns, seen: Panorama, azimuth: float, i: int, f: float) -> float:
    """Integral of the light from -pi to an azimuth, between the rows i and i + 1."""
    cell = min(max(int((azimuth + np.pi) * (GRID / FULL)), 0), GRID - 1)
    c = around.first[cell]
    while c + 1 < around.held.size and around.bounds[c + 1] <= azimuth:
        c += 1
    into = azimuth - around.bounds[c]
    low = seen.summed[c, i] + into * seen.light[c, i]
    high = seen.summed[c, i + 1] + into * seen.light[c, i + 1]
    return float(low + f * (high - low))


@compiled
def _all(seen: Panorama, i: int, f: float) -> float:
    """The same all around."""
    last = seen.summed[-1]
    return float(last[i] + f * (last[i + 1] - last[i]))


@compiled
def _sensed(light: Light, gain: float, response: float, sigma: float, noise: Light) -> Grey:
    """Grey values of the light that comes to each pixel."""
    grey = np.empty(light.size, dtype=np.uint8)
    for n in range(light.size):
        exposed = min(gain * light[n], 1.0)
        bright = np.sqrt(exposed) if response == 0.5 else exposed**response
        grey[n] = int(min(max(255.0 * bright + sigma * noise[n], 0.0), 255.0) + 0.5)
    return grey
