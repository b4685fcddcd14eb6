"""What has been read -> a new recording, all of it or nothing."""

import glob
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.drive_folder import DriveFolder
from omnivert.wire.channels import CHANNELS
from omnivert.wire.recording import RecordingWriter

Progress = Callable[[int, int], None]  # told messages written, and how many there are


def write_recording(given: DriveFolder, out: Path, progress: Progress | None = None) -> None:
    """Writes the folder into the recording `out`, which appears when it is whole, and not before.

    raises  DataError naming file and row
    """
    keys = {channel.message: channel.key(given.config) for channel in CHANNELS}
    total = sum(given.counts.values())
    with new_recording(out, given.config) as writer:
        for done, message in enumerate(given.messages(), 1):
            writer.write(keys[type(message)], message)
            if progress is not None:
                progress(done, total)
        for name, data in given.attachments():
            writer.attach(name, data)


@contextmanager
def new_recording(out: Path, config: Config, compression: str = "zstd") -> Iterator[RecordingWriter]:
    """A recording to write, which appears at `out` when the block has gone well, and not before.

    raises  DataError when it cannot be written
    """
    begun = hidden_beside(out)
    _clear_away(out)
    try:
        with RecordingWriter(begun, config, compression) as writer:
            yield writer
        with begun.open("rb+") as whole:
            os.fsync(whole.fileno())
        begun.replace(out)
    except OSError as error:
        raise DataError("OV311", f"cannot write {out}", error.strerror or str(error)) from error
    finally:
        with suppress(OSError):
            begun.unlink(missing_ok=True)


def hidden_beside(out: Path) -> Path:
    """Where something is made that will be `out` when it is whole."""
    return out.with_name(f".{out.name}.{os.getpid()}.part")


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
