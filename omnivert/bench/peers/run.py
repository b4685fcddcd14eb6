"""One peer over a folder of frames: `python run.py FOLDER PEER`. Needs numpy and opencv-contrib only, not omnivert.

Its settings are the best that a sweep on the corridor has found for it: the most true lines a frame at a precision of
0.9 or more where the peer reaches that at all, then the most links right.

* All look at the ring's bounding box only, and get the ring's centre of each frame, as omnivert has found it, for free.
* edlines, lsd: `BinaryDescriptor.detect` and `LSDDetector.detect`, one octave. Segments in the ring that point at its
  centre within 20 deg (5 to 30 make no difference) stay; those of one polarity within 0.35 deg of each other are one
  line, at the mean bearing of their middles, weighted by length. A line must have 0.10 (lsd: 0.14) of the ring's width
  in length. Its longest segment is described by LBD, as floats: with its bits 1 to 2 % fewer links are right.
* orb, sift: the best 2000 (sift: 600) key points in the ring, FAST threshold 10 (contrast threshold 0.02), kept where
  the grey gradient stands across the direction to the centre within 20 deg. With half of them recall halves, too; with
  1000 SIFT finds 0.87 of the strong lines, at a precision of 0.55 and 7 % fewer links right.
* Matching: mutual nearest neighbour, ratio test and a greatest distance (LBD 0.9 and 0.4, ORB 0.95 and 45 bits, SIFT
  0.95 and 250) against what the frame before held; what is left, against all that was lost in the last 20 frames; the
  rest is new.

In the folder: pictures, the frames' grey bytes (F, height, width) one after the other; job.json {width_px, height_px,
centers_px: for each frame [u, v] or null, r_min_px, r_max_px, bearing_sign}. It writes PEER.npz: frame, track_id,
bearing_rad of all sightings; seconds (frames with a ring, 3) of detecting, describing, matching; sobel_s (F,). A dot on
stdout for each frame.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

contrib: Any = cv2  # what only this build of OpenCV has is not known to type checkers
Float = NDArray[np.float64]
Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]

RADIAL_DEG = 20.0
MERGE_DEG = 0.35
LOOKBACK = 20
WARM_UP = 3  # frames that are run twice, first without a clock
BORDER_PX = 8  # of the picture beyond the ring's box, for what describes an edge at the rim


class Ring(NamedTuple):
    u_px: float
    v_px: float
    r_min_px: float
    r_max_px: float


class Features(NamedTuple):
    """What a peer has found in a frame."""

    angle_rad: Float  # (N,) image angle about the ring's centre, counter-clockwise on the screen
    descriptor: NDArray[Any]  # (N, K) bits as uint8, or float32
    seconds: tuple[float, float]  # detecting, describing


class Segments(NamedTuple):
    """Radial segments, (N,) each."""

    angle_rad: Float
    length_px: Float
    polarity: NDArray[np.int64]
    key_line: list[Any]


class Peer(Protocol):
    def step(self, grey: Grey, ring: Ring) -> Features: ...


# ---------------------------------------------------------------------------------------- lines


class LinePeer:
    """Segments of a detector, described by LBD."""

    def __init__(self, detect: Callable[[Grey], Any], min_length: float) -> None:
        self._detect = detect
        self._min_length = min_length
        self._lbd = contrib.line_descriptor.BinaryDescriptor.createBinaryDescriptor()
        self._lbd.setNumOfOctaves(1)

    def step(self, grey: Grey, ring: Ring) -> Features:
        began = time.perf_counter()
        segments = radial_segments(self._detect(grey), grey, ring)
        lines = merged(segments, self._min_length * (ring.r_max_px - ring.r_min_px), np.deg2rad(MERGE_DEG))
        detected = time.perf_counter()
        chosen = lines.key_line
        for index, key_line in enumerate(chosen):
            key_line.class_id = index
        descriptor = self._lbd.compute(grey, chosen, None, True)[1] if chosen else np.empty((0, 72), dtype=np.float32)
        described = time.perf_counter()
        return Features(lines.angle_rad, descriptor, (detected - began, described - detected))


def radial_segments(key_lines: Any, grey: Grey, ring: Ring) -> Segments:
    """Those of the detector's segments that lie in the ring and point at its centre."""
    if not key_lines:
        return Segments(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64), [])
    ends = np.array([(k.startPointX, k.startPointY, k.endPointX, k.endPointY) for k in key_lines], dtype=np.float64)
    start = np.stack((ends[:, 0] - ring.u_px, ring.v_px - ends[:, 1]), axis=1)
    end = np.stack((ends[:, 2] - ring.u_px, ring.v_px - ends[:, 3]), axis=1)
    middle, along = 0.5 * (start + end), end - start
    length, radius = np.hypot(*along.T), np.hypot(*middle.T)
    sine = np.abs(along[:, 0] * middle[:, 1] - along[:, 1] * middle[:, 0]) / np.maximum(length * radius, 1e-9)
    kept = (sine < np.sin(np.deg2rad(RADIAL_DEG))) & (radius > ring.r_min_px) & (radius < ring.r_max_px)
    rows = np.flatnonzero(kept)
    angle = np.arctan2(middle[rows, 1], middle[rows, 0])
    polarity = np.sign(step_across(grey, ring, angle, radius[rows])).astype(np.int64)
    return Segments(angle, length[rows], polarity, [key_lines[i] for i in rows])


