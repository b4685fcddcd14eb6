"""What all folders that can be imported have in common: they are closed, times run on, all is of one drive."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Protocol

from omnivert.config import Config
from omnivert.formats.regular import content
from omnivert.formats.table import NS_PER_S, refusal
from omnivert.messages import Message

LONGEST_GAP_S = 3600  # no drive stands still for so long: two drives in one file, or a wrong digit

Stamps = list[tuple[str, int]]  # place of the row, its time in ns


class DriveFolder(Protocol):
    """A folder that has been read, ready to be written as a recording.

    config  a base with the folder's rig in it
    counts  messages by type
    notes   what whoever wrote the folder should know
    """

    config: Config
    counts: dict[str, int]
    notes: tuple[str, ...]

    def messages(self) -> Iterator[Message]:
        """Everything in order of stamp."""

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """Files to be carried along, by name."""


class ClosedFolder:
    """A folder whose files are only read where they lie in it.

    path    of the folder, links followed
    raises  DataError when it is no folder
    """

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            raise refusal(str(path), "is no folder")
        self.path = path.resolve()

    def inside(self, path: Path, place: str) -> Path:
        """The path with its links followed, if that is still in the folder."""
        try:
            target = path.resolve()
        except (OSError, RuntimeError, ValueError) as error:  # a ring of links, a NUL in the name
            raise refusal(place, f"{path.name!r} is no usable file name") from error
        if not target.is_relative_to(self.path):
            raise refusal(place, f"{path.name!r} leaves the folder")
        return target

    def bytes_of(self, path: Path, place: str) -> bytes:
        """What the file holds; `place` names whoever asked for it."""
        try:
            return content(path)
        except OSError as error:
            raise refusal(place, f"cannot be read: {error.strerror or error}") from error

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """meta.json, for what the rig does not hold, and everything under truth/, in order of name."""
        truth = sorted(path for path in (self.path / "truth").rglob("*") if path.is_file())
        for path in (self.path / "meta.json", *truth):
            name = path.relative_to(self.path).as_posix()
            yield name, self.bytes_of(self.inside(path, name), name)


def hold_in_order(stamps: Stamps) -> None:
    """raises DataError when a time runs backwards or jumps farther than any drive stands still"""
    for (_, before), (place, stamp) in pairwise(stamps):
        if stamp < before:
            raise refusal(place, f"the time runs backwards, by {(before - stamp) / NS_PER_S:.9g} s")
        if stamp - before > LONGEST_GAP_S * NS_PER_S:
            raise refusal(place, f"the time jumps by {(stamp - before) / NS_PER_S:.9g} s; one drive has no such gap")


def hold_together(stamps: Stamps, frames: Stamps, frame: str = "frame") -> None:
    """Both are of one drive only if they have some time in common; `frame` is what the second ones are called.

    raises  DataError when they have none
    """
    if not stamps:
        return
    (first, first_ns), (last, last_ns) = stamps[0], stamps[-1]
    (first_frame, first_frame_ns), (last_frame, last_frame_ns) = frames[0], frames[-1]
    if first_ns > last_frame_ns:
        later_s = (first_ns - last_frame_ns) / NS_PER_S
        raise refusal(
            first, f"begins {later_s:.9g} s after the last {frame} ({last_frame}): not of one drive or one clock"
        )
    if last_ns < first_frame_ns:
        far = f"ends {(first_frame_ns - last_ns) / NS_PER_S:.9g} s before the first {frame} ({first_frame})"
        raise refusal(last, f"{far}: not of one drive, or not of one clock")
