"""The one step message -> estimate: holds frames until the wheels cover them, then filter, batch and verdict."""

from collections import Counter, deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import omnivert
from omnivert.angles import wrap
from omnivert.calibration.batch import Batch, Keyed, Outcome, Result
from omnivert.calibration.ekf import Filter, Rules, rules_of_the_paper
from omnivert.calibration.noise import Noise
from omnivert.calibration.observability import larger
from omnivert.calibration.pulse import Pulse
from omnivert.calibration.sighting import Sighting, clean_sighting
from omnivert.calibration.smoothing import Background, Smoothing, at_once
from omnivert.calibration.verdict import Shown, Verdict, paper_verdict, verdict
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Mount, State, Ticks
from omnivert.odometry import SECOND, Motion, Odometer, Samples, nothing

Array = NDArray[np.float64]

SILENCE_NS = SECOND  # a frame waits this long, by the stamps of later frames, for counts that cover it
LINEAR_RAD = 0.35  # the filter takes over when phi is known to this
SHOWN_RAD = 0.6  # an estimate is published when phi is known to this


class Calibrator:
    """Takes ticks and bearings in the order of their stamps; gives one estimate for every frame.

    background  runs the smoother beside the pulse; its results are taken up at frames that do not depend on its speed
    """

    def __init__(
        self, config: Config, stored: Extrinsics | None = None, background: Background[Outcome] = at_once
    ) -> None:
        self._config = config
        self._paper = config.calibration.mode == "paper"
        self._odometer = Odometer(config.encoder, config.robot.wheel_base_m)
        self._smoothing = Smoothing(Batch(config), background)
        self._held: deque[Sighting] = deque()
        self._refused: Counter[str] = Counter()
        self._newest_ns = -1  # frame received
        self._last_ns: int | None = None  # frame worked on
        self._since_key: Samples | None = None  # wheels since the last keyframe; None before the first or after a break
        self._way_since_key = (0.0, 0.0)  # m, rad
        self._has_key = False
        self._corrections = np.zeros(3)  # time offset (s), wheel ratio - 1, base / configured - 1
        self._noise = Noise()
        self._frames = 0
        self._driven_m = 0.0
        self._turned_rad = 0.0
        self._pulse = Pulse()
        self._lines_seen = 0
        self._state = State.WAITING
        self._claimed: Array | None = None  # sigmas of the last extrinsics
        self._claimed_frame = 0
        self._told_last: Estimate | None = None
        self._stored: Mount | None = None
        if self._paper:
            c = config.calibration
            self._pulse = Pulse(
                Filter(
                    np.array([c.start_phi_rad, c.start_rho_m, c.start_psi_rad]),
                    np.diag([0.5**2, 0.1**2, 0.5**2]),
                    rules_of_the_paper(config.robot.wheel_base_m, config.encoder.noise_k_m),
                )
            )
        elif stored is not None:
            mount = stored.mount
            self._stored = mount
            at = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad])
            self._pulse = Pulse(Filter(at, mount.covariance, Rules()))
            self._state = stored.state
            self._claimed = np.sqrt(np.diag(mount.covariance))

    @property
    def refused(self) -> dict[str, int]:
        """Bad input so far, by reason."""
        return dict(self._refused + self._odometer.refused)

    def step(self, message: Ticks | Bearings) -> tuple[Estimate | Extrinsics, ...]:
        match message:
            case Ticks():
                self._odometer.push(message)
            case Bearings():
                self._take(message)
        out: list[Estimate | Extrinsics] = []
        while self._held and self._is_due(self._held[0]):
            out += self._work(self._held.popleft())
        return tuple(out)

    def settle(self) -> Result | None:
        """Everything so far, solved once more: the smoother's last word; None without a single clear solution."""
        self._adopt(self._smoothing.finished(), [])
        if self._has_key:
            self._smoothing.begin()
            self._pulse.mark()
            self._adopt(self._smoothing.finished(), [])
        return self._smoothing.result

    def close(self) -> tuple[Estimate | Extrinsics, ...]:
        """No more messages will come: what is held goes through without counts, and the final state is claimed."""
        out: list[Estimate | Extrinsics] = []
        while self._held:
            out += self._work(self._held.popleft())
        last = self._told_last
        if last is None or last.mount is None or last.state is not State.CALIBRATED:
            return tuple(out)
        if self._stored is None and self._claimed_frame != last.frame:
            out.append(self._claim(last, last.mount))
        return tuple(out)

    def _take(self, bearings: Bearings) -> None:
        if bearings.stamp_ns <= self._newest_ns:
            self._refused["bearings: stamp not after the one before"] += 1
            return
        self._newest_ns = bearings.stamp_ns
        sighting, bad = clean_sighting(bearings, np.deg2rad(self._config.calibration.bearing_floor_deg))
        if bad:
            self._refused["bearings: track repeated in a frame, or a value that is no number"] += bad
        self._held.append(sighting)

    def _is_due(self, sighting: Sighting) -> bool:
        newest = self._odometer.newest_ns
        return (newest is not None and newest >= sighting.stamp_ns) or (
            self._newest_ns - sighting.stamp_ns > SILENCE_NS
        )

    def _work(self, sighting: Sighting) -> list[Estimate | Extrinsics]:
        reasons = list(sighting.reasons)
        self._frames += 1
        motion = self._motion(sighting.stamp_ns, reasons)
        if motion is not None:
            self._driven_m += motion.driven_m
            self._turned_rad += motion.turned_rad
            self._way_since_key = (self._way_since_key[0] + motion.driven_m, self._way_since_key[1] + motion.turned_rad)
            self._pulse.predict(motion)
            if self._is_keyframe():
                self._see(sighting, reasons)
        self._lines_seen = sighting.track.size
        self._odometer.forget_before(self._last_ns or 0)
        return self._told(sighting.stamp_ns, reasons)

    def _motion(self, stamp_ns: int, reasons: list[str]) -> Motion | None:
        """Since the last frame that the wheels covered; the first one has moved nowhere."""
        offset, ratio, base = self._corrections
        at_ns = stamp_ns - round(offset * SECOND)
        if self._odometer.samples(stamp_ns, stamp_ns) is None:
            reasons.append("no wheel counts at this frame")
            return None
        if self._last_ns is None:
            self._last_ns = stamp_ns
            return nothing()
        told = self._odometer.samples(self._last_ns, stamp_ns)
        motion = told if offset == 0.0 else self._odometer.samples(self._last_ns - stamp_ns + at_ns, at_ns)
        self._last_ns = stamp_ns
        if told is None:
            reasons.append("the wheels' counts broke off; the way since the last frame is unknown")
            self._since_key = None
            self._way_since_key = (np.inf, np.inf)
            self._pulse.forget_lines()
            return nothing()
        if self._has_key:
            self._since_key = told if self._since_key is None else self._since_key + told
        return self._odometer.motion(told if motion is None else motion, 1.0 + ratio, 1.0 + base, self._noise.wheels)

    def _is_keyframe(self) -> bool:
        if not self._has_key or self._paper:
            return True
        settings = self._config.calibration
        way, turn = self._way_since_key
        return way >= settings.keyframe_step_m or turn >= np.deg2rad(settings.keyframe_turn_deg)

    def _see(self, sighting: Sighting, reasons: list[str]) -> None:
        if not self._pulse.update(replace(sighting, std=np.sqrt(self._noise.bearings) * sighting.std)):
            self._refused["filter: covariance lost its definiteness"] += 1
            reasons.append("the filter lost its footing and starts anew")
        if self._paper:
            return
        stamp_s = sighting.stamp_ns / SECOND
        key = Keyed(stamp_s, self._since_key, sighting.track, sighting.beta, sighting.std)
        self._has_key, self._since_key, self._way_since_key = True, None, (0.0, 0.0)
        self._smoothing.append(key)
        if self._smoothing.is_due:
            self._adopt(self._smoothing.finished(), reasons)
            self._smoothing.begin()
            self._pulse.mark()

    def _adopt(self, outcome: Outcome | None, reasons: list[str]) -> None:
        """The filter goes on from the batch's joint, each time there is one: it only bridges what comes between."""
        if outcome is None:
            return
        result = outcome.result
        running = self._pulse.filter
        if result is None or len(result.centres) < 2:  # nothing to start from
            if self._stored is None:
                self._pulse.drop()
            return
        if self._stored is not None and running is not None:
            off = result.mount - running.mount
            off[[0, 2]] = wrap(off[[0, 2]])
            spread = result.honest_covariance + self._stored.covariance
            if float(off @ np.linalg.solve(spread, off)) > 21.1:  # chi-square of 3: 1 in 10 000
                reasons.append("the drive contradicts the stored mount, which is dropped")
                self._claimed, self._state = None, State.NOT_YET
            elif (np.diag(result.honest_covariance) > np.diag(self._stored.covariance)).any():
                return
            self._stored = None
        if np.sqrt(result.honest_covariance[0, 0]) < LINEAR_RAD:
            self._pulse.seed(result)
            self._corrections, self._noise = result.corrections, result.noise

    def _told(self, stamp_ns: int, reasons: list[str]) -> list[Estimate | Extrinsics]:
        mount, covariance = self._mount()
        if self._stored is not None:
            reasons.insert(0, "taken up from the store")
        judged = paper_verdict() if self._paper else self._judged(mount, covariance)
        self._state = judged.state
        published = None
        if mount is not None and covariance is not None and self._is_shown(covariance):
            published = Mount(float(mount[0]), float(mount[1]), float(mount[2]), covariance)
        estimate = Estimate(
            stamp_ns=stamp_ns,
            frame=self._frames,
            mount=published,
            state=judged.state,
            phi=judged.phi,
            rho=judged.rho,
            psi=judged.psi,
            next_manoeuvre=judged.next_manoeuvre,
            driven_m=self._driven_m,
            turned_rad=self._turned_rad,
            lines_used=self._pulse.innovation.used,
            lines_new=self._pulse.innovation.new,
            lines_rejected=self._pulse.innovation.rejected,
            reasons=tuple(dict.fromkeys(reasons))[:16],
            **self._beside(mount),
        )
        self._told_last = estimate
        if published is not None and judged.state is State.CALIBRATED and self._is_news(published):
            return [estimate, self._claim(estimate, published)]
        return [estimate]

    def _beside(self, mount: Array | None) -> dict[str, Any]:
        """What the smoother says, beside the filter's mount."""
        result = self._smoothing.result
        if result is None or len(result.centres) < 2 or not self._is_shown(result.honest_covariance):
            return {}
        covariance = 0.5 * (result.honest_covariance + result.honest_covariance.T)
        phi, rho, psi = result.mount.tolist()
        return {
            "smoother": Mount(phi, rho, psi, covariance),
            "disagreement": 0.0 if mount is None else self._disagreement(mount),
            "bound_std": np.sqrt(np.diag(result.covariance)),
            "corrections": result.told,
        }

    def _disagreement(self, mount: Array) -> float:
        """Of filter and smoother, in sigmas."""
        result = self._smoothing.result
        if result is None or self._stored is not None:
            return 0.0
        off = mount - result.mount
        off[[0, 2]] = wrap(off[[0, 2]])
        return float(np.sqrt(max(0.0, float(off @ np.linalg.solve(result.honest_covariance, off)))))

    def _claim(self, estimate: Estimate, mount: Mount) -> Extrinsics:
        self._claimed = np.sqrt(np.diag(mount.covariance))
        self._claimed_frame = estimate.frame
        return Extrinsics(
            stamp_ns=estimate.stamp_ns,
            robot=self._config.robot.id,
            camera=self._config.camera.id,
            mount=mount,
            state=estimate.state,
            frames=estimate.frame,
            reasons=estimate.reasons,
            software=f"omnivert {omnivert.__version__}",
            rig_digest=self._config.rig_digest(),
        )

    def _mount(self) -> tuple[Array | None, Array | None]:
        """phi, rho, psi and the covariance that may be claimed, without what only the wheels' noise has shown."""
        running, result = self._pulse.filter, self._smoothing.result
        if running is not None:
            covariance = running.mount_covariance
            if self._stored is not None:
                covariance = larger(covariance, self._stored.covariance)
            elif result is not None:
                covariance = covariance + result.excess
            return running.mount, 0.5 * (covariance + covariance.T)
        if result is not None and len(result.centres) >= 2:
            covariance = result.honest_covariance
            return result.mount, 0.5 * (covariance + covariance.T)
        return None, None

    def _is_shown(self, covariance: Array) -> bool:
        return self._paper or float(np.sqrt(covariance[0, 0])) < SHOWN_RAD

    def _judged(self, mount: Array | None, covariance: Array | None) -> Verdict:
        result, outcome = self._smoothing.result, self._smoothing.outcome
        shown = Shown(
            frames=self._frames,
            lines=self._lines_seen,
            ticks=self._last_ns is not None,
            driven_m=self._driven_m,
            turned_rad=self._turned_rad,
            centres=outcome.centres,
            covariance=covariance,
            rho_m=0.0 if mount is None else float(mount[1]),
            contradicted=self._contradiction(),
            disagreement=0.0 if result is None or self._stored is not None else result.disagreement,
            sum_rad=None if result is None else result.sum_sigma(),
            restored=self._stored is not None,
            filter_off=0.0 if mount is None else self._disagreement(mount),
            seen=outcome.seen,
            todo=None if result is None else result.todo,
            gap=np.inf if result is None or self._stored is not None else result.gap,
            phi_rad=None if mount is None else float(mount[0]),
        )
        return verdict(shown, self._config.calibration, self._state)

    def _contradiction(self) -> str:
        """Said when even the best mount leaves many bearings unexplained, though the drive would show a good one."""
        outcome = self._smoothing.outcome
        if outcome.wrong:
            return f"because the drive only makes sense if {outcome.wrong}"
        enough = outcome.keyframes >= 40 and len(outcome.centres) >= 2
        if outcome.result is not None or not enough or outcome.share >= self._config.calibration.invalid_inliers:
            return ""
        return (
            f"because no mount explains more than {100.0 * outcome.share:.0f} % of the bearings: "
            "check the wheel base, the wheels' diameter, the clocks of camera and encoders, and what else moves"
        )

    def _is_news(self, mount: Mount) -> bool:
        """A claim is news the first time, and when a sigma has fallen by a tenth, at most every 15 frames."""
        if self._claimed is None:
            return True
        better = np.sqrt(np.diag(mount.covariance)) < 0.9 * self._claimed
        return bool(better.any()) and self._frames - self._claimed_frame >= 15