def step_across(grey: Grey, ring: Ring, angle: Float, radius: Float) -> Float:
    """Grey two pixels counter-clockwise of a point less grey two pixels clockwise of it, (N,)."""
    sides = []
    for side in (2.0, -2.0):
        turned = angle + side / radius
        u = np.clip(np.rint(ring.u_px + radius * np.cos(turned)), 0, grey.shape[1] - 1).astype(np.intp)
        v = np.clip(np.rint(ring.v_px - radius * np.sin(turned)), 0, grey.shape[0] - 1).astype(np.intp)
        sides.append(grey[v, u].astype(np.float64))
    return sides[0] - sides[1]


def merged(segments: Segments, min_length_px: float, width_rad: float) -> Segments:
    """One line for the segments of one polarity at one bearing, long enough together; described by the longest."""
    used = np.zeros(segments.angle_rad.size, dtype=np.bool_)
    angle, length, polarity, chosen = [], [], [], []
    for i in np.argsort(-segments.length_px, kind="stable"):
        if used[i]:
            continue
        off = (segments.angle_rad - segments.angle_rad[i] + np.pi) % (2.0 * np.pi) - np.pi
        mine = ~used & (np.abs(off) <= width_rad) & (segments.polarity == segments.polarity[i])
        used |= mine
        together = float(np.sum(segments.length_px[mine]))
        if together < min_length_px:
            continue
        angle.append(segments.angle_rad[i] + float(np.sum(off[mine] * segments.length_px[mine])) / together)
        length.append(together)
        polarity.append(int(segments.polarity[i]))
        chosen.append(segments.key_line[i])
    return Segments(np.array(angle), np.array(length), np.array(polarity, dtype=np.int64), chosen)


# ---------------------------------------------------------------------------------------- key points


class PointPeer:
    """Key points on radial edges, described by their own kind's descriptor."""

    def __init__(self, kind: Any) -> None:
        self._kind = kind

    def step(self, grey: Grey, ring: Ring) -> Features:
        began = time.perf_counter()
        points = self._kind.detect(grey, ring_mask(grey, ring))
        points = [points[i] for i in np.flatnonzero(on_radial_edges(points, grey, ring))]
        detected = time.perf_counter()
        points, descriptor = self._kind.compute(grey, points)
        described = time.perf_counter()
        if descriptor is None:
            descriptor = np.empty((0, self._kind.descriptorSize()), dtype=np.uint8)
        place = np.array([p.pt for p in points], dtype=np.float64).reshape(-1, 2)
        angle = np.arctan2(ring.v_px - place[:, 1], place[:, 0] - ring.u_px)
        return Features(angle, descriptor, (detected - began, described - detected))


