"""A folder of images, encoder counts and scans -> a recording."""

import glob
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.folder import FramesFolder
from omnivert.wire.channels import CHANNELS
from omnivert.wire.recording import RecordingWriter


def import_frames(
    folder: Path, out: Path, base: Config | None = None, progress: Callable[[int, int], None] | None = None
) -> FramesFolder:
    """Writes the folder into the recording `out`, which appears when it is whole, and not before.

    base      names robot, camera and encoder, and says what meta.json leaves open; the defaults without it
    progress  told messages written, and how many there are
    returns   the folder that was read
    raises    DataError naming file and row
    """
    given = FramesFolder(folder, Config() if base is None else base)
    keys = {channel.message: channel.key(given.config) for channel in CHANNELS}
    total = sum(given.counts.values())
    begun = out.with_name(f".{out.name}.{os.getpid()}.part")
    _clear_away(out)
    try:
        with RecordingWriter(begun, given.config) as writer:
            for done, message in enumerate(given.messages(), 1):
                writer.write(keys[type(message)], message)
                if progress is not None:
                    progress(done, total)
            for name, data in given.attachments():
                writer.attach(name, data)
        with begun.open("rb+") as whole:
            os.fsync(whole.fileno())
        begun.replace(out)
    except OSError as error:
        raise DataError("OV311", f"cannot write {out}", error.strerror or str(error)) from error
    finally:
        with suppress(OSError):
            begun.unlink(missing_ok=True)
    return given


def _clear_away(out: Path) -> None:
    """Removes what imports of the same recording that were killed have left."""
    for part in out.parent.glob(f".{glob.escape(out.name)}.*.part"):
        process = part.name.removesuffix(".part").rpartition(".")[2]
        if process.isdecimal() and not _is_alive(int(process)):
            with suppress(OSError):
                part.unlink()


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # somebody else's
        return True
    return True
