"""A folder of images, encoder counts and scans -> a recording."""

from pathlib import Path

from omnivert.config import Config
from omnivert.formats.folder import FramesFolder
from omnivert.formats.written import Progress, write_recording


def import_frames(
    folder: Path, out: Path, base: Config | None = None, progress: Progress | None = None
) -> FramesFolder:
    """Writes the folder into the recording `out`, which appears when it is whole, and not before.

    base     names robot, camera and encoder, and says what meta.json leaves open; the defaults without it
    returns  the folder that was read
    raises   DataError naming file and row
    """
    given = FramesFolder(folder, Config() if base is None else base)
    write_recording(given, out, progress)
    return given
