"""Extrinsics are said again until storage has acknowledged them."""

from collections import OrderedDict

from omnivert.messages import Extrinsics, Receipt
from omnivert.wire.received import Received

_MAX_PENDING = 16
_PERIOD_S = 1.0


class Repeater:
    """Remembers what was claimed.

    newest     the newest claim, for whoever asks; none of a playback, which an answer could not tell of
    given_up   claims that were dropped because too many newer ones wait
    repeated   whether a claim waits that has been said more than once
    """

    def __init__(self) -> None:
        self.newest: Extrinsics | None = None
        self.given_up = 0
        self.repeated = False
        self._pending: OrderedDict[tuple[str, str, int], tuple[Extrinsics, Received]] = OrderedDict()
        self._due_s = 0.0

    def claim(self, extrinsics: Extrinsics, cause: Received, now_s: float) -> None:
        """It has just been published for the first time, with this cause."""
        self.newest = None if cause.replay else extrinsics
        self._pending[extrinsics.robot, extrinsics.camera, extrinsics.stamp_ns] = (extrinsics, cause)
        if len(self._pending) > _MAX_PENDING:
            self._pending.popitem(last=False)
            self.given_up += 1
        self._due_s = now_s + _PERIOD_S

    def acknowledge(self, receipt: Receipt) -> None:
        """Storage has it."""
        self._pending.pop((receipt.robot, receipt.camera, receipt.stamp_ns), None)
        self.repeated = self.repeated and bool(self._pending)

    def due(self, now_s: float) -> tuple[tuple[Extrinsics, Received], ...]:
        """What has to be said again now and its cause, oldest first."""
        if not self._pending or now_s < self._due_s:
            return ()
        self._due_s = now_s + _PERIOD_S
        self.repeated = True
        return tuple(self._pending.values())
