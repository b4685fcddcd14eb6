"""A folder of bearings and wheel displacements -> a recording."""

from pathlib import Path

from omnivert.config import Config
from omnivert.formats.bearings_folder import BearingsFolder
from omnivert.formats.written import Progress, write_recording


def import_bearings(
    folder: Path, out: Path, base: Config | None = None, progress: Progress | None = None
) -> BearingsFolder:
    """Writes the folder into the recording `out`, which appears when it is whole, and not before.

    base     names robot, sensor (as camera) and encoder, and gives the wheels' noise; the defaults without it
    returns  the folder that was read
    raises   DataError naming file and row
    """
    given = BearingsFolder(folder, Config() if base is None else base)
    write_recording(given, out, progress)
    return given
