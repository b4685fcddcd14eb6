"""`omnivert import frames DIR -o OUT.mcap`: a folder of images and encoder counts becomes a recording."""

from pathlib import Path
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import ConfigOption, JsonOption, settings

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

    check_new_recording(output)
    with say.progress("importing", None) as bar:
        counts = import_frames(folder, output, settings(config), bar.reach).counts
    size = output.stat().st_size
    if as_json:
        say.json_result({"recording": str(output), "bytes": size, "messages": counts})
        return
    text = " · ".join(f"{count} {name}" for name, count in counts.items())
    say.result(f"{output}  {size / 1e6:.1f} MB · {text}")
    say.story(f"next    omnivert calibrate {output}")
