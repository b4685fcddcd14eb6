"""How far a playback may run ahead of its results, so that nothing has to be dropped.

A frame is on its way until its bearings have come, and, from when an estimate for it can exist, until that has come.
An estimate needs ticks past the frame, and a frame past those ticks, because the timeline waits for both.
"""

from collections import deque

from omnivert.messages import Bearings, Estimate, Frame, Message, Ticks


class Credits:
    """
    frame_ns, ticks_ns  stamps of the newest ones played
    lost                frames given up
    """

    def __init__(self, frames_ahead: int) -> None:
        self.frame_ns = 0
        self.ticks_ns = 0
        self.lost = 0
        self._ahead = frames_ahead
        self._last_frame_ns = self._last_ticks_ns = -1  # none yet
        self._without_bearings: deque[int] = deque()
        self._without_estimate: deque[int] = deque()
        self._possible_ns = -1  # estimates up to this stamp can exist

    def played(self, message: Message) -> None:
        match message:
            case Ticks():
                self._last_ticks_ns = self.ticks_ns = message.stamp_ns
            case Frame() | Bearings():
                self._possible_ns = min(self._last_ticks_ns, self._last_frame_ns)
                self._last_frame_ns = self.frame_ns = message.stamp_ns
                self._without_estimate.append(message.stamp_ns)
                if isinstance(message, Frame):
                    self._without_bearings.append(message.stamp_ns)

    def seen(self, result: Message) -> None:
        """A result has come; those before it will not come any more."""
        waiting = self._without_estimate if isinstance(result, Estimate) else self._without_bearings
        while waiting and waiting[0] <= result.stamp_ns:
            waiting.popleft()

    def may_play(self, vision: bool, calibration: bool) -> bool:
        """Whether the next frame may be played, when these services are there."""
        possible = sum(stamp <= self._possible_ns for stamp in self._without_estimate) if calibration else 0
        return possible < self._ahead and (not vision or len(self._without_bearings) < self._ahead)

    def complete(self, vision: bool, calibration: bool) -> bool:
        """Whether every result is in, at the end of the recording."""
        return not (vision and self._without_bearings) and not (calibration and self._without_estimate)

    def give_up(self, vision: bool, calibration: bool) -> int:
        """Waits no longer for what is on its way; returns how many frames that are."""
        lost = max(len(self._without_bearings) * vision, len(self._without_estimate) * calibration)
        self.lost += lost
        self._without_bearings.clear()
        self._without_estimate.clear()
        return lost
