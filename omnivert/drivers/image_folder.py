"""A folder of images as a camera: in order of name, at a given rate."""

import re
from collections import deque
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from threading import Event

from omnivert.config import Camera
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.image_file import frame_from_path
from omnivert.messages import Frame

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp", ".jp2"))


def image_files(folder: Path) -> list[Path]:
    """The images in a folder; numbers in their names count as numbers, so that 10 comes after 9."""
    files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file()]
    return sorted(files, key=lambda path: (_parts(path.name), path.name))


def folder_frames(
    config: Camera, stop: Event, now_ns: Callable[[], int]
) -> Iterator[Frame | Opened | Lost | Refused | Finished]:
    """Each image once, the k-th k periods after the first; the stamps keep that rhythm exactly.

    A folder that vanishes is waited for and begun again; one that has been played is finished.
    """
    while not stop.is_set():
        yield from _until_there(config, stop)
        played = yield from _played(config, stop, now_ns)
        if played:
            yield Finished()
            return


def _until_there(config: Camera, stop: Event) -> Iterator[Lost]:
    """Ends when the folder holds an image, or at `stop`; tells each new reason why it does not."""
    reason = ""
    while not stop.is_set():
        try:
            if image_files(Path(config.source)):
                return
            why = "holds no image"
        except OSError as error:
            why = f"cannot be read: {error.strerror}"
        if why != reason:
            reason = why
            yield Lost(reason)
        stop.wait(config.reopen_s)


def _played(config: Camera, stop: Event, now_ns: Callable[[], int]) -> Generator[Frame | Opened | Refused, None, bool]:
    """What is in the folder, and what comes into it meanwhile; returns whether all of it has been played.

    It has not at `stop`, and when the folder has vanished with its images.
    """
    files = _listed(config)
    if not files:
        return False
    yield Opened()
    waiting, known = deque(files), set(files)
    period_ns = round(1e9 / config.frame_rate_hz)
    start_ns = now_ns()
    k = 0
    while waiting:
        path, stamp_ns = waiting.popleft(), start_ns + k * period_ns
        if stop.wait(max(0.0, (stamp_ns - now_ns()) * 1e-9)):
            return False
        try:
            yield frame_from_path(path, stamp_ns)
        except (OSError, ValueError) as error:
            if known.isdisjoint(_listed(config)):
                return False
            yield Refused(f"{path.name}: {error}")
        k += 1
        if not waiting:
            waiting.extend(path for path in _listed(config) if path not in known)
            known.update(waiting)
    return True


def _listed(config: Camera) -> list[Path]:
    """The images that are there now."""
    try:
        return image_files(Path(config.source))
    except OSError:
        return []


def _parts(name: str) -> list[tuple[int, str]]:
    """The name as parts that compare; numbers by value."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name.lower()) if part]
