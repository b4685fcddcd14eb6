"""A folder of images as a camera: in order of name, at a given rate."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event

from omnivert.config import Camera
from omnivert.drivers.device import Finished, Lost, Opened, Refused
from omnivert.drivers.image_file import frame_from_file
from omnivert.messages import Frame

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp", ".jp2"))


def image_files(folder: Path) -> list[Path]:
    """The images in a folder; numbers in their names count as numbers, so that 10 comes after 9."""
    files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file()]
    return sorted(files, key=lambda path: (_parts(path.name), path.name))


def folder_frames(
    config: Camera, stop: Event, now_ns: Callable[[], int]
) -> Iterator[Frame | Opened | Lost | Refused | Finished]:
    """Each image once, the k-th k periods after the first; the stamps keep that rhythm exactly."""
    folder = Path(config.source)
    files: list[Path] = []
    reason = ""
    while not files and not stop.is_set():
        try:
            files = image_files(folder)
            why = "holds no image"
        except OSError as error:
            why = f"cannot be read: {error.strerror}"
        if not files:
            if why != reason:
                reason = why
                yield Lost(reason)
            stop.wait(config.reopen_s)
    yield Opened()
    period_ns = round(1e9 / config.frame_rate_hz)
    start_ns = now_ns()
    for k, path in enumerate(files):
        stamp_ns = start_ns + k * period_ns
        if stop.wait(max(0.0, (stamp_ns - now_ns()) * 1e-9)):
            return
        try:
            yield frame_from_file(path.read_bytes(), stamp_ns)
        except (OSError, ValueError) as error:
            yield Refused(f"{path.name}: {error}")
    yield Finished()


def _parts(name: str) -> list[tuple[int, str]]:
    """The name as parts that compare; numbers by value."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name.lower()) if part]
