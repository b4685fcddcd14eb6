"""What every `omnivert import` does: check the place, show how far it is, say what was written and what is next."""

from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import settings
from omnivert.pictures.words import amounts

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.formats.drive_folder import DriveFolder
    from omnivert.formats.written import Progress

    Importer = Callable[[Path, Path, Config, Progress], DriveFolder]


def imported(read: "Importer", source: Path, output: Path, config: Path | None, as_json: bool, *also: str) -> None:
    """Make a recording of the source.

    also  notes beside those of the source itself
    """
    check_new_recording(output)
    with say.progress("importing", None) as bar:
        given = read(source, output, settings(config), bar.reach)
    size, notes = output.stat().st_size, [*given.notes, *also]
    if as_json:
        say.json_result({"recording": str(output), "bytes": size, "messages": given.counts, "notes": notes})
        return
    say.result(f"{output}  {size / 1e6:.1f} MB · {amounts(given.counts)}")
    for note in notes:
        say.note(note)
    say.following(f"omnivert calibrate {quote(str(output))}")
