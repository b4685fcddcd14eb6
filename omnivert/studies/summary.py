"""The figures of a study: how near the errors come to the bound, and whether sigmas and claims hold."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from omnivert.messages import State
from omnivert.studies.presets import Case
from omnivert.studies.run import FALSE_SIGMAS, WRONG, Run, Solution

Array = NDArray[np.float64]
Figures = dict[str, Any]

LARGE_RHO_M = 0.15  # below, the bound of phi grows with 1 / rho, and no longer says all
DRAWS = 1000  # of the bootstrap


def study(cases: Sequence[Case], runs: Sequence[Run], seed: int) -> Figures:
    """Pooled figures; below "paths" the same of each case, where there are several.

    seed  of the bootstrap
    """
    pooled = summary(runs, seed)
    if len(cases) > 1:
        pooled["paths"] = {}
    for case in cases:
        own = summary([run for run in runs if run.case == case.name], seed)
        if case.unseen:
            own["named_share"] = _share([named(case, run) for run in runs if run.case == case.name])
        own["targets_met"] = {name: met(own, name, *case.targets[name]) for name in case.targets}
        if len(cases) > 1:
            pooled["paths"][case.name] = own
        else:
            pooled = own
    return pooled


def summary(runs: Sequence[Run], seed: int) -> Figures:
    """The figures of these runs; null where no run has what a figure is of."""
    filters = [(run, run.filter) for run in runs if run.filter is not None]
    smoothers = [(run, run.smoother) for run in runs if run.smoother is not None]
    both = [(run.filter, run.smoother) for run in runs if run.filter is not None and run.smoother is not None]
    published = [[part for part in (run.filter, run.smoother) if part is not None] for run in runs]
    claims = [run.first_claim_s for run in runs if run.first_claim_s is not None]
    oracle = [r for run in runs if (r := _to_oracle(run)) is not None]
    band = nees_band(len(filters))
    nees = _nees(filters)
    names = sorted({state.value for run in runs for state in run.parameters}, key=[s.value for s in State].index)
    return {
        "runs": len(runs),
        "efficiency": {"filter": efficiency(filters), "smoother": efficiency(smoothers)},
        "efficiency_95": {"filter": bootstrap(filters, seed), "smoother": bootstrap(smoothers, seed)},
        "efficiency_rho_above_0.15": {
            "filter": efficiency(_large(filters)),
            "smoother": efficiency(_large(smoothers)),
        },
        "runs_rho_above_0.15": len(_large(filters)),
        "bound_inflation": _inflation(runs),
        "claimed_over_bound": _medians([part.sigma / _std(run.bound) for run, part in filters]),
        "nees_over_3_mean": nees,
        "nees_over_3_smoother": _nees(smoothers),
        "nees_band": band,
        "nees_in_band": None if nees is None or band is None else int(band[0] <= nees <= band[1]),
        "paired_filter_over_smoother": _paired(both),
        "inside_3_sigma_share": _share([bool((np.abs(p.error) < 3.0 * p.sigma).all()) for _, p in filters]),
        "wrong_runs": sum(any((np.abs(p.error) > WRONG).any() for p in parts) for parts in published),
        "beyond_6_sigma": sum(
            any((np.abs(p.error) > FALSE_SIGMAS * p.sigma).any() for p in parts) for parts in published
        ),
        "false_calibrated": sum(bool(run.false_claims) for run in runs),
        "false_reasons": _counted([reason for run in runs for reason in run.false_claims]),
        "calibrated_runs": sum(run.state is State.CALIBRATED for run in runs),
        "calibrated_share": _share([run.state is State.CALIBRATED for run in runs]),
        "claimed_runs": len(claims),
        "first_claim_s_median": float(np.median(claims)) if claims else None,
        "without_filter": len(runs) - len(filters),
        "without_smoother": len(runs) - len(smoothers),
        "ratio_to_oracle_median": float(np.median(oracle)) if oracle else None,
        "states": {name: [sum(run.parameters[k].value == name for run in runs) for k in range(3)] for name in names},
        "alarm_runs": sum(bool(run.alarm_s) for run in runs),
        "corrections": corrections(runs),
        **_corrections_overall(runs),
        "seconds_median": float(np.median([run.seconds for run in runs])) if runs else None,
    }


def efficiency(parts: Sequence[tuple[Run, Solution]]) -> list[float] | None:
    """rms of error / that run's own bound, of phi, rho and psi."""
    if not parts:
        return None
    return [float(v) for v in np.sqrt(np.mean(normalised(parts) ** 2, axis=0))]


def normalised(parts: Sequence[tuple[Run, Solution]]) -> Array:
    """(n, 3) error / bound."""
    return np.array([part.error / _std(run.bound) for run, part in parts]).reshape(-1, 3)


def bootstrap(parts: Sequence[tuple[Run, Solution]], seed: int) -> list[list[float]] | None:
    """95 % of the efficiencies: for each parameter the ends."""
    if not parts:
        return None
    squares = normalised(parts) ** 2
    rng = np.random.default_rng(seed)
    drawn = np.array(
        [np.sqrt(squares[rng.integers(0, squares.shape[0], squares.shape[0])].mean(axis=0)) for _ in range(DRAWS)]
    )
    return [[float(v) for v in np.quantile(drawn[:, k], (0.025, 0.975))] for k in range(3)]


