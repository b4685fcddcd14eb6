"""What was found and what was there, frame by frame; the truth as a recording carries it."""

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnivert.errors import DataError
from omnivert.messages import Bearings
from omnivert.wire.recording import Recording

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Mask = NDArray[np.bool_]

LINES = "truth/lines.csv"
NONSTATIC = "truth/nonstatic_lines.csv"
CENTERS = "truth/centers.csv"


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """The lines that somebody found in one frame."""

    track_id: Int  # (N,) equal in two frames: said to be the same line
    bearing_rad: Float  # (N,) camera frame
    std_rad: Float | None = None  # (N,) None: no sigma was claimed
    center_px: tuple[float, float] | None = None  # of the ring; None: not found, or not looked for

    @classmethod
    def of(cls, bearings: Bearings) -> "Sighting":
        ring = bearings.ring
        center = None if ring is None else (ring.center_u_px, ring.center_v_px)
        return cls(bearings.track_id, bearings.bearing_rad, bearings.std_rad, center)


@dataclass(frozen=True, slots=True, eq=False)
class FrameTruth:
    """Every vertical edge at one frame, in view or not."""

    line_id: Int  # (E,) distinct; an edge keeps it over the frames
    bearing_rad: Float  # (E,) camera frame
    visible_fraction: Float  # (E,) visible part of the ring's radial extent
    contrast: Float  # (E,) mean grey step
    neither_rad: Float  # (S,) bearings of silhouettes and moving things: neither right nor wrong
    center_px: tuple[float, float] | None = None  # of the ring


def truth_of(recording: Recording) -> list[FrameTruth | None] | None:
    """The truth of each frame of the recording, in order, None where it says nothing of one; None without any truth.

    raises  DataError when a table of the truth is not what it should be
    """
    lines = _table(recording, LINES, ("index", "line_id", "bearing_rad", "visible_fraction", "contrast"))
    if lines is None:
        return None
    if lines.shape[0] == 0:
        raise _damaged(recording, LINES, "it holds no rows")
    neither = _table(recording, NONSTATIC, ("index", "bearing_rad"))
    centers = _table(recording, CENTERS, ("index", "cu_px", "cv_px"))
    by_frame = _split(lines)
    beside = {} if neither is None else _split(neither)
    center = {} if centers is None else {int(row[0]): (float(row[1]), float(row[2])) for row in centers}
    return [
        _frame(by_frame[index], beside.get(index, np.empty((0, 2))), center.get(index)) if index in by_frame else None
        for index in range(max(by_frame) + 1)
    ]


def _frame(edges: Float, neither: Float, center: tuple[float, float] | None) -> FrameTruth:
    _, line_id, bearing, fraction, contrast = edges.T.copy()
    return FrameTruth(line_id.astype(np.int64), bearing, fraction, contrast, neither[:, 1].copy(), center)


def _split(table: Float) -> dict[int, Float]:
    """The rows of each index; the first column is the index."""
    table = table[np.argsort(table[:, 0], kind="stable")]
    index, first, count = np.unique(table[:, 0], return_index=True, return_counts=True)
    return {int(i): table[k : k + n] for i, k, n in zip(index, first, count, strict=True)}


def _table(recording: Recording, name: str, columns: tuple[str, ...]) -> Float | None:
    """(rows, columns) of an attached CSV file; None when it is not attached."""
    if name not in recording.attachments:
        return None
    try:
        header, _, body = recording.attachment(name).decode("utf-8-sig").partition("\n")
        named = [field.strip() for field in header.split(",")]
        chosen = [named.index(column) for column in columns]
        if not body.strip():
            return np.empty((0, len(columns)))
        table = np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2, usecols=chosen)
    except ValueError as error:  # a missing column, a field that is no number, no text at all
        raise _damaged(recording, name, str(error)) from error
    if not np.all(np.isfinite(table)) or np.any(table[:, 0] < 0):
        raise _damaged(recording, name, "it holds numbers that cannot be")
    return table


def _damaged(recording: Recording, name: str, because: str) -> DataError:
    return DataError("OV306", f"{name} in {recording.path} is damaged", because, "omnivert explain OV306")
