"""meta.json of a folder: the rig in it, as settings. Unknown keys are ignored."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.formats.regular import content
from omnivert.formats.table import refusal

LONGEST_RANGE_M = 1e4  # what a Scan can say
LARGEST = 1e18  # an integer beyond this has no float


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
            "robot": {"wheel_base_m": self._number("robot.wheel_base_m")},
            "encoder": {
                "wheel_diameter_m": self._number("robot.wheel_diameter_m"),
                "ticks_per_rev": self._number("robot.ticks_per_rev"),
                "left_sign": 1,  # the folder's counts are signed already
                "right_sign": 1,
            },
            "camera": {
                "width_px": self._number("image.width"),
                "height_px": self._number("image.height"),
                "bearing_sign": self._number("bearing_sign"),
                "frame_rate_hz": self._number("frame_rate_hz"),
            },
            "ring": {
                "center_px": self._value("ring.center_px"),
                "r_min_px": self._number("ring.r_min_px"),
                "r_max_px": self._number("ring.r_max_px"),
            },
        }
        try:
            return with_rig(base, rig, self._name)
        except UseError as error:
            raise DataError("OV310", error.what, error.because, "omnivert explain OV310") from error

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