def ring_mask(grey: Grey, ring: Ring) -> Grey:
    """255 between the two radii, else 0."""
    mask = np.zeros(grey.shape, dtype=np.uint8)
    center = (round(ring.u_px), round(ring.v_px))
    cv2.circle(mask, center, round(ring.r_max_px), 255, -1)
    cv2.circle(mask, center, round(ring.r_min_px), 0, -1)
    return mask


def on_radial_edges(points: Any, grey: Grey, ring: Ring) -> Mask:
    """Which points have their grey gradient across the direction to the ring's centre, (N,)."""
    place = np.array([p.pt for p in points], dtype=np.float64).reshape(-1, 2)
    u = np.clip(np.rint(place[:, 0]), 0, grey.shape[1] - 1).astype(np.intp)
    v = np.clip(np.rint(place[:, 1]), 0, grey.shape[0] - 1).astype(np.intp)
    gu = cv2.Sobel(grey, cv2.CV_16S, 1, 0)[v, u].astype(np.float64)
    gv = cv2.Sobel(grey, cv2.CV_16S, 0, 1)[v, u].astype(np.float64)
    x, y = place[:, 0] - ring.u_px, place[:, 1] - ring.v_px
    along = np.abs(gu * x + gv * y)
    size = np.hypot(gu, gv) * np.hypot(x, y)
    return np.asarray((size > 0.0) & (along <= np.sin(np.deg2rad(RADIAL_DEG)) * size))


# ---------------------------------------------------------------------------------------- matching


class Matcher:
    """Identities by descriptors: what the frame before held first, then all that was lost in the last 20 frames."""

    def __init__(self, norm: int, ratio: float, greatest: float) -> None:
        self._matcher = cv2.BFMatcher(norm)
        self._ratio, self._greatest = ratio, greatest
        self._frame = 0
        self._next_id = 0
        self._tracks: dict[int, tuple[int, NDArray[Any]]] = {}  # id -> frame of its last sighting, descriptor there

    def step(self, descriptor: NDArray[Any]) -> NDArray[np.int64]:
        """The track of each feature, (N,)."""
        before = [i for i, (seen, _) in self._tracks.items() if seen == self._frame - 1]
        lost = [i for i, (seen, _) in self._tracks.items() if seen < self._frame - 1]
        track = np.full(len(descriptor), -1, dtype=np.int64)
        for known in (before, lost):
            still = np.flatnonzero(track < 0)
            if still.size and known:
                there = np.stack([self._tracks[i][1] for i in known])
                for i, j in self._pairs(descriptor[still], there):
                    track[still[i]] = known[j]
        new = np.flatnonzero(track < 0)
        track[new] = self._next_id + np.arange(new.size)
        self._next_id += new.size
        for i, each in zip(track.tolist(), descriptor, strict=True):
            self._tracks[i] = (self._frame, each)
        self._tracks = {i: (f, d) for i, (f, d) in self._tracks.items() if self._frame - f < LOOKBACK}
        self._frame += 1
        return track

    def _pairs(self, here: NDArray[Any], there: NDArray[Any]) -> list[tuple[int, int]]:
        """Mutual nearest neighbours that are near enough and pass the ratio test."""
        back = {m.queryIdx: m.trainIdx for m in self._matcher.match(there, here)}
        pairs = []
        for nearest in self._matcher.knnMatch(here, there, k=2):
            first = nearest[0]
            distinct = len(nearest) == 1 or first.distance < self._ratio * nearest[1].distance
            near = first.distance <= self._greatest
            if near and distinct and back[first.trainIdx] == first.queryIdx:
                pairs.append((first.queryIdx, first.trainIdx))
        return pairs


# ---------------------------------------------------------------------------------------- the run


