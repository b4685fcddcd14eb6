"""`omnivert rec`: look into recordings, cut and merge them, and turn them into plain files."""

import math
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.given import fault
from omnivert.cli.outputs import check_distinct, check_new_folder, check_new_recording
from omnivert.cli.recordings import export_results
from omnivert.cli.settings import ConfigOption, JsonOption, RecordingArgument, opened, title
from omnivert.errors import UseError
from omnivert.pictures.words import amounts

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording

app = typer.Typer(help="Look into recordings, cut, merge and export them.")

OutputOption = Annotated[Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="Recording to write.")]


@app.callback()
def root() -> None:
    """Look into recordings, cut, merge and export them."""


@app.command("info")
def info(recording: RecordingArgument, as_json: JsonOption = False) -> None:
    """What a recording holds, stream by stream, how far was driven, and whether its file is sound."""
    from omnivert.cli.recordings.inventory import inventory

    source = opened(recording)
    with say.progress("reading", source.counts.total()) as bar:
        found = inventory(source, bar.step)
    if as_json:
        say.json_result({"recording": title(recording), **found.json()})
        return
    say.result(f"{title(recording)}  {found.given}")
    for line in found.lines():
        say.result(line)


@app.command("cut")
def cut(
    recording: RecordingArgument,
    output: OutputOption,
    start: Annotated[float | None, typer.Option("--from", help="Second to begin at.", min=0.0)] = None,
    end: Annotated[float | None, typer.Option("--to", help="Second to end before.", min=0.0)] = None,
    as_json: JsonOption = False,
) -> None:
    """A part of a recording as a recording of its own; without --from and --to all that can be read of it."""
    from omnivert.formats import recut

    for option, second in (("--from", start), ("--to", end)):
        if second is not None and not math.isfinite(second):
            help = "omnivert rec info REC   # shows how long it is"
            raise UseError("OV205", f"omnivert rec cut: {option} {second}", "it is a second of the recording", help)
    source = opened(recording)
    _check(output, [source])
    with say.progress("cutting", None) as bar:
        counts = recut.cut(source, output, start, end, bar.reach)
    _tell(output, counts, _faults([source]), as_json)


@app.command("merge")
def merge(
    recordings: Annotated[list[str], typer.Argument(metavar="REC REC ...", help="Recordings of one rig, any order.")],
    output: OutputOption,
    as_json: JsonOption = False,
) -> None:
    """Recordings of one rig that follow each other, such as the parts of one that was split, as one recording."""
    from omnivert.formats import recut

    sources = [opened(recording) for recording in recordings]
    _check(output, sources)
    if len(sources) < 2:
        raise UseError("OV205", "omnivert rec merge: one recording alone", "there is nothing to merge it with", "")
    with say.progress("merging", None) as bar:
        counts, left_out = recut.merge(sources, output, bar.reach)
    differ = [f"{name} differs from recording to recording, and is left out" for name in left_out]
    _tell(output, counts, [*_faults(sources), *differ], as_json)


@app.command("export")
def export(
    recording: RecordingArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Plain files: a folder, new or empty.")
    ] = None,
    foxglove: Annotated[
        Path | None, typer.Option(metavar="OUT.mcap", help="Sensors, lines and estimates for Foxglove, and a layout.")
    ] = None,
    rosbag: Annotated[
        Path | None, typer.Option(metavar="OUT", help="Estimates for ROS 2, a folder; for ROS 1 where it ends in .bag.")
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """A recording for other programs: plain files, of which omnivert import makes the same messages again, or results.

    Results that were not recorded are worked out on the way, with --config where it is given.
    """
    match output, foxglove, rosbag:
        case Path(), None, None:
            _as_folder(recording, output, as_json)
        case None, Path(), None:
            export_results.foxglove(recording, foxglove, config, as_json)
        case None, None, Path():
            export_results.rosbag(recording, rosbag, config, as_json)
        case _:
            because, help = (
                "one of -o, --foxglove and --rosbag says what is to be written",
                "omnivert rec export --help",
            )
            raise UseError("OV205", "omnivert rec export: where to?", because, help)


def _as_folder(recording: str, output: Path, as_json: bool) -> None:
    from omnivert.formats import folder_export

    source = opened(recording)
    check_new_folder(output)
    with say.progress("exporting", None) as bar:
        exported = folder_export.export(source, output, bar.reach)
    counts, notes = dict(exported.counts), [*_faults([source]), *exported.notes]
    if as_json:
        body = {"folder": str(output), "kind": exported.kind, "messages": counts, "notes": notes}
        say.json_result(body)
        return
    say.result(f"{output}  {amounts(counts)}")
    _note(notes)
    folder = quote(str(output))
    say.following(f"omnivert import {exported.kind} {folder} -o OUT.mcap   # makes a recording of it again")


def _check(output: Path, sources: "Sequence[Recording]") -> None:
    check_distinct({f"recording {source.path}": source.path for source in sources}, {"--output": output})
    check_new_recording(output)


def _tell(output: Path, counts: dict[str, int], notes: Sequence[str], as_json: bool) -> None:
    size = output.stat().st_size
    if as_json:
        say.json_result({"recording": str(output), "bytes": size, "messages": counts, "notes": list(notes)})
        return
    say.result(f"{output}  {size / 1e6:.1f} MB · {sum(counts.values())} messages")
    _note(notes)
    say.following(f"omnivert rec info {quote(str(output))}")


def _faults(sources: "Sequence[Recording]") -> list[str]:
    """What of the recordings could not be read, in words."""
    return [f"{source.path} is not whole: {fault(source)}" for source in sources if source.cut]


def _note(notes: Sequence[str]) -> None:
    for note in notes:
        say.note(note)
