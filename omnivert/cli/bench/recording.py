"""`omnivert bench recording`: what recording raw frames costs, and how well a playback keeps its pace."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.settings import ConfigOption, JsonOption, settings
from omnivert.errors import UseError

if TYPE_CHECKING:
    from omnivert.bench.recording import RecordingTimes


def recording(
    config: ConfigOption = None,
    minutes: Annotated[float, typer.Option(help="Of a drive; half a gigabyte each, and more.", min=0.01)] = 0.5,
    speed: Annotated[float, typer.Option(help="How much faster than live it is sent.", min=0.1, max=100.0)] = 2.0,
    play: Annotated[float, typer.Option(help="Seconds to play of it, at speed 1.", min=1.0)] = 15.0,
    folder: Annotated[Path, typer.Option(help="Where it is written for that time.")] = Path(),
    as_json: JsonOption = False,
) -> None:
    """Raw 640x480 frames at 30 Hz and wheels at 100 Hz, sent, recorded and played by real processes."""
    from omnivert.bench.recording import recording_times

    if not folder.is_dir():
        raise UseError("OV322", f"cannot write into {folder}", "there is no such folder", f"mkdir {folder}")
    seconds = 60.0 * minutes
    with say.progress("recording", int(seconds + min(play, seconds))) as bar:
        times = recording_times(settings(config), folder, seconds, speed, play, bar.step)
    if as_json:
        say.json_result({"speed": speed, **times.json()})
    else:
        _tell(times, speed)


def _tell(times: "RecordingTimes", speed: float) -> None:
    settled, ended, most = times.memory_mb
    live = f"{100.0 * times.cpu_share:.1f} % of a core live, {times.sobel_pairs:.2f} Sobel pairs a frame"
    say.result(
        f"drive     {times.drive_s:.0f} s, {times.frames} frames, {times.ticks} ticks, sent {speed:g} times as fast"
    )
    say.result(f"file      {times.file_bytes / 1e6:.1f} MB, {times.lost} messages lost")
    say.result(f"recorder  {live}; memory {settled:.0f} MB after a tenth, {ended:.0f} at the end, {most:.0f} at most")
    for name, spread in (("playback", times.pace), ("a sleep", times.sleep)):
        said = f"off by {spread.median_ms:.2f} ms median, {spread.p99_ms:.2f} ms p99, of {spread.count} at speed 1"
        say.result(f"{name:<9} {said}")
