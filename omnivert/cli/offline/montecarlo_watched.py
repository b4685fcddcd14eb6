"""`omnivert montecarlo --preset knock` and `--preset long`: what the watchdog and many hours make of a calibration."""

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnivert.cli import say
from omnivert.cli.offline import results
from omnivert.cli.offline.study_targets import numbers, tell_targets
from omnivert.cli.outputs import made_folder

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.studies.endurance import Room
    from omnivert.studies.knocks import Knocked

WATCHED = ("knock", "long")


def watched(
    preset: str, runs: int, seed: int, hours: float, jobs: int, plots: Path | None, config: "Config", as_json: bool
) -> None:
    """One of the two studies.

    runs   knocks of each case; long drives there is one of each
    """
    from omnivert.studies.presets import KNOCKS, LONG

    if plots is not None:
        made_folder(plots)
    cases = KNOCKS if preset == "knock" else LONG
    if preset == "knock":
        from omnivert.studies.knocks import knock_study

        knocked = _knocks(config, runs, seed, jobs)
        figures = knock_study(cases, knocked)
    else:
        from omnivert.studies.endurance import endurance_study

        rooms = _rooms(config, seed, hours, jobs)
        figures = endurance_study(cases, rooms)
    if plots is not None:
        from omnivert.studies import watched_charts as charts

        path = plots / f"montecarlo-{preset}.png"
        if preset == "knock":
            charts.write_knocks(path, cases, knocked)
        else:
            charts.write_rooms(path, cases, rooms)
        say.wrote(path)
    if as_json:
        say.json_result({"preset": preset, "seed": seed, **figures})
        return
    for line in results.aligned(_knock_table(figures) if preset == "knock" else _long_table(figures)):
        say.result(line)
    tell_targets(cases, figures["paths"])


def _knocks(config: "Config", runs: int, seed: int, jobs: int) -> "list[Knocked]":
    from omnivert.studies.knocks import knocked_of
    from omnivert.studies.montecarlo import worked
    from omnivert.studies.presets import KNOCKS

    todo = ((case, config, seed + k) for k in range(runs) for case in KNOCKS)
    total = runs * len(KNOCKS)
    done = []
    with say.progress(f"{total} knocks", total) as bar, closing(worked(knocked_of, todo, min(jobs, total))) as coming:
        for run in coming:
            done.append(run)
            bar.step()
    return sorted(done, key=lambda run: (run.case, run.seed))  # the same whoever was done first


def _rooms(config: "Config", seed: int, hours: float, jobs: int) -> "list[Room]":
    """With one process room by room, so that the memory of the second drive is told beside that of the first."""
    from omnivert.studies.endurance import drive_of, rooms_of
    from omnivert.studies.montecarlo import worked
    from omnivert.studies.presets import LONG

    total = len(LONG) * max(1, round(60.0 * hours))
    found: list[Room] = []
    with say.progress(f"{len(LONG)} drives of {hours:g} h", total) as bar:
        if jobs > 1:
            todo = ((case, config, seed, hours) for case in LONG)
            with closing(worked(drive_of, todo, min(jobs, len(LONG)))) as coming:
                for drive in coming:
                    found += drive
                    bar.reach(len({room.case for room in found}) * total // len(LONG), total)
        else:
            for number, case in enumerate(LONG):
                for room in rooms_of(case, config, seed, hours):
                    found.append(room)
                    bar.reach(number * total // len(LONG) + round(60.0 * min(room.hours, hours)), total)
    return sorted(found, key=lambda room: (room.case, room.hours))


def _knock_table(figures: dict[str, Any]) -> list[tuple[str, ...]]:
    table: list[tuple[str, ...]] = [
        ("bearings", "knock", "knocks", "within 3 s", "by turn or 60 s", "noticed, s", "recalibrated, s", "false")
    ]
    for name, case in figures["paths"].items():
        for kind, own in (*case["by_kind"].items(), ("all", case)):
            table.append(
                (
                    name,
                    kind,
                    str(own["knocks"]),
                    numbers(own["noticed_within_3_s_share"]),
                    numbers(own["noticed_by_turn_or_60_s_share"]),
                    _spread(own["noticed_s"]),
                    _spread(own["recalibrated_s"]),
                    str(own["false_alarms"]),
                )
            )
    return table


def _spread(value: dict[str, float] | None) -> str:
    return "-" if value is None else f"{value['median']:.1f}, at most {value['max']:.1f}"


def _long_table(figures: dict[str, Any]) -> list[tuple[str, ...]]:
    table: list[tuple[str, ...]] = [
        ("bearings", "hours", "frames", "false alarms", "memory, MB", "MB/h", "solve, ms", "ms/h", "frame, ms")
    ]
    for name, own in figures["paths"].items():
        table.append(
            (
                name,
                numbers(own["hours"]),
                str(own["frames"]),
                str(own["false_alarms"]),
                _ends(own["memory_mb"]),
                numbers(own["memory_growth_mb_per_h"]),
                _ends(own["solve_median_ms"]),
                numbers(own["solve_growth_ms_per_h"]),
                _ends(own["frame_ms"]),
            )
        )
    return table


def _ends(values: list[float]) -> str:
    return f"{values[0]:.0f} to {values[-1]:.0f}" if values else "-"
