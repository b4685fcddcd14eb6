"""What is claimed, when, and until a knock takes it back."""

import numpy as np
from numpy.typing import NDArray

import omnivert
from omnivert.calibration.kalman.pulse import Pulse
from omnivert.calibration.kalman.watchdog import Alarm, Watchdog, WatchRules
from omnivert.calibration.sighting import Sighting
from omnivert.config import Config
from omnivert.messages import Estimate, Extrinsics, Mount, State

Array = NDArray[np.float64]

BETTER = 0.9  # a claim is news when a sigma has fallen to this share of what was claimed
FRAMES = 15  # between two claims, at least
SETTLED = 45  # frames of driving after the first claim: a filter that was seeded just now still bends, and would alarm


class Claims:
    """Makes extrinsics of estimates, and watches over the last ones."""

    def __init__(self, config: Config, stored: Extrinsics | None) -> None:
        self._config = config
        self._last: Extrinsics | None = None
        self._watchdog: Watchdog | None = None
        self._settling = 0  # frames of driving since the first claim
        if stored is not None:
            self._settling = SETTLED
            self._last = stored
            self._watch(stored.mount, 0)  # its stamp is of another clock

    def is_news(self, estimate: Estimate, final: bool) -> bool:
        """Whether an estimate is to be claimed: the first time, when a sigma has fallen, and the last one."""
        if estimate.mount is None or estimate.state is not State.CALIBRATED:
            return False
        last = self._last
        if last is None:
            return True
        if last.stamp_ns == estimate.stamp_ns:  # a receipt tells claims apart by their stamps
            return False
        if final:
            return True
        better = np.diag(estimate.mount.covariance) < BETTER**2 * np.diag(last.mount.covariance)
        return bool(better.any()) and estimate.frame - last.frames >= FRAMES

    def made(self, estimate: Estimate, mount: Mount) -> Extrinsics:
        self._remember(self._extrinsics(estimate, mount, estimate.reasons))
        assert self._last is not None
        return self._last

    def forget(self) -> None:
        """The drive contradicts them."""
        self._last, self._watchdog, self._settling = None, None, 0

    def watched(self, stamp_ns: int, still: bool, sighting: Sighting, pulse: Pulse, is_asked: bool) -> str:
        """What has become of the camera since it was claimed: empty, or how it moved.

        is_asked  whether this frame has gone through the filter
        """
        if self._last is not None and is_asked and self._settling < SETTLED:
            self._settling += 1
            if self._settling == SETTLED:
                self._watch(self._last.mount, self._last.stamp_ns)
        dog, known = self._watchdog, pulse.filter
        if dog is None or known is None:
            return ""
        alarm = dog.stand(stamp_ns, still, sighting.track, sighting.beta, sighting.std, known)
        if alarm is None and is_asked:
            alarm = dog.step(stamp_ns, known, pulse.innovation.evidence)
        return "" if alarm is None else _told(alarm, stamp_ns)

    def compared(self, stamp_ns: int, recent: tuple[float, Array, Array] | None) -> str:
        """The same by the mount as the last part of the drive has it: since when (s), phi, rho, psi, covariance."""
        if self._watchdog is None or recent is None:
            return ""
        alarm = self._watchdog.compare(round(recent[0] * 1e9), recent[1], recent[2])
        return "" if alarm is None else _told(alarm, stamp_ns)

    def superseded(self, estimate: Estimate, why: str) -> Extrinsics | None:
        """The last claim once more, as one that no longer holds; None when there was none."""
        last = self._last
        self.forget()
        return None if last is None else self._extrinsics(estimate, last.mount, (why,))

    def _remember(self, extrinsics: Extrinsics) -> None:
        self._last = extrinsics
        if self._settling >= SETTLED:
            self._watch(extrinsics.mount, extrinsics.stamp_ns)

    def _watch(self, mount: Mount, since_ns: int) -> None:
        at = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad])
        if self._watchdog is None:
            rules = WatchRules(chance=self._config.calibration.alarm_chance)
            self._watchdog = Watchdog(at, mount.covariance, rules, since_ns)
        else:
            self._watchdog.renew(since_ns, at, mount.covariance)

    def _extrinsics(self, estimate: Estimate, mount: Mount, reasons: tuple[str, ...]) -> Extrinsics:
        return Extrinsics(
            stamp_ns=estimate.stamp_ns,
            robot=self._config.robot.id,
            camera=self._config.camera.id,
            mount=mount,
            state=estimate.state,
            frames=estimate.frame,
            reasons=reasons,
            software=f"omnivert {omnivert.__version__}",
            rig_digest=self._config.rig_digest(),
        )


def _told(alarm: Alarm, now_ns: int) -> str:
    ago = (now_ns - alarm.stamp_ns) / 1e9
    return f"{alarm.text}, {ago:.1f} s before this was noticed"
