"""`omnivert bench`: how fast it is here, beside a yardstick in the same run."""

import platform
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omnivert.cli import say
from omnivert.cli.bench import recording as bench_recording
from omnivert.cli.bench import ticks as bench_ticks
from omnivert.cli.bench import vision as bench_vision
from omnivert.cli.given import count
from omnivert.cli.offline import results
from omnivert.cli.settings import PACKAGED, ConfigOption, JsonOption, ModeOption, opened, settings, title, with_mode
from omnivert.errors import DataError
from omnivert.wire.channels import FRAME

if TYPE_CHECKING:
    from omnivert.bench.calibration import CalibrationTimes
    from omnivert.bench.latency import Latency
    from omnivert.bench.pipeline import PipelineTimes

app = typer.Typer(help="Measure speed.")


@app.callback()
def root() -> None:
    """Measure speed."""


app.command("vision")(bench_vision.vision)
app.command("recording")(bench_recording.recording)
app.command("ticks")(bench_ticks.ticks)


@app.command("pipeline")
def pipeline(
    recording: Annotated[str, typer.Argument(metavar="[REC]", help="An .mcap file, or the word corridor.")] = PACKAGED,
    config: ConfigOption = None,
    mode: ModeOption = None,
    bus: Annotated[bool, typer.Option("--bus/--no-bus", help="Measure latency over the bus, too.")] = True,
    rounds: Annotated[int, typer.Option(min=5, max=10000, help="Frames for the latency.")] = 100,
    as_json: JsonOption = False,
) -> None:
    """Milliseconds of every stage from frame to estimate, and latency over the bus."""
    from omnivert.bench.pipeline import pipeline_times
    from omnivert.threads import one_thread

    one_thread()
    source = opened(recording)
    frames = count(source, FRAME)
    if not frames:
        raise DataError("OV101", f"there are no frames in {title(recording)}", help="omnivert bench pipeline corridor")
    rounds = min(rounds, frames)
    chosen = source.config(with_mode(settings(config), mode))
    with say.progress("stages", frames) as bar:
        times = pipeline_times(source, chosen, bar.step)
    over_bus = None
    if bus:
        from omnivert.bench.latency import latency

        with say.progress("latency", rounds) as bar:
            over_bus = latency(source, chosen, rounds, bar.step)
    if as_json:
        say.json_result(_json(title(recording), times, over_bus))
    else:
        _tell(times, over_bus)


@app.command("calibration")
def calibration(
    config: ConfigOption = None,
    plots: Annotated[Path | None, typer.Option("--plots", help="Folder for charts.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Time of the filter against lines, and of the global start against the length of the drive; simulated."""
    from omnivert.bench.calibration import POINTS, calibration_times
    from omnivert.threads import one_thread

    one_thread()
    if plots is not None:
        bench_vision.make(plots)
    with say.progress("calibration", POINTS) as bar:
        times = calibration_times(settings(config), moved=bar.step)
    if plots is not None:
        from omnivert.bench.charts import write_calibration_growth

        write_calibration_growth(plots / "calibration-growth.png", times)
        say.story(f"wrote   {plots / 'calibration-growth.png'}")
    if as_json:
        say.json_result({"machine": _machine(), **times.json()})
    else:
        _tell_calibration(times)


def sobel_pair(ms: float) -> str:
    """What times are measured in, so that those of two machines can be compared."""
    return f"a Sobel pair, two filters over the whole frame, takes {ms:.2f} ms here"


def _machine() -> str:
    return f"{platform.machine()} {platform.system()}, Python {platform.python_version()}"


def _tell_calibration(times: "CalibrationTimes") -> None:
    yard = times.sobel_pair.median_ms
    table = [("lines", "median ms", "p99 ms", "in Sobel pairs", "watchdog ms", "")]
    for point in times.filter:
        step = point.step
        figures = (f"{step.median_ms:.2f}", f"{step.p99_ms:.2f}", f"{step.median_ms / yard:.1f}")
        table.append((str(point.lines), *figures, f"{point.watchdog.median_ms:.2f}", ""))
    for row in results.aligned(table):
        say.result(row)
    if len(times.filter) > 1:
        fewer, more = times.filter[-2].lines, times.filter[-1].lines
        say.result(f"from {fewer} to {more} lines the time grows as lines^{times.filter_exponent:.1f}")
    say.result(sobel_pair(yard))
    say.result("")
    starts = [("drive", "frames", "global start s", "")]
    for start in times.start:
        starts.append(
            (f"{start.drive_s:.0f} s", str(start.frames), f"{start.seconds:.2f}", "" if start.found else "none")
        )
    for row in results.aligned(starts):
        say.result(row)
    if len(times.start) > 1:
        shorter, longer = times.start[0].drive_s, times.start[-1].drive_s
        say.result(
            f"from {shorter:.0f} to {longer:.0f} s of driving the time grows as length^{times.start_exponent:.1f}"
        )


def _json(name: str, times: "PipelineTimes", over_bus: "Latency | None") -> dict[str, Any]:
    yard = times.sobel_pair
    body: dict[str, Any] = {
        "recording": name,
        "machine": _machine(),
        "sobel_pair": yard.json(),
        "stages": {stage: spread.json(yard) for stage, spread in times.stages.items()},
        "vision_step": times.vision.json(yard),
        "calibration_step": times.calibration.json(yard),
        "filter_step": None if times.filter is None else times.filter.json(yard),
    }
    if over_bus is not None:
        body["frame_to_bearings"] = _latency_json(over_bus.frame_to_bearings)
        body["raw_zenoh_round"] = _latency_json(over_bus.raw_round)
        body["frame_bytes"] = over_bus.frame_bytes
    return body


def _latency_json(spread: Any) -> dict[str, Any]:
    return {"p50_ms": spread.median_ms, "p99_ms": spread.p99_ms, "count": spread.count}


def _tell(times: "PipelineTimes", over_bus: "Latency | None") -> None:
    yard = times.sobel_pair
    table = [("step", "median ms", "p99 ms", "in Sobel pairs", "")]
    rows = [*times.stages.items(), ("vision, whole frame", times.vision)]
    rows.append(("calibration, whole frame", times.calibration))
    if times.filter is not None:
        rows.append(("the filter of it", times.filter))
    for name, spread in rows:
        ratio = f"{spread.median_ms / yard.median_ms:.1f}"
        table.append((name, f"{spread.median_ms:.2f}", f"{spread.p99_ms:.2f}", ratio, ""))
    for row in results.aligned(table):
        say.result(row)
    say.result(sobel_pair(yard.median_ms))
    if over_bus is None:
        return
    say.result("")
    latencies = [("over the bus", "p50 ms", "p99 ms", "")]
    rounds = (
        ("frame sent, bearings back", over_bus.frame_to_bearings),
        ("as many bytes, no vision", over_bus.raw_round),
    )
    for name, spread in rounds:
        latencies.append((name, f"{spread.median_ms:.2f}", f"{spread.p99_ms:.2f}", ""))
    for row in results.aligned(latencies):
        say.result(row)
