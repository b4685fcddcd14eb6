"""The table of streams: key, message, and how each one travels.

Below the namespace `omnivert/<robot>` a key is `v1/<group>/<id>/<stream>`, so that one `*` stands for one chunk.
"""

from dataclasses import dataclass
from enum import StrEnum

from omnivert.config import Config
from omnivert.messages import (
    Bearings,
    Drive,
    Estimate,
    Extrinsics,
    Frame,
    Health,
    Message,
    Playback,
    Receipt,
    Scan,
    Ticks,
)

VERSION = "v1"


class Delivery(StrEnum):
    """What a consumer that falls behind does with a stream; no publisher ever waits for one."""

    EVERY = "every"  # queues, and drops the oldest beyond a bound
    LATEST = "latest"  # keeps the newest one live, every one of a playback


class Urgency(StrEnum):
    """Which stream goes first on a busy link; the names are those of zenoh's priorities."""

    INTERACTIVE_HIGH = "INTERACTIVE_HIGH"
    DATA_HIGH = "DATA_HIGH"
    DATA = "DATA"
    DATA_LOW = "DATA_LOW"


@dataclass(frozen=True, slots=True)
class Channel:
    """One stream: who speaks, what, and how it travels.

    owner  whose id from the configuration stands in the key; "" when each service puts its own (health)
    """

    group: str
    stream: str
    message: type[Message]
    owner: str = "camera"
    delivery: Delivery = Delivery.EVERY
    urgency: Urgency = Urgency.DATA

    def key(self, config: Config) -> str:
        """The key below the robot's namespace; for health the pattern that takes in every service."""
        match self.owner:
            case "camera":
                return f"{VERSION}/{self.group}/{config.camera.id}/{self.stream}"
            case "encoder":
                return f"{VERSION}/{self.group}/{config.encoder.id}/{self.stream}"
            case _:
                return f"{VERSION}/*/*/{self.stream}"


FRAME = Channel("camera", "frame", Frame, delivery=Delivery.LATEST, urgency=Urgency.DATA_LOW)
TICKS = Channel("encoder", "ticks", Ticks, owner="encoder", urgency=Urgency.INTERACTIVE_HIGH)
DRIVE = Channel("wheels", "drive", Drive, owner="encoder", urgency=Urgency.INTERACTIVE_HIGH)
SCAN = Channel("laser", "scan", Scan, urgency=Urgency.DATA_LOW)
BEARINGS = Channel("vision", "bearings", Bearings, urgency=Urgency.DATA_HIGH)
ESTIMATE = Channel("calibration", "estimate", Estimate, urgency=Urgency.DATA_HIGH)
EXTRINSICS = Channel("calibration", "extrinsics", Extrinsics)
RECEIPT = Channel("storage", "receipt", Receipt)
PLAYBACK = Channel("player", "playback", Playback)
HEALTH = Channel("*", "health", Health, owner="")

CHANNELS = (FRAME, TICKS, DRIVE, SCAN, BEARINGS, ESTIMATE, EXTRINSICS, RECEIPT, PLAYBACK, HEALTH)


def health_key(service: str, instance: str) -> str:
    return f"{VERSION}/{service}/{instance}/{HEALTH.stream}"


def presence_key(service: str, instance: str, incarnation: str) -> str:
    """Key of a liveliness token; chunks that begin with @ are invisible to `*`."""
    return f"{VERSION}/@live/{service}/{instance}/{incarnation}"


def channel_from_key(key: str) -> Channel | None:
    """The channel of a key below the namespace, whatever the id in it; None for a key of nobody."""
    match key.split("/"):
        case [version, group, _, stream] if version == VERSION:
            for channel in CHANNELS:
                if channel.stream == stream and channel.group in (group, "*"):
                    return channel
    return None
