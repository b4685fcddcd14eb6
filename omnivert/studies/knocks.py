"""Does a knock get through? Whole drives through the whole calibration, with a camera that is hit once it is sure."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, chndtr

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.kalman.model import mount_difference
from omnivert.config import Config
from omnivert.messages import Bearings, Extrinsics, State
from omnivert.simulation.recording import Drive, Knock, recorded
from omnivert.studies.bound import knock_bound
from omnivert.studies.presets import Case
from omnivert.studies.run import with_noise

Array = NDArray[np.float64]

TURNED_RAD, SHIFTED_M = float(np.deg2rad(2.0)), 0.02
KINDS = ("yaw", "forward", "left")
SETTLED_S, WITHIN_S = 20.0, 30.0  # the knock comes so long after the first claim, and then at any moment of so long
SOON_S, AT_LAST_S = 3.0, 60.0
HONEST = 21.1  # chi-square of 3: 1 in 10 000
SAID = re.compile(r"([0-9.]+) s before this was noticed")


@dataclass(frozen=True, slots=True)
class Knocked:
    """What became of one knock; times in seconds of driving after the first frame that it shows in."""

    case: str
    seed: int
    kind: str
    watched_s: float  # from the first claim to the knock, or to the end when there was none
    is_hit: bool  # False: no claim came in time for one
    false_alarms: int  # before it
    best_chance: float | None  # of being seen within 3 s by the best test there is, told when to look
    noticed_s: float | None
    turn_s: float | None  # to the end of the next turn on the spot; None when the drive ends before
    told_off_s: float | None  # when the knock is said to have been, less when it was
    superseded: bool  # the last claim came once more, as one that no longer holds
    recalibrated_s: float | None
    honest: bool | None  # the new claim holds the new place within its own sigmas; None when there is none


def knocked_of(case: Case, config: Config, seed: int) -> Knocked:
    """Drive until the first claim, hit the camera some time later, drive on until it is calibrated anew."""
    config = with_noise(config, case.noise_k_m)
    rng = np.random.default_rng([seed, 1])
    kind = KINDS[seed % len(KINDS)]
    sign = float(rng.choice([-1.0, 1.0]))
    drive = recorded(case.scene, config, seed)
    calibrator, claimed, first, hit_s = Calibrator(config), None, None, np.inf
    alarms: list[float] = []
    at: Drive = drive
    seen_hit, superseded, said, new = np.inf, False, None, None
    for index in range(len(drive.messages)):
        message = at.messages[index]
        now = 1e-9 * message.stamp_ns
        if isinstance(message, Bearings) and now >= hit_s:
            seen_hit = min(seen_hit, now)
        for told in calibrator.step(message):
            stamp = 1e-9 * told.stamp_ns
            if isinstance(told, Extrinsics) and told.state is State.CALIBRATED:
                claimed = told
                if first is None:
                    first = stamp
                    hit_s = stamp + SETTLED_S + float(rng.uniform(0.0, WITHIN_S))
                    at = recorded(replace(case.scene, knock=_knock(kind, sign, hit_s)), config, seed)
                elif alarms:
                    new = told
            elif isinstance(told, Extrinsics):
                alarms.append(stamp)
                superseded = claimed is not None and told.mount == claimed.mount
                said = _said(told)
        if new is not None or (alarms and alarms[-1] < seen_hit):
            break
    before = sum(alarm < seen_hit for alarm in alarms)
    hit = bool(np.isfinite(seen_hit)) and not before
    noticed = alarms[0] - seen_hit if hit and alarms else None
    return Knocked(
        case=case.name,
        seed=seed,
        kind=kind,
        watched_s=0.0 if first is None else min(seen_hit, now) - first,
        is_hit=hit,
        false_alarms=before,
        best_chance=_best_chance(at, config, seen_hit + SOON_S) if hit else None,
        noticed_s=noticed,
        turn_s=_next_turn(at, seen_hit) if hit else None,
        told_off_s=None if noticed is None or said is None else alarms[0] - said - seen_hit,
        superseded=noticed is not None and superseded,
        recalibrated_s=None if noticed is None or new is None else 1e-9 * new.stamp_ns - seen_hit,
        honest=None if noticed is None or new is None else _honest(new, at),
    )


def knock_study(cases: Sequence[Case], runs: Sequence[Knocked]) -> dict[str, Any]:
    """Figures of each case below "paths", with its targets beside them; of every run what became of it."""
    from omnivert.studies.summary import met

    paths = {}
    for case in cases:
        own = [run for run in runs if run.case == case.name]
        figures = knock_figures(own)
        figures["by_kind"] = {kind: knock_figures([run for run in own if run.kind == kind]) for kind in KINDS}
        figures["targets_met"] = {name: met(figures, name, *within) for name, within in case.targets.items()}
        paths[case.name] = figures
    return {"runs": len(runs), "paths": paths}


def knock_figures(runs: Sequence[Knocked]) -> dict[str, Any]:
    """Shares are of the knocks; null where there was none."""
    hits = [run for run in runs if run.is_hit]
    late = [np.inf if run.noticed_s is None else run.noticed_s for run in hits]
    off = [run.told_off_s for run in hits if run.told_off_s is not None]
    again = [run.recalibrated_s for run in hits if run.recalibrated_s is not None]
    best = [run.best_chance for run in hits if run.best_chance is not None]
    in_time = [
        noticed <= max(AT_LAST_S, run.turn_s or 0.0) for run, noticed in zip(hits, late, strict=True)
    ]  # by the next turn, or within a minute

    def share(values: Sequence[bool]) -> float | None:
        return float(np.mean(values)) if values else None

    noticed = [value for value in late if np.isfinite(value)]
    return {
        "runs": len(runs),
        "knocks": len(hits),
        "never_watched": sum(not run.is_hit and not run.false_alarms for run in runs),
        "watched_h": sum(run.watched_s for run in runs) / 3600.0,
        "false_alarms": sum(run.false_alarms for run in runs),
        "noticed_within_3_s_share": share([value <= SOON_S for value in late]),
        "best_within_3_s_share": float(np.mean(best)) if best else None,
        "noticed_by_next_turn_share": share(
            [run.turn_s is None or value <= run.turn_s for run, value in zip(hits, late, strict=True)]
        ),
        "noticed_by_turn_or_60_s_share": share(in_time),
        "noticed_share": share([bool(np.isfinite(value)) for value in late]),
        "noticed_s": _spread(noticed),
        "told_off_s": _spread([abs(value) for value in off]),
        "superseded_share": share([run.superseded for run in hits]),
        "recalibrated_share": share([run.recalibrated_s is not None for run in hits]),
        "recalibrated_s": _spread(again),
        "honest_share": share([run.honest for run in hits if run.honest is not None]),
    }


def _best_chance(drive: Drive, config: Config, until_s: float) -> float:
    """With which the knock is seen by who knows its frame, and is wrong as seldom as the watchdog.

    Whatever weighs the drive's bearings and wheels: its chi-square is one of three degrees of freedom, of which the
    knock over its bound is the noncentrality.
    """
    knock = drive.scene.knock
    assert knock is not None
    size = np.array([knock.yaw_rad, knock.forward_m, knock.left_m])
    noncentral = float(size @ np.linalg.solve(knock_bound(drive, config, until_s), size))
    return 1.0 - float(chndtr(chdtri(3.0, config.calibration.alarm_chance), 3.0, noncentral))


def _spread(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    median, most = np.quantile(values, (0.5, 0.95)).tolist()
    return {"median": median, "p95": most, "max": float(max(values))}


def _knock(kind: str, sign: float, at_s: float) -> Knock:
    match kind:
        case "yaw":
            return Knock(at_s, yaw_rad=sign * TURNED_RAD)
        case "forward":
            return Knock(at_s, forward_m=sign * SHIFTED_M)
        case _:
            return Knock(at_s, left_m=sign * SHIFTED_M)


def _said(told: Extrinsics) -> float | None:
    """How long ago the knock was, by what it says for people."""
    found = next((match for reason in told.reasons if (match := SAID.search(reason))), None)
    return None if found is None else float(found[1])


def _next_turn(drive: Drive, since_s: float) -> float | None:
    """Until the next turn on the spot ends; one that goes on at the knock counts."""
    right, left = np.diff(drive.sample_wheels_m, axis=0).T
    turns = (right * left < 0.0) & (drive.sample_time_s[1:] > since_s)
    begin = int(np.argmax(turns))
    if not turns[begin]:
        return None
    ends = np.flatnonzero(~turns[begin:])
    return float(drive.sample_time_s[begin + int(ends[0])] - since_s) if ends.size else None


def _honest(claim: Extrinsics, drive: Drive) -> bool:
    mount = claim.mount
    off = mount_difference(np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]), drive.mount_at[-1])
    return float(off @ np.linalg.solve(mount.covariance, off)) < HONEST
