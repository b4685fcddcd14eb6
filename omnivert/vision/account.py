"""Bearings of frame after frame -> what a person should know of the pictures, of the ring and of the mirror.

The vision service says it in its health, `omnivert track` of a recording; both say the same.
"""

import re
from collections import Counter, deque
from collections.abc import Iterable
from statistics import median
from typing import Self

import numpy as np

from omnivert.config import Config
from omnivert.messages import Bearings

_WINDOW_NS = 10 * 10**9
_NAMED = 3  # reasons in one note
_KNOWN_FRAMES = 5  # that showed the ring, before anything is said of it
_REMEMBERED = 50
_LEAN = 0.02  # of Rmax; about 2 deg of tilt. Lines that meet nearer lose nothing that counts
_SURE = 4.0  # sigmas
_OTHER_RADIUS = 0.01  # of Rmax
_NUMBER = re.compile(r"\d+")

ABOUT = ("frames", "ring", "mirror")
"""What `Account.notes` are about."""


class Account:
    """Counts the reasons of all frames and of the last ones, and watches where ring and meeting point lie."""

    def __init__(self, config: Config) -> None:
        self._ring, self._search = config.ring, config.vision.ring_search_px
        self._quality = config.vision.ring_min_quality
        self.frames = 0
        self.unusable = 0
        """Frames that gave a reason and no line."""
        self._counts: Counter[str] = Counter()
        self._text: dict[str, str] = {}  # of each kind of reason, the newest
        self._latest: deque[tuple[int, frozenset[str]]] = deque()  # stamp, kinds
        self._circles: deque[tuple[float, float, float]] = deque(maxlen=_REMEMBERED)
        self._meeting: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)  # px off the ring's centre, sigma

    @classmethod
    def of(cls, config: Config, bearings: Iterable[Bearings]) -> Self:
        """The account of a whole recording."""
        account = cls(config)
        for frame in bearings:
            account.step(frame)
        return account

    def step(self, bearings: Bearings) -> None:
        now = bearings.stamp_ns
        self.frames += 1
        self.unusable += is_unusable(bearings)
        kinds = {_NUMBER.sub("#", reason): reason for reason in bearings.reasons}
        self._counts.update(kinds.keys())
        self._text.update(kinds)
        self._latest.append((now, frozenset(kinds)))
        while abs(now - self._latest[0][0]) > _WINDOW_NS:  # also when the clock was set back
            self._latest.popleft()
        ring, meeting = bearings.ring, bearings.meeting
        if ring is None or ring.quality < self._quality:
            return
        self._circles.append((ring.center_u_px, ring.center_v_px, ring.radius_px))
        if meeting is not None:
            off = float(np.hypot(meeting.u_px - ring.center_u_px, meeting.v_px - ring.center_v_px))
            self._meeting.append((off if meeting.used else 0.0, meeting.std_px))

    @property
    def reasons(self) -> dict[str, int]:
        """Frames with each reason, the most frequent first; reasons that differ in numbers alone count as one."""
        return self._named(self._counts)

    def notes(self) -> dict[str, str]:
        """In words, by what they are about; what is as it should be has none."""
        told = {"frames": self._of_frames(), "ring": self._of_ring(), "mirror": self._of_mirror()}
        return {about: text for about, text in told.items() if text}

    def _named(self, counts: Counter[str]) -> dict[str, int]:
        return {self._text[kind]: times for kind, times in counts.most_common()}

    def _of_frames(self) -> str:
        counts = Counter(kind for _, kinds in self._latest for kind in kinds)
        named = [f"{reason} ({times})" for reason, times in self._named(counts).items()]
        more = [f"{len(named) - _NAMED} more"] if len(named) > _NAMED else []
        return f"last {len(self._latest)} frames: {', '.join([*named[:_NAMED], *more])}" if named else ""

    def _of_ring(self) -> str:
        if len(self._circles) < _KNOWN_FRAMES:
            return ""
        (u0, v0), r0 = self._ring.center_px, self._ring.r_max_px
        u, v, radius = _medians(self._circles)
        told = []
        if np.hypot(u - u0, v - v0) > self._search:
            told.append(f"centre ({u:.0f}, {v:.0f}) px, configured ({u0:.0f}, {v0:.0f})")
        if abs(radius - r0) > _OTHER_RADIUS * r0:
            told.append(f"radius {radius:.1f} px, configured {r0:.1f}")
        return f"ring is not as configured: {'; '.join(told)}" if told else ""

    def _of_mirror(self) -> str:
        if len(self._meeting) < _KNOWN_FRAMES:
            return ""
        off, std = _medians(self._meeting)
        if off < max(_LEAN * self._ring.r_max_px, _SURE * std):
            return ""
        return f"mirror axis not vertical: lines meet {off:.0f} px off the ring's centre; bearings are corrected"


def is_unusable(bearings: Bearings) -> bool:
    return bool(bearings.reasons) and bearings.track_id.size == 0


def _medians(rows: Iterable[tuple[float, ...]]) -> tuple[float, ...]:
    return tuple(median(column) for column in zip(*rows, strict=True))
