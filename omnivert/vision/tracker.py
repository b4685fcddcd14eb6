"""Lines and descriptors of frame after frame -> identities (IX-A)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from omnivert.angles import TURN, wrap
from omnivert.config import Vision
from omnivert.vision.lines import Lines
from omnivert.vision.matching import distances, matches

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]

# Descriptors of one line in two frames of the corridor differ by 0.34 (median), 0.5 (95 %); of two lines by 0.54 (1 %).
_DESCRIPTOR_STD = 0.3
_OLD_STD_RAD = np.deg2rad(0.2)  # how well a line's next bearing is known when its own motion is
_YOUNG_STD_RAD = np.deg2rad(1.5)  # and when it is not
_MAX_STD_RAD = np.deg2rad(3.0)
_YOUNG_FRAMES = 2
_GATE_RAD = np.deg2rad(6.0)
_TAIL = 3.0  # degrees of freedom of Student's t, for drives that change their motion at once
_NEW_COST = 10.0  # a pair that costs more is less believable than a new line
_DRIFT_GAIN = 0.5
_DRIFT_FADE = 0.8  # of the own motion of a line that is out of sight
_TURN_FRAMES = 2  # tracks seen this lately vote for the common turn
_TURN_CELLS = 720
_TURN_EVIDENCE = 0.15  # of one sure pair, after smoothing
_TURN_WIDTH_RAD = np.deg2rad(2.0)


class Tracked(NamedTuple):
    """Which lines of a frame are in a track, and in which, by growing identity; (N,) each."""

    line: Int  # index of the line in the frame
    track_id: Int  # counts up from 0 over the tracker's life
    age_frames: Int  # frames since the track began; 0: new
    quality: Float  # 0..1, how sure the identity is
    moving: NDArray[np.bool_]  # the line moves against the static world


class _Tracks(NamedTuple):
    """Everything known about the tracks that are still looked for, (T,) each, by growing identity."""

    track_id: Int
    born: Int  # frame
    seen: Int  # frame, the last
    angle: Float  # where the line should be now
    drift: Float  # its own motion a frame, beyond what all lines have in common
    polarity: Int
    descriptor: Float32  # (T, K)


def _no_tracks(length: int) -> _Tracks:
    none, zero = np.empty(0, dtype=np.int64), np.empty(0)
    return _Tracks(none, none, none, zero, zero, none, np.empty((0, length), dtype=np.float32))


class Tracker:
    """Continues tracks with a frame's lines; a line that continues none begins one."""

    def __init__(self, vision: Vision) -> None:
        self._vision = vision
        self._frame = -1
        self._next_id = 0
        self._tracks = _no_tracks(vision.areas * 2 * vision.bins)
        self.common_turn_rad = 0.0
        """How far all lines turned together in the newest frame, image angle; 0 in paper mode."""

    def step(self, lines: Lines, descriptor: Float32) -> Tracked:
        """The identities of a frame's lines; each identity goes to one line at most.

        descriptor  (N, K)  of the lines
        """
        self._frame += 1
        paper = self._vision.mode == "paper"
        match = self._paper_match(descriptor) if paper else self._predicted_match(lines, descriptor)
        fresh = match < 0
        if not paper:
            fresh &= lines.strength >= self._vision.min_length  # a weak line may continue a track, not begin one
        return self._updated(lines, descriptor, match, fresh)

    def _paper_match(self, descriptor: Float32) -> Int:
        """The track of each line, or -1: the three rules against the frame before, then the ones before that."""
        tracks, vision = self._tracks, self._vision
        match = np.full(descriptor.shape[0], -1, dtype=np.int64)
        for back in range(1, vision.lookback_frames + 1):
            open_lines = np.flatnonzero(match < 0)
            if open_lines.size == 0:
                break
            # Each track as it was seen last: one that has been seen since is not among them, so that no identity is
            # given twice.
            there = np.flatnonzero(tracks.seen == self._frame - back)
            D = distances(descriptor[open_lines], tracks.descriptor[there], vision.dissimilarity, vision.bins)
            found = matches(D, vision.f1, vision.f2, vision.f3, mutual=vision.mutual)
            match[open_lines[found >= 0]] = there[found[found >= 0]]
        return match

    def _predicted_match(self, lines: Lines, descriptor: Float32) -> Int:
        """The track of each line, or -1: least total cost within a gate around where each line should be.

        # Paper: the three rules on descriptors alone. Here: descriptor, polarity and predicted bearing together,
        # because similar lines (door frames, shelves) are told apart by where they are; the turn common to all lines
        # is taken from the lines themselves first. On the corridor, same lines and descriptors: false links 0.9 % by
        # the rules, 0.3 % here; false new tracks 6.9 % and 0.3 %. With only every third frame the gain in new tracks
        # is gone (15.7 % and 15.2 %). The constants above were chosen on that drive.
        """
        tracks, frame = self._tracks, self._frame
        D = distances(descriptor, tracks.descriptor, self._vision.dissimilarity, self._vision.bins)
        same_side = lines.polarity[:, None] == tracks.polarity[None, :]
        ahead = wrap(lines.angle_rad[:, None] - wrap(tracks.angle + tracks.drift)[None, :])
        recent = frame - tracks.seen <= _TURN_FRAMES
        self.common_turn_rad = common_turn(ahead[:, recent], D[:, recent], same_side[:, recent])
        tracks = self._tracks = tracks._replace(angle=wrap(tracks.angle + tracks.drift + self.common_turn_rad))
        surprise = wrap(ahead - self.common_turn_rad)
        gap = frame - tracks.seen
        young = tracks.seen - tracks.born < _YOUNG_FRAMES
        std = np.minimum(np.where(young, _YOUNG_STD_RAD, _OLD_STD_RAD) * np.sqrt(gap), _MAX_STD_RAD)
        cost = (
            (D / _DESCRIPTOR_STD) ** 2
            + _TAIL * np.log1p((surprise / std) ** 2 / _TAIL)
            + 2.0 * np.log(std / _OLD_STD_RAD)
        )
        allowed = same_side & (self._vision.f1 > D) & (np.abs(surprise) < _GATE_RAD) & (cost < _NEW_COST)
        return assigned(cost, allowed, _NEW_COST)

    def _updated(self, lines: Lines, descriptor: Float32, match: Int, fresh: NDArray[np.bool_]) -> Tracked:
        tracks, frame = self._tracks, self._frame
        line = np.flatnonzero(match >= 0)
        track = match[line]
        surprise = wrap(lines.angle_rad[line] - tracks.angle[track])
        drift = tracks.drift * _DRIFT_FADE
        drift[track] = tracks.drift[track] + _DRIFT_GAIN * surprise / (frame - tracks.seen[track])
        angle, seen, polarity, latest = (
            a.copy() for a in (tracks.angle, tracks.seen, tracks.polarity, tracks.descriptor)
        )
        angle[track], seen[track], polarity[track] = lines.angle_rad[line], frame, lines.polarity[line]
        latest[track] = descriptor[line]
        new = np.flatnonzero(fresh)
        new_id = self._next_id + np.arange(new.size)
        self._next_id += new.size
        now = np.full(new.size, frame)
        everything = _Tracks(
            np.concatenate((tracks.track_id, new_id)),
            np.concatenate((tracks.born, now)),
            np.concatenate((seen, now)),
            np.concatenate((angle, lines.angle_rad[new])),
            np.concatenate((drift, np.zeros(new.size))),
            np.concatenate((polarity, lines.polarity[new])),
            np.concatenate((latest, descriptor[new])),
        )
        line = np.concatenate((line, new))
        row = np.concatenate((track, tracks.track_id.size + np.arange(new.size)))
        order = np.argsort(row, kind="stable")
        line, row = line[order], row[order]
        none = np.ones(row.size), np.zeros(row.size, dtype=np.bool_)
        result = Tracked(line, everything.track_id[row], frame - everything.born[row], *none)
        kept = frame - everything.seen < self._vision.lookback_frames
        self._tracks = _Tracks(*(a[kept] for a in everything))  # type: ignore[arg-type]  # one row each
        return result


