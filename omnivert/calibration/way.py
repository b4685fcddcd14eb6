"""The robot's way from frame to frame for the filter, and from keyframe to keyframe for the smoother."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.sighting import is_stamp
from omnivert.calibration.solver.noise import Noise
from omnivert.config import Config
from omnivert.messages import Ticks
from omnivert.odometry import SECOND, Motion, Odometer, Samples, nothing

Array = NDArray[np.float64]

KEPT_NS = 120 * SECOND  # counts wait so long for a frame; when it comes later, the way to it is not known


class Way:
    """Takes the counts, and knows what of the way was not covered by them."""

    def __init__(self, config: Config) -> None:
        self._settings = config.calibration
        self._odometer = Odometer(config.encoder, config.robot.wheel_base_m)
        self._refused: Counter[str] = Counter()
        self._corrections = np.zeros(3)  # time offset (s), wheel ratio - 1, base / configured - 1
        self._noise = Noise()
        self._last_ns: int | None = None  # frame worked on
        self._has_key = False
        self._since_key: Samples | None = None  # None before the first keyframe, or after a break
        self._moved_since_key = (0.0, 0.0)  # m, rad
        self.is_known = False  # counts have covered a frame
        self.driven_m = 0.0
        self.turned_rad = 0.0

    @property
    def refused(self) -> Counter[str]:
        return self._odometer.refused + self._refused

    @property
    def newest_ns(self) -> int | None:
        return self._odometer.newest_ns

    def push(self, ticks: Ticks) -> None:
        if not is_stamp(ticks.stamp_ns):
            self._refused["ticks: stamp out of range"] += 1
            return
        self._odometer.push(ticks)
        self._odometer.forget_before((self._odometer.newest_ns or 0) - KEPT_NS)

    def correct(self, corrections: Array, noise: Noise) -> None:
        """What the wheels, the clocks and their noise really are, from now on."""
        self._corrections, self._noise = corrections, noise

    def step(self, stamp_ns: int) -> tuple[Motion | None, str]:
        """The motion since the last frame that the wheels covered, the first one's is nothing; None when they do not.

        Also what is wrong: nothing, or why the motion is not known.
        """
        offset, ratio, base = self._corrections
        if self._odometer.samples(stamp_ns, stamp_ns) is None:
            return None, "no wheel counts at this frame"
        self.is_known = True
        before, self._last_ns = self._last_ns, stamp_ns
        if before is None:
            return nothing(), ""
        told = self._odometer.samples(before, stamp_ns)
        if told is None:
            self._since_key, self._moved_since_key = None, (np.inf, np.inf)
            self._odometer.forget_before(stamp_ns - SECOND)
            return nothing(), "the wheels' counts broke off; the way since the last frame is unknown"
        if self._has_key:
            self._since_key = told if self._since_key is None else self._since_key + told
        late = round(offset * SECOND)
        meant = told if late == 0 else self._odometer.samples(before - late, stamp_ns - late) or told
        motion = self._odometer.motion(meant, 1.0 + ratio, 1.0 + base, self._noise.wheels)
        self.driven_m += motion.driven_m
        self.turned_rad += motion.turned_rad
        way, turn = self._moved_since_key
        self._moved_since_key = (way + motion.driven_m, turn + motion.turned_rad)
        self._odometer.forget_before(stamp_ns - SECOND)  # an offset looks back
        return motion, ""

    @property
    def is_at_keyframe(self) -> bool:
        way, turn = self._moved_since_key
        far = way >= self._settings.keyframe_step_m or turn >= np.deg2rad(self._settings.keyframe_turn_deg)
        return not self._has_key or far

    def take_key(self) -> Samples | None:
        """The wheels since the last keyframe, None where their way is unknown; from here on it is this frame."""
        taken, self._since_key = self._since_key, None
        self._has_key, self._moved_since_key = True, (0.0, 0.0)
        return taken
