"""Where the messages of a sensor that are missing were lost: before the bridge, in it, or behind it."""

from dataclasses import dataclass

from omnivert.doctor.evidence import Evidence
from omnivert.doctor.stream import Stream
from omnivert.messages import Health

# What the bridge counts when it has no time for what has come, as its refusals begin.
UNATTENDED = {"camera": "camera: frame displaced", "encoder": "encoder: waited too long"}


@dataclass(frozen=True, slots=True)
class Losses:
    """
    in_bridge  refused by the bridge while it was listened to, because it came to them too late
    behind     published and not heard, by their sequence numbers
    """

    device: str
    in_bridge: int
    behind: int
    is_here: bool

    @classmethod
    def of(cls, device: str, stream: Stream, evidence: Evidence) -> "Losses":
        """
        device  "camera" or "encoder"
        """
        bridge = next(iter(evidence.bus.of("bridge")), None)
        refused = 0 if bridge is None else _grown(bridge.first, bridge.health, UNATTENDED[device])
        return cls(device, refused, stream.lost, evidence.bus.is_here)

    def cause(self, missing: float) -> tuple[str, str] | None:
        """Reason and help where most of so many missing messages never were the device's fault; None otherwise."""
        if not self.in_bridge + self.behind or self.in_bridge + self.behind < 0.5 * missing:
            return None
        less = "give this machine less to do" if self.is_here else "give the robot's machine less to do"
        if self.in_bridge >= self.behind:
            reason = f"the {self.device} gave them: the bridge had no time for {self.in_bridge} of them"
            return reason, f"{less}, or set camera.frame_rate_hz lower"
        reason = f"the bridge published them: {self.behind} were lost on the way from it"
        where = less if self.is_here else "look from the robot itself: omnivert doctor there"
        return reason, f"{where}; lost in omnivert monitor says which service lacks some, too"


def _grown(first: Health | None, newest: Health | None, reason: str) -> int:
    """By how much a count has grown between two health messages; all of it where there is only one."""
    if newest is None:
        return 0
    before = first.refused if first is not None and first is not newest else {}
    now = newest.refused
    return sum(times - before.get(name, 0) for name, times in now.items() if name.startswith(reason))
