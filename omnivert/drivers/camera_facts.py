"""What a live camera tells of itself: who stamps its frames, at which rate it gives them, how it is exposed."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Protocol

import cv2

from omnivert.config import Camera

_V4L2_EXPOSURE_S = 1e-4  # Video4Linux counts the exposure in these
_V4L2_BY_HAND = 1.0  # Video4Linux: 1 by hand, 0, 2 and 3 some kind of automatic


class Stamp(StrEnum):
    """Who stamps the frames, best first."""

    KERNEL = "the kernel, as they came from the sensor"
    STREAM = "the sender's clock, brought to this one"
    ARRIVAL = "their arrival here"


class Capture(Protocol):
    """What is used of `cv2.VideoCapture`."""

    def isOpened(self) -> bool: ...  # noqa: N802
    def grab(self) -> bool: ...
    def retrieve(self) -> tuple[bool, Any]: ...
    def get(self, propId: int) -> float: ...
    def set(self, propId: int, value: float) -> bool: ...
    def release(self) -> None: ...


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """None: the source does not tell."""

    stamp: Stamp
    asked_hz: float
    rate_hz: float | None = None  # that it says to have
    exposure_s: float | None = None
    by_hand: bool | None = None  # exposure is fixed; else the camera chooses it

    def stamped(self, stamp: Stamp) -> "CameraFacts":
        return replace(self, stamp=stamp)

    def __str__(self) -> str:
        parts = [f"stamped by {self.stamp}"]
        if self.rate_hz is not None:
            other = abs(self.rate_hz - self.asked_hz) > 0.05 * self.asked_hz
            parts.append(f"{self.rate_hz:.4g} Hz" + (f", asked for {self.asked_hz:.4g}" if other else ""))
        if self.exposure_s is not None:
            how = {True: " fixed", False: " now, automatic", None: ""}[self.by_hand]
            parts.append(f"exposure {1e3 * self.exposure_s:.3g} ms{how}")
        elif self.by_hand is not None:
            parts.append("exposure fixed" if self.by_hand else "exposure automatic")
        return "; ".join(parts)


def facts_of(opened: Capture, config: Camera, stamp: Stamp) -> CameraFacts:
    """What an open source says of itself."""
    rate_hz = opened.get(cv2.CAP_PROP_FPS)
    facts = CameraFacts(stamp, config.frame_rate_hz, rate_hz if 0.0 < rate_hz <= 1000.0 else None)
    if round(opened.get(cv2.CAP_PROP_BACKEND)) != cv2.CAP_V4L2:
        return facts  # elsewhere the numbers have units that nobody tells
    exposure, mode = opened.get(cv2.CAP_PROP_EXPOSURE), opened.get(cv2.CAP_PROP_AUTO_EXPOSURE)
    return replace(
        facts,
        exposure_s=exposure * _V4L2_EXPOSURE_S if exposure > 0.0 else None,
        by_hand=mode == _V4L2_BY_HAND if mode >= 0.0 else None,
    )
