"""Lines and descriptors of frame after frame -> identities (IX-A)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.config import Vision
from omnivert.vision.assignment import KNOWN_STD_RAD, NEW_COST, assigned, costs, mutual_best
from omnivert.vision.lines import Lines
from omnivert.vision.matching import distances, matches
from omnivert.vision.motion import DESCRIPTOR_STD, Flow, common_flow, common_turn, sine_of

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]

_YOUNG_STD_RAD = np.deg2rad(1.5)  # how well a line's next bearing is known when its own motion is not
_LOOSE_STD_RAD = np.deg2rad(2.0)  # when the flow is still to be found
_MAX_STD_RAD = np.deg2rad(3.0)
_YOUNG_FRAMES = 2
_USUAL_DISTANCE = 0.34  # of a line's descriptors in two frames, median on the corridor
_DRIFT_GAIN = 0.5
_DRIFT_FADE = 0.95  # of the own motion of a line that is out of sight
_TURN_FRAMES = 4  # tracks seen this lately, before lines were last seen, vote for turn and flow
_FLOW_SHARE = 0.3  # of the tracks seen lately, at least, must be found again to tell how lines move
_QUALITY_GAIN = 0.3
_MOVING_RAD = np.deg2rad(0.4)  # a frame, against what driving explains; less is noise
_NEAR_TIMES = 4.0  # the fastest line of the static world drifts so many times as fast as most
_MOVING_FADE = 0.8
_MOVING_ON, _MOVING_OFF = 2.0, 0.8  # how many frames' evidence, faded, flags a line as moving, and no longer does


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
    quality: Float
    moving: Float  # faded count of frames in which the line moved against the static world
    flagged: NDArray[np.bool_]  # as moving
    shape: Float  # (T, 3) strength, inner and outer radius
    descriptor: Float32  # (T, K)


def _no_tracks(length: int) -> _Tracks:
    whole, real = np.empty(0, dtype=np.int64), np.empty(0)
    flagged, shape, descriptor = real > 0.0, np.empty((0, 3)), np.empty((0, length), dtype=np.float32)
    return _Tracks(whole, whole, whole, real, real, whole, real, real, flagged, shape, descriptor)


class Tracker:
    """Continues tracks with a frame's lines; a line that continues none begins one."""

    def __init__(self, vision: Vision) -> None:
        self._vision = vision
        self._frame = -1
        self._next_id = 0
        self._tracks = _no_tracks(vision.areas * 2 * vision.bins)
        self._wave = 0.0, 0.0  # of the lines' own drifts, see `motion.sine_of`
        self.common_turn_rad = 0.0
        """How far all lines turned together in the newest frame, image angle; 0 in paper mode."""

    def step(self, lines: Lines, descriptor: Float32) -> Tracked:
        """The identities of a frame's lines; each identity goes to one line at most.

        descriptor  (N, K)  of the lines
        """
        self._frame += 1
        paper = self._vision.mode == "paper"
        cost: Float | None = None
        if paper:
            match = self._paper_match(descriptor)
        else:
            match, cost = self._predicted_match(lines, descriptor)
        fresh = match < 0
        if not paper:
            fresh &= lines.strength >= self._vision.min_length  # a weak line may continue a track, not begin one
        return self._updated(lines, descriptor, match, cost, fresh)

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

    def _predicted_match(self, lines: Lines, descriptor: Float32) -> tuple[Int, Float]:
        """The track of each line, or -1, by least total cost around where each line should be; and the pairs' costs.

        # Paper: the three rules on descriptors alone. Here: descriptor, polarity and predicted bearing together,
        # because similar lines (door frames, shelves) are told apart by where they are; the turn common to all lines,
        # and how driving moves them, are taken from the lines themselves first.
        """
        tracks, frame, vision = self._tracks, self._frame, self._vision
        D = distances(descriptor, tracks.descriptor, vision.dissimilarity, vision.bins)
        recent = np.flatnonzero(tracks.seen >= tracks.seen.max(initial=0) - _TURN_FRAMES)
        usual = wrap(tracks.angle + tracks.drift)
        D_recent = D[:, recent]
        sides = lines.polarity, tracks.polarity[recent]
        turn = common_turn(lines.angle_rad, usual[recent], D_recent, *sides)
        self.common_turn_rad = self.common_turn_rad if turn is None else turn  # without evidence it goes on
        flow, unlike = self._flow(lines, D_recent, wrap(usual[recent] + self.common_turn_rad), recent)
        self.common_turn_rad = flow.turn
        drift = flow.of(tracks.angle, tracks.drift)
        tracks = self._tracks = tracks._replace(angle=wrap(tracks.angle + drift + flow.turn), drift=drift)
        young = (tracks.seen - tracks.born < _YOUNG_FRAMES) | (tracks.moving > 0.5)
        own = np.hypot(np.where(young, _YOUNG_STD_RAD, KNOWN_STD_RAD), flow.spread)
        std = np.minimum(own * np.sqrt(frame - tracks.seen), _MAX_STD_RAD)
        cost = self._costs(lines, D, tracks.angle, std, slice(None), DESCRIPTOR_STD * unlike)
        return assigned(cost), cost

    def _costs(
        self,
        lines: Lines,
        D: Float,
        predicted: Float,
        std: Float,
        rows: slice | NDArray[np.intp],
        descriptor_std: float,
    ) -> Float:
        """Costs of the frame's lines and some rows of the tracks."""
        polarity, shape = self._tracks.polarity[rows], self._tracks.shape[rows]
        own = lines.angle_rad, lines.polarity, _shapes(lines)
        return costs(D, *own, predicted, std, polarity, shape, self._vision.f1, descriptor_std)

    def _flow(self, lines: Lines, D: Float, usual: Float, recent: NDArray[np.intp]) -> tuple[Flow, float]:
        """How lines move since the last frame, and how much their descriptors change, of what is usual, at least 1.

        D      (N, R)  distances from the recent tracks
        usual  (R,)    where their lines would be if all went on as it was
        Both from pairs that are each other's best within a wide gate.
        """
        tracks, turn = self._tracks, self.common_turn_rad
        if D.size == 0:
            return Flow(turn, 1.0, 0.0, 0.0, 0.0), 1.0
        cost = self._costs(lines, D, usual, np.full(usual.size, _LOOSE_STD_RAD), recent, DESCRIPTOR_STD)
        row, column = mutual_best(cost)
        if row.size < _FLOW_SHARE * recent.size:  # a smeared frame: the few pairs in it are mostly chance
            return Flow(turn, 1.0, 0.0, 0.0, 0.0), 1.0
        unlike = float(np.partition(D[row, column], row.size // 2)[row.size // 2]) / _USUAL_DISTANCE
        track = recent[column]
        moved = wrap(lines.angle_rad[row] - tracks.angle[track])
        return common_flow(turn, tracks.angle[track], tracks.drift[track], moved), max(unlike, 1.0)

    def _updated(
        self, lines: Lines, descriptor: Float32, match: Int, cost: Float | None, fresh: NDArray[np.bool_]
    ) -> Tracked:
        line, new = np.flatnonzero(match >= 0), np.flatnonzero(fresh)
        track = match[line]
        fit = np.ones(line.size) if cost is None else np.maximum(1.0 - cost[line, track] / NEW_COST, 0.0)
        row = np.concatenate((track, self._tracks.track_id.size + np.arange(new.size)))
        self._learn(lines, descriptor, line, track, fit)
        self._begin(lines, descriptor, new)
        tracks, order = self._tracks, np.argsort(row, kind="stable")
        row = row[order]
        result = Tracked(
            np.concatenate((line, new))[order],
            tracks.track_id[row],
            self._frame - tracks.born[row],
            tracks.quality[row],
            tracks.flagged[row],
        )
        kept = self._frame - tracks.seen < self._vision.lookback_frames
        if not kept.all():
            self._tracks = _Tracks(*(a[kept] for a in tracks))  # type: ignore[arg-type]  # one row each
        return result

    def _learn(
        self, lines: Lines, descriptor: Float32, line: NDArray[np.intp], track: Int, fit: NDArray[np.float64]
    ) -> None:
        """Takes what a frame's lines say of their tracks into these; fit: how well each pair does, 0..1."""
        tracks = self._tracks
        surprise = wrap(lines.angle_rad[line] - tracks.angle[track])
        own = tracks.drift[track] + _DRIFT_GAIN * surprise / (self._frame - tracks.seen[track])
        tracks.drift[:] *= _DRIFT_FADE
        tracks.quality[:] *= 1.0 - _QUALITY_GAIN
        tracks.drift[track], tracks.quality[track] = own, tracks.quality[track] + _QUALITY_GAIN * fit
        tracks.angle[track], tracks.polarity[track] = lines.angle_rad[line], lines.polarity[line]
        tracks.seen[track] = self._frame
        tracks.descriptor[track], tracks.shape[track] = descriptor[line], _shapes(lines)[line]
        self._wave = sine_of(tracks.angle[track], own)
        self._judge_motion(track)

    def _begin(self, lines: Lines, descriptor: Float32, new: NDArray[np.intp]) -> None:
        """Begins a track with each of some lines."""
        if new.size == 0:
            return
        angle, now, none = lines.angle_rad[new], np.full(new.size, self._frame), np.zeros(new.size)
        begun = _Tracks(
            track_id=self._next_id + np.arange(new.size),
            born=now,
            seen=now,
            angle=angle,
            drift=self._wave[0] * np.cos(angle) + self._wave[1] * np.sin(angle),
            polarity=lines.polarity[new],
            quality=none + _QUALITY_GAIN,
            moving=none,
            flagged=none > 0.0,
            shape=_shapes(lines)[new],
            descriptor=descriptor[new],
        )
        self._next_id += new.size
        rows: zip[tuple[NDArray[Any], NDArray[Any]]] = zip(self._tracks, begun, strict=True)
        self._tracks = _Tracks(*(np.concatenate(both) for both in rows))

    def _judge_motion(self, track: Int) -> None:
        """Gathers evidence that lines move, and flags some: they drift against what driving does there, or far more.

        A near line of the static world drifts faster than the others, a far one slower; none against them, and none
        many times as fast, because a robot keeps its distance from walls.
        """
        tracks, (cos_part, sin_part) = self._tracks, self._wave
        angle, drift = tracks.angle[track], tracks.drift[track]
        usual = cos_part * np.cos(angle) + sin_part * np.sin(angle)
        with_it = np.where(drift * usual > 0.0, _NEAR_TIMES * np.hypot(cos_part, sin_part), 0.0)
        moving = _MOVING_FADE * tracks.moving[track] + (np.abs(drift) - with_it > _MOVING_RAD)
        tracks.moving[track] = moving
        tracks.flagged[track] = np.where(tracks.flagged[track], moving > _MOVING_OFF, moving > _MOVING_ON)


def _shapes(lines: Lines) -> Float:
    """(N, 3) strength, inner and outer radius."""
    return np.stack((lines.strength, lines.inner_px, lines.outer_px), axis=1)
