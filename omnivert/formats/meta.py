"""meta.json of a folder: the rig in it, as settings. Unknown keys are ignored."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.formats.regular import content
from omnivert.formats.table import refusal

LONGEST_RANGE_M = 1e4  # what a Scan can say
LARGEST = 1e18  # an integer beyond this has no float
FINEST_STD_RAD, WIDEST_STD_RAD = 1e-6, pi  # what Bearings can say

EXPORTED = "omnivert"  # key of what an export knows of the rig beyond the form of the folder

# Displacements in metres are counted by a wheel of 1 m around in 10 million ticks: 0.1 um a tick, finer than logs are.
# Rounding to it is nothing beside the wheels' noise (0.45 mm in 1 mm of way, eq. 31), and 2^53 ticks go 900 000 km.
METRE_WHEEL = {"wheel_diameter_m": 1.0 / pi, "ticks_per_rev": 10_000_000}
_SIDES = ("swap_sides", "left_sign", "right_sign")  # of what the device counted; the folder holds none of it raw


@dataclass(frozen=True, slots=True)
class Laser:
    """How the rows of scans.csv are to be read."""

    angle_min_rad: float
    angle_increment_rad: float
    n: int
    range_max_m: float
    invalid: float


class Meta:
    """The file's JSON object, asked key by key.

    raises  DataError naming file and key
    """

    def __init__(self, path: Path) -> None:
        self._name = path.name
        try:
            given = json.loads(content(path).decode("utf-8-sig"))
        except FileNotFoundError:
            raise refusal(self._name, f"there is no such file in {path.parent}") from None
        except OSError as error:
            raise refusal(self._name, f"cannot be read: {error.strerror or error}") from error
        except (ValueError, RecursionError) as error:
            raise refusal(self._name, f"is not JSON: {error}") from error
        if not isinstance(given, dict):
            raise refusal(self._name, "is not a JSON object")
        self._given: dict[str, Any] = given

    def config(self, base: Config) -> Config:
        """The settings with this rig: names and all that the file does not say come from `base`."""
        rig = {
            "robot": {
                "wheel_base_m": self._number("robot.wheel_base_m"),
                **self._optional("robot", "id"),
            },
            "encoder": {
                "wheel_diameter_m": self._number("robot.wheel_diameter_m"),
                "ticks_per_rev": self._number("robot.ticks_per_rev"),
                "swap_sides": False,  # the folder's counts are those of the right sides, and signed, already
                "left_sign": 1,
                "right_sign": 1,
                **self._optional("encoder", "id", "noise_k_m", *_SIDES),
            },
            "camera": {
                "width_px": self._number("image.width"),
                "height_px": self._number("image.height"),
                "bearing_sign": self._number("bearing_sign"),
                "frame_rate_hz": self._number("frame_rate_hz"),
                **self._optional("camera", "id"),
            },
            "ring": {
                "center_px": self._value("ring.center_px"),
                "r_min_px": self._number("ring.r_min_px"),
                "r_max_px": self._number("ring.r_max_px"),
                **self._optional("ring", "horizon_px"),
            },
        }
        return self._with_rig(base, rig)

    def bearings_config(self, base: Config, rate_hz: float) -> Config:
        """The settings with this rig of a bearing sensor, which sees `rate_hz` times a second.

        Picture and ring stay those of `base`: nothing looks at them, and where the same robot has a camera, too, its
        configuration still fits.
        """
        rig = {
            "robot": {
                "wheel_base_m": self._number("robot.wheel_base_m"),
                **self._optional("robot", "id"),
            },
            "encoder": {
                **METRE_WHEEL,
                "swap_sides": False,
                "left_sign": 1,
                "right_sign": 1,
                **self._optional("encoder", *METRE_WHEEL, "id", "noise_k_m", *_SIDES),
            },
            "camera": {
                "bearing_sign": 1,  # the folder's bearings are counter-clockwise
                "frame_rate_hz": rate_hz,
                **self._optional("camera", "id", "frame_rate_hz", "bearing_sign", "width_px", "height_px"),
            },
            "ring": self._optional("ring", "center_px", "r_min_px", "r_max_px", "horizon_px"),
        }
        return self._with_rig(base, rig)

    def bearing_std_rad(self) -> float | None:
        """One sigma of all bearings; None where the file does not say it."""
        if "bearing_std_rad" not in self._given:
            return None
        return check_std(self._number("bearing_std_rad"), self._name, "bearing_std_rad")

    def laser(self) -> Laser:
        """The sweep's form, which scans.csv does not say."""
        laser = Laser(
            self._number("laser.angle_min"),
            self._number("laser.angle_increment"),
            int(self._number("laser.n")),
            self._number("laser.range_max"),
            self._number("laser.invalid"),
        )
        if abs(laser.angle_min_rad) > 7.0 or abs(laser.angle_increment_rad) > 1.0:
            raise refusal(self._name, "laser.angle_min and laser.angle_increment are in radians")
        if laser.n < 1 or not 0.0 < laser.range_max_m <= LONGEST_RANGE_M:
            raise refusal(self._name, f"laser.n must be at least 1, laser.range_max in (0, {LONGEST_RANGE_M:g}] m")
        return laser

    def _with_rig(self, base: Config, rig: Mapping[str, Mapping[str, Any]]) -> Config:
        try:
            return with_rig(base, rig, self._name)
        except UseError as error:
            raise DataError("OV310", error.what, error.because, "omnivert explain OV310") from error

    def _optional(self, table: str, *keys: str) -> dict[str, Any]:
        """What an export has put beside what anybody can write, so that nothing of the rig is lost on the way."""
        given = self._given.get(EXPORTED)
        given = given.get(table) if isinstance(given, dict) else None
        return {key: given[key] for key in keys if key in given} if isinstance(given, dict) else {}

    def _value(self, place: str) -> Any:
        value: Any = self._given
        for key in place.split("."):
            if not isinstance(value, dict) or key not in value:
                raise refusal(self._name, f"{place} is missing")
            value = value[key]
        return value

    def _number(self, place: str) -> float:
        value = self._value(place)
        if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < LARGEST:
            raise refusal(self._name, f"{place} = {str(value)[:40]} is no finite number")
        return value


def check_std(value: float, place: str, name: str) -> float:
    """The sigma of a bearing, rad, if it can be one.

    raises  DataError
    """
    if not FINEST_STD_RAD <= value <= WIDEST_STD_RAD:
        raise refusal(place, f"{name} = {value:g} is no sigma of a bearing: {FINEST_STD_RAD:g} to pi, in radians")
    return value
