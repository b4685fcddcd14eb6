"""`omnivert import frames` or `bearings DIR -o OUT.mcap`: a folder that somebody's logger wrote becomes a recording."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import ConfigOption, JsonOption, settings

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.formats.drive_folder import DriveFolder
    from omnivert.formats.written import Progress

    Importer = Callable[[Path, Path, Config, Progress], DriveFolder]

app = typer.Typer(help="Turn other people's files into a recording.")


@app.callback()
def root() -> None:
    """Turn other people's files into a recording."""


@app.command("frames")
def frames(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with meta.json, frames.csv, encoders.csv.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="Recording to write.")],
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Images, encoders and optional scans of a folder -> a recording. Nothing half-written is left."""
    from omnivert.formats.frames_import import import_frames

    _import(import_frames, folder, output, config, as_json)


@app.command("bearings")
def bearings(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with meta.json, bearings.csv, wheels.csv.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="Recording to write.")],
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Bearings of any sensor and wheel displacements of a folder -> a recording. Nothing half-written is left."""
    from omnivert.formats.bearings_import import import_bearings

    _import(import_bearings, folder, output, config, as_json)


def _import(read: "Importer", folder: Path, output: Path, config: Path | None, as_json: bool) -> None:
    check_new_recording(output)
    with say.progress("importing", None) as bar:
        given = read(folder, output, settings(config), bar.reach)
    size = output.stat().st_size
    if as_json:
        body = {"recording": str(output), "bytes": size, "messages": given.counts, "notes": list(given.notes)}
        say.json_result(body)
        return
    text = " · ".join(f"{count} {name}" for name, count in given.counts.items())
    say.result(f"{output}  {size / 1e6:.1f} MB · {text}")
    for note in given.notes:
        say.story(f"[yellow]note[/]    {escape(note)}")
    say.story(f"next    omnivert calibrate {output}")