def common_turn(ahead: Float, D: Float, same_side: NDArray[np.bool_]) -> float:
    """How far all lines have turned together: where the differences of look-alike pairs pile up; rad, 0 when unclear.

    ahead      (N, T)  rad  bearing of line i less that of track j
    D          (N, T)       distance of their descriptors
    same_side  (N, T)       whether their polarities agree
    """
    weight = np.exp(-0.5 * (D / _DESCRIPTOR_STD) ** 2) * same_side
    pair = weight > 0.01
    delta, weight = ahead[pair], weight[pair]
    cell = ((delta / TURN + 0.5) * _TURN_CELLS).astype(np.intp) % _TURN_CELLS
    pile = np.bincount(cell, weights=weight, minlength=_TURN_CELLS)
    for _ in range(3):
        pile = 0.5 * pile + 0.25 * (np.roll(pile, 1) + np.roll(pile, -1))
    peak = int(np.argmax(pile))
    if pile[peak] < _TURN_EVIDENCE:
        return 0.0
    turn = (peak + 0.5) / _TURN_CELLS * TURN - np.pi
    for _ in range(2):
        off = wrap(delta - turn)
        near = weight * np.maximum(1.0 - (off / _TURN_WIDTH_RAD) ** 2, 0.0)
        if np.sum(near) > 0.0:
            turn = wrap(turn + float(np.sum(near * off) / np.sum(near)))
    return turn


def assigned(cost: Float, allowed: NDArray[np.bool_], new_cost: float) -> Int:
    """The column of each row, or -1, by least total cost; a row left alone costs `new_cost`; (N,)."""
    n = cost.shape[0]
    match = np.full(n, -1, dtype=np.int64)
    rows, columns = np.flatnonzero(allowed.any(axis=1)), np.flatnonzero(allowed.any(axis=0))
    if rows.size == 0:
        return match
    part = np.where(allowed, cost, 2.0 * new_cost)[np.ix_(rows, columns)]
    alone = np.full((rows.size, rows.size), 2.0 * new_cost)
    np.fill_diagonal(alone, new_cost)
    row, column = linear_sum_assignment(np.hstack((part, alone)))
    real = column < columns.size
    i, j = rows[row[real]], columns[column[real]]
    good = allowed[i, j]
    match[i[good]] = j[good]
    return match
