"""Everything that can be set: the sections together, and what of them describes the machine."""

import hashlib
import json
from typing import Any, Self

from pydantic import Field, model_validator

from omnivert.config.calibration import Calibration
from omnivert.config.camera import Camera, MirrorRing
from omnivert.config.encoder import Encoder
from omnivert.config.keeping import Player, Recorder, Storage
from omnivert.config.section import Id, Section
from omnivert.config.transport import Bus, Timeline
from omnivert.config.vision import Vision


class Robot(Section):
    """The drive."""

    id: Id = "demo"
    """Names the robot in keys and in the store."""
    wheel_base_m: float = Field(0.40, ge=0.05, le=5.0)
    """Distance between the wheels' contact points, e (eq. 15)."""


class Config(Section):
    """Everything that can be set. `robot`, `encoder`, `camera` and `ring` describe the machine: the rig."""

    robot: Robot = Robot()
    encoder: Encoder = Encoder()
    camera: Camera = Camera()
    ring: MirrorRing = MirrorRing()
    bus: Bus = Bus()
    vision: Vision = Vision()
    calibration: Calibration = Calibration()
    timeline: Timeline = Timeline()
    storage: Storage = Storage()
    player: Player = Player()
    recorder: Recorder = Recorder()

    @model_validator(mode="after")
    def _ring_is_in_the_picture(self) -> Self:
        width, height, reach = self.camera.width_px, self.camera.height_px, self.ring.r_max_px
        u, v = self.ring.center_px
        if not (-reach <= u <= width + reach and -reach <= v <= height + reach):
            raise ValueError(
                f"ring.center_px = ({u:g}, {v:g}) is farther than r_max_px outside the picture of {width} x {height}"
            )
        return self

    def rig(self) -> dict[str, dict[str, Any]]:
        """What a recording carries of the machine that made it: geometry and signs, not how its devices are reached."""
        return {table: getattr(self, table).model_dump(mode="json", include=keys) for table, keys in _RIG.items()}

    def rig_digest(self) -> str:
        """Fingerprint of all that a stored mount depends on: eight digits for each table that has a part in it."""
        return "-".join(map(_fingerprint, self._mount_depends_on().values()))

    def rig_changes(self, digest: str) -> tuple[str, ...]:
        """Where this configuration differs from that of another `rig_digest`: "table (key, key ...)"; () when nowhere.

        A digest of another form can be compared only as a whole.
        """
        ours, theirs = self.rig_digest().split("-"), digest.split("-")
        tables = self._mount_depends_on()
        if len(ours) != len(theirs):
            return (f"{', '.join(tables)} (which one can not be told from {digest})",)
        return tuple(
            f"{table} ({', '.join(keys)})"
            for (table, keys), our, their in zip(tables.items(), ours, theirs, strict=True)
            if our != their
        )

    def _mount_depends_on(self) -> dict[str, dict[str, Any]]:
        depends = {table: {key: rig[key] for key in sorted(rig.keys() - _FREE)} for table, rig in self.rig().items()}
        depends["camera"]["stamp_delay_s"] = self.camera.stamp_delay_s  # turns the mount by the way in that time
        depends["calibration"] = {"mode": self.calibration.mode}
        return depends


def _fingerprint(part: dict[str, Any]) -> str:
    """Of one table; what is false stays out, so that a switch that came later leaves the digests from before it."""
    told = {key: value for key, value in part.items() if value is not False}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:8]


_RIG: dict[str, set[str]] = {
    "robot": {"id", "wheel_base_m"},
    "encoder": {"id", "wheel_diameter_m", "ticks_per_rev", "swap_sides", "left_sign", "right_sign", "noise_k_m"},
    "camera": {"id", "width_px", "height_px", "bearing_sign", "frame_rate_hz"},
    "ring": {"center_px", "r_min_px", "r_max_px", "horizon_px"},
}
_FREE = {"noise_k_m", "frame_rate_hz", "center_px"}  # may change without moving the camera
