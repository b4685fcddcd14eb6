"""The one step message -> estimate: holds frames until the wheels cover them, then filter, batch and verdict."""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.calibration.judging.claims import Claims
from omnivert.calibration.judging.observability import larger
from omnivert.calibration.judging.steadiness import Steadiness
from omnivert.calibration.judging.telling import is_told
from omnivert.calibration.judging.verdict import Shown, Verdict, paper_verdict, verdict
from omnivert.calibration.kalman.definite import factor
from omnivert.calibration.kalman.ekf import Filter, Rules, rules_of_the_paper
from omnivert.calibration.kalman.model import mount_difference
from omnivert.calibration.kalman.pulse import Pulse
from omnivert.calibration.sighting import Sighting
from omnivert.calibration.smoothing import Background, Smoothing, at_once
from omnivert.calibration.solver.batch import Batch
from omnivert.calibration.solver.noise import Noise
from omnivert.calibration.solver.result import Outcome, Result
from omnivert.calibration.solver.stretch import Keyed
from omnivert.calibration.symmetric import evened
from omnivert.calibration.waiting import Waiting
from omnivert.calibration.way import Way
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Mount, State, Ticks
from omnivert.odometry import SECOND

Array = NDArray[np.float64]

MOST_OFF = 1e6  # sigmas that are told
LINEAR_RAD = 0.35  # the filter takes over when phi is known to this