def nees_band(runs: int) -> list[float] | None:
    """Where 95 % of the means of NEES / 3 of so many honest runs lie."""
    return None if runs == 0 else [float(chi2.ppf(p, 3 * runs)) / (3 * runs) for p in (0.025, 0.975)]


def corrections(runs: Sequence[Run]) -> Figures:
    """Of each freed correction: runs, mean and rms of the error, sigma over bound, share within 3 sigma."""
    found: Figures = {}
    for name in dict.fromkeys(part.name for run in runs for part in run.corrections):
        parts = [part for run in runs for part in run.corrections if part.name == name]
        errors = np.array([part.error for part in parts])
        found[name] = {
            "runs": len(parts),
            "mean_error": float(errors.mean()),
            "mean_error_std": float(errors.std(ddof=1) / np.sqrt(len(parts))) if len(parts) > 1 else None,
            "rms_error": float(np.sqrt((errors**2).mean())),
            "bound_median": float(np.median([part.bound for part in parts])),
            "claimed_over_bound": float(np.median([part.std / part.bound for part in parts])),
            "inside_3_sigma_share": float(np.mean([abs(part.error) < 3.0 * part.std for part in parts])),
        }
    return found


# Greatest mean error that is no bias worth a word: s, right / left, true / configured, and phi in rad.
MEAN_LIMITS = {"time_offset": 0.002, "wheel_ratio": 0.003, "wheel_base": 0.003}
MEAN_PHI_RAD = float(np.deg2rad(0.15))


def _corrections_overall(runs: Sequence[Run]) -> Figures:
    """The worst of all freed corrections; mean excess: |mean| - 2 standard errors - its limit, over the limit."""
    each = corrections(runs)
    missing = {"time_offset", "wheel_ratio", "wheel_base"} - each.keys()
    if missing or len(runs) < 2:
        return {
            "corrections_inside_3_sigma_share": None,
            "corrections_claimed_over_bound": None,
            "corrections_mean_excess": None,
        }
    excess = [
        (abs(part["mean_error"]) - 2.0 * (part["mean_error_std"] or np.inf)) / MEAN_LIMITS[name] - 1.0
        for name, part in each.items()
    ]
    phi = np.array([run.filter.error[0] for run in runs if run.filter is not None])
    if phi.size > 1:
        excess.append((abs(phi.mean()) - 2.0 * phi.std(ddof=1) / np.sqrt(phi.size)) / MEAN_PHI_RAD - 1.0)
    return {
        "corrections_inside_3_sigma_share": min(part["inside_3_sigma_share"] for part in each.values()),
        "corrections_claimed_over_bound": max(part["claimed_over_bound"] for part in each.values()),
        "corrections_mean_excess": float(max(excess)),
    }


def named(case: Case, run: Run) -> bool:
    """The verdict says what this drive leaves unseen."""
    return any(re.search(case.unseen, reason) for reason in (*run.reasons, run.next_manoeuvre))


def figure(figures: Figures, name: str) -> Any:
    """A figure by the name that targets have for it: efficiency_filter, efficiency_smoother_rho_above_0.15."""
    match = re.fullmatch(r"efficiency_(filter|smoother)(_rho_above_0\.15)?", name)
    return figures.get(name) if match is None else figures[f"efficiency{match[2] or ''}"][match[1]]


def met(figures: Figures, name: str, low: float, high: float) -> bool | None:
    """Whether every number of a figure lies there; null where it is not known."""
    value = figure(figures, name)
    if value is None:
        return None
    return all(low <= part <= high for part in (value if isinstance(value, list) else [value]))


def _std(covariance: Array) -> Array:
    return np.sqrt(np.diag(covariance))


def _large(parts: Sequence[tuple[Run, Solution]]) -> list[tuple[Run, Solution]]:
    return [(run, part) for run, part in parts if run.mount[1] >= LARGE_RHO_M]


def _nees(parts: Sequence[tuple[Run, Solution]]) -> float | None:
    return float(np.mean([part.nees for _, part in parts])) / 3.0 if parts else None


def _paired(both: Sequence[tuple[Solution, Solution]]) -> list[float] | None:
    """rms of the filter's errors over those of the smoother, in the same runs; each by the smoother's sigma, so that
    no run owns the figure."""
    if not both:
        return None
    first = np.array([a.error / b.sigma for a, b in both])
    second = np.array([b.error / b.sigma for _, b in both])
    ratio = np.sqrt((first**2).mean(axis=0) / np.maximum((second**2).mean(axis=0), 1e-300))
    return [float(v) for v in ratio]


def _to_oracle(run: Run) -> float | None:
    """Size of the smoother's error over that of the oracle's, both by the bound's ellipsoid."""
    if run.smoother is None or run.oracle is None:
        return None
    size = [float(e @ np.linalg.solve(run.bound, e)) for e in (run.smoother.error, run.oracle.error)]
    return float(np.sqrt(size[0] / max(size[1], 1e-300)))


def _inflation(runs: Sequence[Run]) -> list[float] | None:
    """What the freed corrections cost: bound with them over bound without, medians."""
    return _medians([_std(run.bound) / _std(run.bound_held) for run in runs])


def _medians(values: Sequence[Array]) -> list[float] | None:
    return [float(v) for v in np.median(values, axis=0)] if values else None


def _share(values: Sequence[bool]) -> float | None:
    return float(np.mean(values)) if values else None


def _counted(words: Sequence[str]) -> dict[str, int]:
    return {word: words.count(word) for word in dict.fromkeys(words)}
