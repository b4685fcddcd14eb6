"""The folder of bearings and wheel displacements of any bearing sensor -> messages in order of stamp.

meta.json, bearings.csv, wheels.csv; truth/ where there is one. The paper: "the proposed method can be adopted to
calibrate any robot bearing sensor".
"""

import heapq
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.formats.drive_folder import ClosedFolder, hold_in_order, hold_together
from omnivert.formats.meta import Meta, check_std
from omnivert.formats.table import NS_PER_S, Row, refusal, rows
from omnivert.formats.wheels import passed_over
from omnivert.messages import Bearings, Message, Ticks

WIDEST_RAD = 6.3  # a turn either way, however it was rounded; beyond it the numbers are hardly radians
LONGEST_WAY_M = 1e8  # further than this a tick is lost in the last digit of a float
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1000.0  # rates that a configuration can hold


@dataclass(slots=True)
class _Instant:
    """What was seen at one time."""

    stamp_ns: int
    place: str  # of its first row
    bearing_rad: dict[int, float] = field(default_factory=dict)  # track -> bearing
    std_rad: list[float] = field(default_factory=list)
    age_frames: list[int] = field(default_factory=list)
    strength: list[float] = field(default_factory=list)


class BearingsFolder:
    """A folder whose tables have been read and held to their form.

    config    `base` with the folder's wheel base in it, and wheels that displacements in metres can be counted by
    counts    messages by type
    shift_ns  what is added to every time, so that none is negative
    notes     what a calibration with `base` will pass over, in words
    raises    DataError naming file and row
    """

    def __init__(self, folder: Path, base: Config) -> None:
        self._folder = ClosedFolder(folder)
        meta = Meta(folder / "meta.json")
        self._std_rad = meta.bearing_std_rad()
        self._instants = self._seen(folder / "bearings.csv")
        seen = [(instant.place, instant.stamp_ns) for instant in self._instants]
        hold_in_order(seen)
        self.config = meta.bearings_config(base, _rate_hz([stamp for _, stamp in seen]))
        self._ticks = self._wheels(folder / "wheels.csv")
        turned = [(place, ticks.stamp_ns) for place, ticks in self._ticks]
        hold_in_order(turned)
        hold_together(turned, seen, "bearing")
        self.shift_ns = max(0, -min(seen[0][1], self._ticks[0][1].stamp_ns))
        self.counts = {"Bearings": len(self._instants), "Ticks": len(self._ticks)}
        self.notes = passed_over("wheels.csv", (ticks for _, ticks in self._ticks), self.config)

    def messages(self) -> Iterator[Message]:
        """Everything in order of stamp; at equal stamps ticks, then bearings."""
        ticks = (Ticks(t.stamp_ns + self.shift_ns, t.left, t.right) for _, t in self._ticks)
        bearings = (self._bearings(instant) for instant in self._instants)
        streams: list[Iterator[Message]] = [ticks, bearings]
        return heapq.merge(*streams, key=lambda message: message.stamp_ns)

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """meta.json, for what the rig does not hold, and everything under truth/, in order of name."""
        return self._folder.attachments()

    def _seen(self, path: Path) -> list[_Instant]:
        """Rows of one time are one instant."""
        instants: list[_Instant] = []
        sightings: Counter[int] = Counter()
        for row in rows(path, ("t_s", "track_id", "bearing_rad"), ("std_rad", "age_frames", "strength")):
            stamp = row.stamp_ns("t_s")
            if not instants or stamp != instants[-1].stamp_ns:
                instants.append(_Instant(stamp, row.place))
            if not row.fields["track_id"].strip() and not row.fields["bearing_rad"].strip():
                continue  # a look that saw nothing
            instant, track = instants[-1], row.integer("track_id")
            if track < 0:
                raise refusal(row.place, f"track_id = {track} is negative")
            if track in instant.bearing_rad:
                raise refusal(row.place, f"track_id {track} comes twice at t_s = {row.text('t_s')}")
            instant.bearing_rad[track] = _bearing_rad(row)
            instant.std_rad.append(self._row_std_rad(row))
            instant.age_frames.append(_age_frames(row, sightings[track]))
            instant.strength.append(_strength(row))
            sightings[track] += 1
        return instants

    def _row_std_rad(self, row: Row) -> float:
        """The row's own, else that of the whole folder."""
        if "std_rad" in row.fields:
            return check_std(row.number("std_rad"), row.place, "std_rad")
        if self._std_rad is None:
            raise refusal("meta.json", "bearing_std_rad is missing, and bearings.csv has no column 'std_rad'")
        return self._std_rad

    def _wheels(self, path: Path) -> list[tuple[str, Ticks]]:
        """Of several rows of one time the last one counts: they are cumulative."""
        tick_m = self.config.encoder.metres_per_tick
        ticks: list[tuple[str, Ticks]] = []
        for row in rows(path, ("t_s", "left_m", "right_m")):
            left, right = (round(_way_m(row, side) / tick_m) for side in ("left_m", "right_m"))
            stamp = row.stamp_ns("t_s")
            if ticks and ticks[-1][1].stamp_ns == stamp:
                ticks.pop()
            ticks.append((row.place, Ticks(stamp, left, right)))
        return ticks

    def _bearings(self, instant: _Instant) -> Bearings:
        return Bearings(
            stamp_ns=instant.stamp_ns + self.shift_ns,
            track_id=np.array(list(instant.bearing_rad), dtype=np.int64),
            bearing_rad=np.array(list(instant.bearing_rad.values()), dtype=np.float64),
            std_rad=np.array(instant.std_rad, dtype=np.float64),
            age_frames=np.array(instant.age_frames, dtype=np.int32),
            strength=np.array(instant.strength, dtype=np.float32),
        )


def _rate_hz(stamps_ns: list[int]) -> float:
    """Of the instants, by their median interval; 1 for a single one. Nothing computes with it: people read it."""
    steps = [after - before for before, after in pairwise(stamps_ns)]
    rate = NS_PER_S / median(steps) if steps else 1.0
    return float(f"{min(max(rate, SLOWEST_HZ), FASTEST_HZ):.4g}")


def _bearing_rad(row: Row) -> float:
    """In [-pi, pi]: sensors count from -pi to pi, or from 0 to 2 pi, and both mean the same direction."""
    given = row.number("bearing_rad")
    if abs(given) > WIDEST_RAD:
        raise refusal(row.place, f"bearing_rad = {given:g} is not within -2 pi to 2 pi; bearings are in radians")
    return given if abs(given) <= np.pi else wrap(given)  # an angle that is in it already stays the same to the bit


def _age_frames(row: Row, sightings: int) -> int:
    """The row's own, else how often the track was seen before."""
    if "age_frames" not in row.fields:
        return sightings
    age = row.integer("age_frames")
    if not 0 <= age < 2**31:
        raise refusal(row.place, f"age_frames = {age} is no number of frames")
    return age


def _strength(row: Row) -> float:
    """The row's own, else as strong as can be."""
    if "strength" not in row.fields:
        return 1.0
    strength = row.number("strength")
    if not 0.0 <= strength <= 1.0:
        raise refusal(row.place, f"strength = {strength:g} is not within 0 to 1")
    return strength


def _way_m(row: Row, column: str) -> float:
    given = row.number(column)
    if abs(given) > LONGEST_WAY_M:
        raise refusal(row.place, f"{column} = {given:g} is no way in metres")
    return given
