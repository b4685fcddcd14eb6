"""What a note in a health message means to a person: nothing to worry about, a trouble, or the next thing to do."""

import re
from collections.abc import Mapping

from omnivert.pictures.words import counted

_END = "camera: source finished"
_HARMLESS = (
    *("begins from nothing", "goes on from the stored extrinsics"),
    *(_END, "camera: stamped by", "clock of the encoder"),
    "more lines than calibration.frame_lines",
)
_BEGINNING = _HARMLESS[:2]  # of interest until the first estimate has come
_SIZE = re.compile(r"camera: frames have (\d+) x (\d+) pixels, the configuration says (\d+) x (\d+)")
_LATE = {"not waited for": "late, not waited for", "came too late": "too late, left out"}  # how such reasons end
_NO_STORE = re.compile(r"storage: .*; \d+ waiting", re.DOTALL)
_DEVICE = re.compile(r"(camera|encoder): (?=\S)")


def is_harmless(note: str) -> bool:
    return note.startswith(_HARMLESS)


def is_of_the_end(note: str) -> bool:
    """Whether it says that no more frames will come."""
    return note.startswith(_END)


def is_of_the_beginning(note: str) -> bool:
    """Whether it says how a calibration begins."""
    return note.startswith(_BEGINNING)


def counted_reasons(refused: Mapping[str, int]) -> str:
    """The most frequent of a service's reasons; what was late is not called refused, and gives way to what was bad."""
    if not refused:
        return ""
    reason, times = max(refused.items(), key=lambda item: (_late(item[0]) is None, item[1]))
    return f"{counted(times)} {_late(reason) or f'refused: {reason}'}"


def _late(reason: str) -> str | None:
    stream, _, how = reason.rpartition(": ")
    return f"{_LATE[how]}: {stream}" if how in _LATE else None


def is_of_no_store(note: str) -> bool:
    """Whether it says that nothing can be stored."""
    return _NO_STORE.fullmatch(note) is not None


def todo(note: str) -> str:
    """What a person should do about it before anything else; "" when there is nothing."""
    if is_harmless(note):
        return ""
    if size := _SIZE.fullmatch(note):
        width, height, said_width, said_height = size.groups()
        lines = [f"camera.width_px = {width}"] if width != said_width else []
        lines += [f"camera.height_px = {height}"] if height != said_height else []
        return f"set {' and '.join(lines)}: that is what the camera gives" if lines else ""
    if device := _DEVICE.match(note):
        verb = "look at" if "is open" in note else "connect"
        return f"{verb} the {device[1]}: {note[device.end() :]}"
    return ""
