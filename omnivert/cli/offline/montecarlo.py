"""`omnivert montecarlo`: many synthetic drives against the theoretical limit."""

import difflib
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from omnivert.cli import say
from omnivert.cli.offline import results
from omnivert.cli.offline.montecarlo_watched import WATCHED, watched
from omnivert.cli.offline.study_targets import numbers, tell_targets
from omnivert.cli.outputs import made_folder
from omnivert.cli.settings import ConfigOption, JsonOption, settings
from omnivert.errors import UseError

if TYPE_CHECKING:
    from omnivert.studies.presets import Case

PATHS = "paper,alternate,straight,turn,arc,still"


OF_PRESETS = ("preset", "runs", "seed", "jobs", "plots", "config", "as_json")  # what a preset leaves open


def montecarlo(
    context: typer.Context,
    paths: Annotated[str, typer.Option(help="Which paths, with commas between.")] = PATHS,
    preset: Annotated[
        str | None, typer.Option(help="A study with targets: world, one-line, degenerate, corrections, knock or long.")
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=1_000_000, help="Drives of each path.")] = 10,
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="Of the first drive; the next has one more.")] = 1,
    bearing_mrad: Annotated[float, typer.Option(min=0.001, max=1000.0, help="Sigma of a bearing.")] = 3.0,
    noise_k: Annotated[
        float | None, typer.Option(min=1e-12, max=0.1, help="K of the wheels, m; else the configuration's.")
    ] = None,
    outliers: Annotated[float, typer.Option(min=0.0, max=1.0, help="Share of bearings that point anywhere.")] = 0.05,
    visible: Annotated[float, typer.Option(min=0.1, max=1000.0, help="Lines seen in a frame, on average.")] = 10.0,
    lines: Annotated[
        int | None, typer.Option(min=0, max=10_000, help="Lines in the world; else three times as many.")
    ] = None,
    lasting: Annotated[bool, typer.Option("--lasting", help="Lines neither die nor leave.")] = False,
    repeat: Annotated[int, typer.Option(min=1, max=10_000, help="Times that the path is driven.")] = 1,
    radius: Annotated[float, typer.Option(min=0.01, max=1000.0, help="Of the path arc, m.")] = 0.5,
    distance_scale: Annotated[float, typer.Option(min=0.01, max=1e6, help="Makes all lines far.")] = 1.0,
    time_offset_ms: Annotated[float, typer.Option(min=-1000.0, max=1000.0, help="The camera stamps late.")] = 0.0,
    wheel_ratio: Annotated[float, typer.Option(min=0.5, max=2.0, help="Right / left true diameter.")] = 1.0,
    base_factor: Annotated[float, typer.Option(min=0.5, max=2.0, help="True / configured wheel base.")] = 1.0,
    free: Annotated[bool, typer.Option("--free", help="Estimate time offset, wheel ratio and base, always.")] = False,
    hours: Annotated[float, typer.Option(min=0.01, max=1000.0, help="Of each drive of --preset long.")] = 10.0,
    jobs: Annotated[int, typer.Option(min=1, max=256, help="Processes.")] = 1,
    plots: Annotated[Path | None, typer.Option("--plots", help="Folder for charts.")] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Seeded synthetic drives: errors over the Cramér-Rao bound, honesty of sigmas, false claims."""
    _check_together(context, preset)
    from omnivert.simulation.recording import Scene
    from omnivert.studies.montecarlo import runs_of
    from omnivert.studies.oracle import oracle
    from omnivert.studies.presets import Case
    from omnivert.studies.summary import study
    from omnivert.threads import one_thread

    one_thread()
    if preset in WATCHED:
        watched(preset, runs, seed, hours, jobs, plots, settings(config), as_json)
        return
    cases: Sequence[Case]
    if preset is not None:
        cases = _preset(preset)
    else:
        scene = Scene(
            bearing_std_rad=1e-3 * bearing_mrad,
            outliers=outliers,
            visible=visible,
            lines=lines,
            lasting=lasting,
            distance_scale=distance_scale,
            radius_m=radius,
            repeat=repeat,
            time_offset_s=1e-3 * time_offset_ms,
            wheel_ratio=wheel_ratio,
            base_factor=base_factor,
        )
        cases = _cases(paths, scene, noise_k, free)
    chosen = settings(config)
    if plots is not None:
        made_folder(plots)
    done = []
    total = runs * len(cases)
    with (
        say.progress(f"{total} drives", total) as bar,
        closing(runs_of(cases, chosen, runs, seed, min(jobs, total), oracle)) as coming,
    ):
        for run in coming:
            done.append(run)
            bar.step()
    order = [case.name for case in cases]
    done.sort(key=lambda run: (order.index(run.case), run.seed))  # sums come out the same whoever was done first
    figures = study(cases, done, seed)
    if plots is not None:
        from omnivert.studies.charts import write_charts

        for path in write_charts(plots, cases, done, seed):
            say.wrote(path)
    if as_json:
        say.json_result({"preset": preset, "seed": seed, **figures})
    else:
        _tell(cases, figures)


def _check_together(context: typer.Context, preset: str | None) -> None:
    """raises UseError when an option was given that would change nothing"""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    given = {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}
    match preset:
        case None:
            idle, because = given & {"hours"}, "it is of --preset long alone"
        case "long":
            idle, because = (
                given - {*OF_PRESETS, "hours"} | given & {"runs"},
                "long is one drive of each kind, as it is",
            )
        case _:
            idle, because = given - {*OF_PRESETS}, "a preset has its own drives"
    if idle:
        option = f"--{min(idle).replace('_', '-')}"
        beside = f"beside --preset {preset}" if preset is not None else "without a preset"
        raise UseError("OV205", f"omnivert montecarlo: {option} {beside}", because, "leave it out")


def _preset(name: str) -> "tuple[Case, ...]":
    from omnivert.studies.presets import PRESETS

    if name not in PRESETS:
        known = [*PRESETS, *WATCHED]
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        raise UseError("OV205", f"--preset {name} is not known", help=f"--preset {' or '.join(near or known)}")
    return PRESETS[name]


def _cases(paths: str, scene: Any, noise_k: float | None, free: bool) -> "list[Case]":
    from dataclasses import replace

    from omnivert.simulation.robot import Path as Way
    from omnivert.studies.presets import Case

    known = get_args(Way)
    cases = []
    for name in dict.fromkeys(part.strip() for part in paths.split(",")):
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            raise UseError("OV205", f"--paths {name} is not known", help=f"--paths {','.join(near or known)}")
        cases.append(Case(name, replace(scene, path=name), noise_k, free=free))
    return cases


def _tell(cases: "Sequence[Case]", figures: dict[str, Any]) -> None:
    head = (
        "path",
        "runs",
        "error/bound: filter",
        "smoother",
        "NEES/3",
        "95 % band",
        "calibrated",
        "false",
        "wrong",
        "",
    )
    table: list[tuple[str, ...]] = [head]
    each = {case.name: figures["paths"][case.name] if len(cases) > 1 else figures for case in cases}
    for name, own in each.items():
        table.append((name, *_row(own)))
    if len(cases) > 1:
        table.append(("all", *_row(figures)))
    for line in results.aligned(table):
        say.result(line)
    for name, part in figures["corrections"].items():
        unit, scale = ("ms", 1e3) if name == "time_offset" else ("%", 100.0)
        say.result(
            f"{name}: freed in {part['runs']} runs, error {scale * part['mean_error']:+.2f} mean, "
            f"{scale * part['rms_error']:.2f} rms, bound {scale * part['bound_median']:.2f} {unit}"
        )
    for reason, number in figures["false_reasons"].items():
        say.result(f"false: {reason} in {number} runs")
    tell_targets(cases, each)


def _row(own: dict[str, Any]) -> tuple[str, ...]:
    return (
        str(own["runs"]),
        numbers(own["efficiency"]["filter"]),
        numbers(own["efficiency"]["smoother"]),
        numbers(own["nees_over_3_mean"]),
        "-" if own["nees_band"] is None else f"{own['nees_band'][0]:.2f} to {own['nees_band'][1]:.2f}",
        str(own["calibrated_runs"]),
        str(own["false_calibrated"]),
        str(own["wrong_runs"]),
        "",
    )
