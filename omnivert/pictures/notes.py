"""What a note in a health message means to a person: nothing to worry about, a trouble, or the next thing to do."""

import re

_END = "camera: source finished"
_HARMLESS = (
    *("begins from nothing", "goes on from the stored extrinsics"),
    *(_END, "camera: stamped by", "clock of the encoder"),
    "more lines than calibration.frame_lines",
)
_BEGINNING = _HARMLESS[:2]  # of interest until the first estimate has come
_SIZE = re.compile(r"camera: frames have (\d+) x (\d+) pixels, the configuration says (\d+) x (\d+)")
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