def edlines() -> tuple[Peer, Matcher]:
    detector = contrib.line_descriptor.BinaryDescriptor.createBinaryDescriptor()
    detector.setNumOfOctaves(1)
    return LinePeer(detector.detect, 0.10), Matcher(cv2.NORM_L2, 0.9, 0.4)


def lsd() -> tuple[Peer, Matcher]:
    detector = contrib.line_descriptor.LSDDetector.createLSDDetector()
    return LinePeer(lambda grey: detector.detect(grey, 2, 1), 0.14), Matcher(cv2.NORM_L2, 0.9, 0.4)


def orb() -> tuple[Peer, Matcher]:
    return PointPeer(contrib.ORB_create(2000, fastThreshold=10)), Matcher(cv2.NORM_HAMMING, 0.95, 45.0)


def sift() -> tuple[Peer, Matcher]:
    return PointPeer(contrib.SIFT_create(600, contrastThreshold=0.02)), Matcher(cv2.NORM_L2, 0.95, 250.0)


PEERS: dict[str, Callable[[], tuple[Peer, Matcher]]] = {"edlines": edlines, "lsd": lsd, "orb": orb, "sift": sift}


def cropped(grey: Grey, ring: Ring) -> tuple[Grey, Ring]:
    """The ring's box of the picture, and the ring in it."""
    reach = ring.r_max_px + BORDER_PX
    u, v = max(int(ring.u_px - reach), 0), max(int(ring.v_px - reach), 0)
    part = grey[v : int(ring.v_px + reach) + 2, u : int(ring.u_px + reach) + 2]
    return np.ascontiguousarray(part), ring._replace(u_px=ring.u_px - u, v_px=ring.v_px - v)


def sobel_pair_s(grey: Grey) -> float:
    """The yardstick, as omnivert.bench.yardstick has it."""
    began = 0.0
    for _ in range(2):
        began = time.perf_counter()
        cv2.Sobel(grey, cv2.CV_16S, 1, 0)
        cv2.Sobel(grey, cv2.CV_16S, 0, 1)
    return time.perf_counter() - began


def main(folder: Path, name: str) -> None:
    cv2.setNumThreads(1)
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    shape = (len(job["centers_px"]), job["height_px"], job["width_px"])
    frames = np.memmap(folder / "pictures", dtype=np.uint8, mode="r", shape=shape)
    peer, matcher = PEERS[name]()
    sightings: list[tuple[int, NDArray[np.int64], Float]] = []
    seconds, sobel = [], []
    for index, center in enumerate(job["centers_px"]):
        grey = np.array(frames[index])
        sobel.append(sobel_pair_s(grey))
        if center is None:
            matcher.step(np.empty((0, 0), dtype=np.uint8))
        else:
            ring = Ring(center[0], center[1], job["r_min_px"], job["r_max_px"])
            if index < WARM_UP:
                peer.step(*cropped(grey, ring))
            began = time.perf_counter()
            box = cropped(grey, ring)
            cut = time.perf_counter() - began
            found = peer.step(*box)
            began = time.perf_counter()
            track = matcher.step(found.descriptor)
            seconds.append((cut + found.seconds[0], found.seconds[1], time.perf_counter() - began))
            sightings.append((index, track, found.angle_rad))
        sys.stdout.write(".")
        sys.stdout.flush()
    bearing = job["bearing_sign"] * np.concatenate([np.empty(0), *(angle for _, _, angle in sightings)])
    np.savez(
        folder / f"{name}.npz",
        frame=np.concatenate([np.empty(0, dtype=np.int64), *(np.full(t.size, k) for k, t, _ in sightings)]),
        track_id=np.concatenate([np.empty(0, dtype=np.int64), *(track for _, track, _ in sightings)]),
        bearing_rad=(bearing + np.pi) % (2.0 * np.pi) - np.pi,
        seconds=np.array(seconds).reshape(-1, 3),
        sobel_s=np.array(sobel),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