class Calibrator:
    """Takes ticks and bearings in the order of their stamps; gives one estimate for every frame.

    background  runs the smoother beside the pulse; its results are taken up at frames that do not depend on its speed
    """

    def __init__(
        self, config: Config, stored: Extrinsics | None = None, background: Background[Outcome] = at_once
    ) -> None:
        self._config = config
        self._paper = config.calibration.mode == "paper"
        self._way = Way(config)
        self._background = background
        self._smoothing = Smoothing(Batch(config), background)
        self._waiting = Waiting(config.calibration)
        self._refused: Counter[str] = Counter()
        self._frames = 0
        self._pulse = Pulse()
        self._noise = Noise()
        self._steadiness = Steadiness(self._config.calibration)
        self._lines_seen = 0
        self._state = State.WAITING
        self._moved = ""  # how the camera was knocked, until it is calibrated anew
        self._told_last: Estimate | None = None
        self._stored: Mount | None = None
        self._unfit = ""  # why a stored mount was not taken up, until that is told
        if stored is not None and not _is_covariance(stored.mount.covariance):
            self._refused["stored mount: its covariance is none"] += 1
            self._unfit, stored = "the stored mount is not taken up: its covariance is none", None
        self._claims = Claims(config, None if self._paper else stored)
        if self._paper:
            self._pulse = _as_printed(config)
        elif stored is not None:
            mount = stored.mount
            self._stored = mount
            at = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad])
            self._pulse = Pulse(Filter(at, mount.covariance, Rules()))
            self._state = stored.state

    @property
    def refused(self) -> dict[str, int]:
        """Bad input so far, by reason."""
        return dict(self._refused + self._waiting.refused + self._way.refused)

    @property
    def left_out(self) -> int:
        """Lines so far that were too many in a frame."""
        return self._waiting.left_out

    @property
    def solved_keyframes(self) -> int:
        """Keyframes that the smoother solves together now."""
        return self._smoothing.size

    def step(self, message: Ticks | Bearings) -> tuple[Estimate | Extrinsics, ...]:
        match message:
            case Ticks():
                self._way.push(message)
            case Bearings():
                self._waiting.append(message)
        out: list[Estimate | Extrinsics] = []
        for sighting in self._waiting.due(self._way.newest_ns):
            out += self._work(sighting)
        return tuple(out)

    def settle(self) -> Result | None:
        """Everything so far, solved once more: the smoother's last word; None without a single clear solution."""
        self._adopt(self._smoothing.finished(), [])
        if self._smoothing.keyframes:
            self._smoothing.begin()
            self._pulse.mark()
            self._adopt(self._smoothing.finished(), [])
        return self._smoothing.result

    def close(self) -> tuple[Estimate | Extrinsics, ...]:
        """No more messages will come: what is held goes through without counts, and the last word is said.

        That is one more estimate for the last frame, with everything solved once more; and a claim, if it allows one.
        """
        out: list[Estimate | Extrinsics] = []
        for sighting in self._waiting.rest():
            out += self._work(sighting)
        last, self._told_last = self._told_last, None
        if last is None or self._paper:
            return tuple(out)
        self.settle()
        out += self._told(last.stamp_ns, [*last.reasons], final=True)
        self._told_last = None
        return tuple(out)

    def _work(self, sighting: Sighting) -> list[Estimate | Extrinsics]:
        reasons = list(sighting.reasons)
        if self._unfit:
            reasons.append(self._unfit)
            self._unfit = ""
        self._frames += 1
        motion, wrong = self._way.step(sighting.stamp_ns)
        if wrong:
            reasons.append(wrong)
        knock = ""
        if motion is not None:
            if wrong:
                self._pulse.forget_lines()
            if motion.wheels_m.any():  # at rest nothing moves, and nothing more becomes unsure
                self._pulse.predict(motion)
            is_asked = self._paper or self._way.is_at_keyframe
            if is_asked:
                self._see(sighting, reasons)
            still = not wrong and not motion.wheels_m.any()
            knock = self._claims.watched(sighting.stamp_ns, still, sighting, self._pulse, is_asked)
        self._lines_seen = sighting.track.size
        knock = knock or self._claims.compared(sighting.stamp_ns, self._smoothing.recent())
        if knock:
            self._reopen(knock)
        return self._told(sighting.stamp_ns, reasons, knocked=bool(knock))

    def _see(self, sighting: Sighting, reasons: list[str]) -> None:
        if not self._pulse.update(replace(sighting, std=np.sqrt(self._noise.bearings) * sighting.std)):
            self._lost(reasons)
            if self._paper:
                self._pulse = _as_printed(self._config)
            if self._stored is not None:
                self._stored = None
                self._claims.forget()
        if not self._paper:
            stamp_s = sighting.stamp_ns / SECOND
            self._smoothing.append(Keyed(stamp_s, self._way.take_key(), sighting.track, sighting.beta, sighting.std))
            if self._smoothing.is_due:
                self._adopt(self._smoothing.finished(), reasons)
                self._smoothing.begin()
                self._pulse.mark()

    def _lost(self, reasons: list[str]) -> None:
        """A covariance that is none is never mended: it is given up, counted and told."""
        self._refused["filter: covariance lost its definiteness"] += 1
        reasons.append("the filter lost its footing and starts anew")

    def _reopen(self, knock: str) -> None:
        """The camera has moved: what was seen before says nothing of where it is now."""
        self._moved = knock
        self._stored = None
        self._smoothing.finished()
        self._smoothing = Smoothing(Batch(self._config, self._noise), self._background)
        self._pulse = Pulse()
        self._steadiness = Steadiness(self._config.calibration)

    def _adopt(self, outcome: Outcome | None, reasons: list[str]) -> None:
        """The filter goes on from the batch's joint, each time there is one: it only bridges what comes between."""
        if outcome is None:
            return
        if outcome.broke:
            self._refused["smoother: equations not positive definite"] += 1
            reasons.append("the smoother lost its footing: its last solution is none")
        self._steadiness.step(outcome)
        result = outcome.result
        running = self._pulse.filter
        if result is None or len(result.centres) < 2:  # nothing to start from
            if self._stored is None:
                self._pulse.drop()
            return
        if self._stored is not None and running is not None:
            off = mount_difference(result.mount, running.mount)
            spread = result.honest_covariance + self._stored.covariance
            if float(off @ np.linalg.solve(spread, off)) > 21.1:  # chi-square of 3: 1 in 10 000
                reasons.append("the drive contradicts the stored mount, which is dropped")
                self._claims.forget()
                self._state = State.NOT_YET
            elif (np.diag(result.honest_covariance) > np.diag(self._stored.covariance)).any():
                return
            self._stored = None
        if result.doubted:  # errors that stay alike from frame to frame lead a filter away that takes them for noise
            self._pulse.drop()
        elif np.sqrt(result.honest_covariance[0, 0]) < LINEAR_RAD:
            if not self._pulse.seed(result):
                self._lost(reasons)
            self._noise = result.noise
            self._way.correct(result.corrections, result.noise)

    def _told(
        self, stamp_ns: int, reasons: list[str], final: bool = False, knocked: bool = False
    ) -> list[Estimate | Extrinsics]:
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
            driven_m=self._way.driven_m,
            turned_rad=self._way.turned_rad,
            lines_used=self._pulse.innovation.used,
            lines_new=self._pulse.innovation.new,
            lines_rejected=self._pulse.innovation.rejected,
            reasons=tuple(dict.fromkeys(reasons))[:16],
            **self._beside(mount),
        )
        self._told_last = estimate
        taken_back = self._claims.superseded(estimate, self._moved) if knocked else None
        if taken_back is not None:
            return [estimate, taken_back]
        if published is not None and self._stored is None and self._claims.is_news(estimate, final):
            return [estimate, self._claims.made(estimate, published)]
        return [estimate]

    def _beside(self, mount: Array | None) -> dict[str, Any]:
        """What the smoother says, beside the filter's mount."""
        result = self._smoothing.result
        if result is None or len(result.centres) < 2 or not self._is_shown(result.honest_covariance):
            return {}
        phi, rho, psi = result.mount.tolist()
        return {
            "smoother": Mount(phi, rho, psi, result.honest_covariance),
            "disagreement": 0.0 if mount is None else self._disagreement(mount),
            "bound_std": np.sqrt(np.diag(result.covariance)),
            "corrections": result.told,
        }

    def _disagreement(self, mount: Array) -> float:
        """Of filter and smoother, in sigmas."""
        result = self._smoothing.result
        if result is None or self._stored is not None:
            return 0.0
        off = mount_difference(mount, result.mount)
        square = float(off @ np.linalg.solve(result.honest_covariance, off))
        return float(np.sqrt(min(max(0.0, square), MOST_OFF**2)))

    def _mount(self) -> tuple[Array | None, Array | None]:
        """phi, rho, psi and the covariance that may be claimed, without what only the wheels' noise has shown.

        Nor with what the filter alone makes of the frames since the last solution: it takes the corrections for known,
        and bends its lines to each frame before the next; within three frames sigma may halve and rho be 6 of it off.
        """
        running, result = self._pulse.filter, self._smoothing.result
        if running is not None:
            covariance = running.mount_covariance
            if self._stored is not None:
                covariance = larger(covariance, self._stored.covariance)
            elif result is not None:
                covariance = larger(covariance, result.covariance) + result.excess
            return running.mount, evened(covariance)
        if result is not None and len(result.centres) >= 2:
            return result.mount, result.honest_covariance
        return None, None

    def _is_shown(self, covariance: Array) -> bool:
        outcome = self._smoothing.outcome
        seen = None if self._stored is not None else outcome.seen
        return self._paper or is_told(covariance, seen, outcome.doubted)

    def _judged(self, mount: Array | None, covariance: Array | None) -> Verdict:
        result, outcome = self._smoothing.result, self._smoothing.outcome
        shown = Shown(
            frames=self._frames,
            lines=self._lines_seen,
            ticks=self._way.is_known,
            driven_m=self._way.driven_m,
            turned_rad=self._way.turned_rad,
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
            doubted=outcome.doubted,
            steady=self._steadiness.keyframes,
            phi_rad=None if mount is None else float(mount[0]),
        )
        judged = verdict(shown, self._config.calibration, self._state)
        if judged.state is State.CALIBRATED:
            self._moved = ""
        if not self._moved:
            return judged
        return verdict(replace(shown, moved=f"{self._moved}; calibrating anew"), self._config.calibration, self._state)

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


def _as_printed(config: Config) -> Pulse:
    """The paper's filter, from measurement by hand."""
    c = config.calibration
    at = np.array([c.start_phi_rad, c.start_rho_m, c.start_psi_rad])
    rules = rules_of_the_paper(config.robot.wheel_base_m, config.encoder.noise_k_m)
    return Pulse(Filter(at, np.diag([0.5**2, 0.1**2, 0.5**2]), rules))


def _is_covariance(matrix: Array) -> bool:
    return bool(np.isfinite(matrix).all()) and np.allclose(matrix, matrix.T) and factor(matrix) is not None
