"""`omnivert bench ticks`: from the encoder's line to its ticks received, with and without a camera beside it."""

from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.given import count
from omnivert.cli.offline import results
from omnivert.cli.settings import PACKAGED, ConfigOption, JsonOption, opened, settings, title
from omnivert.errors import DataError
from omnivert.wire.channels import FRAME

if TYPE_CHECKING:
    from omnivert.bench.ticks import TickTimes


def ticks(
    recording: Annotated[str, typer.Argument(metavar="[REC]", help="An .mcap file, or the word corridor.")] = PACKAGED,
    config: ConfigOption = None,
    lines: Annotated[int, typer.Option(min=100, max=100_000, help="Lines of the encoder in each run.")] = 1000,
    as_json: JsonOption = False,
) -> None:
    """Latency of an encoder's line through the bridge: alone, and beside a camera with the frames of REC at 30 Hz."""
    from omnivert.bench.ticks import tick_times

    source = opened(recording)
    if not count(source, FRAME):
        raise DataError("OV101", f"there are no frames in {title(recording)}", help="omnivert bench ticks corridor")
    with say.progress("ticks", 2 * lines) as bar:
        times = tick_times(source, source.config(settings(config)), lines, bar.step)
    if as_json:
        say.json_result(
            {
                "recording": title(recording),
                "alone": times.alone.json(),
                "with_camera": times.with_camera.json(),
                "raw_zenoh_round": times.raw_round.json(),
                "longest_ms": times.longest_ms,
                "frames": times.frames,
                "lost": times.lost,
            }
        )
    else:
        _tell(times)


def _tell(times: "TickTimes") -> None:
    table = [("line to ticks", "p50 ms", "p99 ms", "")]
    rows = {
        "alone": times.alone,
        "beside a camera at 30 Hz": times.with_camera,
        "raw zenoh round, likewise": times.raw_round,
    }
    for name, spread in rows.items():
        table.append((name, f"{spread.median_ms:.2f}", f"{spread.p99_ms:.2f}", ""))
    for row in results.aligned(table):
        say.result(row)
    say.result(f"longest beside the camera {times.longest_ms:.1f} ms; {times.frames} frames; {times.lost} lines lost")
