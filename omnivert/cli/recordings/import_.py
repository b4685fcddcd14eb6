"""`omnivert import frames`, `bearings` or `rosbag`: what somebody's logger wrote becomes a recording."""

from pathlib import Path
from typing import Annotated

import typer

from omnivert.cli.recordings.import_rosbag import rosbag
from omnivert.cli.recordings.imported import imported
from omnivert.cli.settings import ConfigOption, JsonOption

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

    imported(import_frames, folder, output, config, as_json)


@app.command("bearings")
def bearings(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with meta.json, bearings.csv, wheels.csv.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="Recording to write.")],
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Bearings of any sensor and wheel displacements of a folder -> a recording. Nothing half-written is left."""
    from omnivert.formats.bearings_import import import_bearings

    imported(import_bearings, folder, output, config, as_json)


app.command("rosbag")(rosbag)
