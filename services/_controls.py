"""What somebody wants of a playback while it plays: stand still, step from frame to frame, go on, end."""

import threading


class Controls:
    """For any thread.

    A step plays the next frame and all that comes before the one after it, so that the frame's estimate comes, too.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._paused = False
        self._ended = False
        self._steps = 0  # asked for and not yet done
        self._shown = False  # the frame of this step has been played

    @property
    def paused(self) -> bool:
        return self._paused

    @property
    def ended(self) -> bool:
        return self._ended

    def pause_or_go(self) -> None:
        with self._changed:
            self._paused, self._steps, self._shown = not self._paused, 0, False
            self._changed.notify_all()

    def step(self) -> None:
        """One frame; a playback that runs stands still after it."""
        with self._changed:
            self._paused, self._steps = True, self._steps + 1
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def holds(self, is_frame: bool) -> bool:
        """Whether the playback stands still before this message."""
        with self._changed:
            if not self._paused:
                return False
            if is_frame and self._shown:
                self._steps, self._shown = self._steps - 1, False
            return self._steps == 0

    def played(self, is_frame: bool) -> None:
        with self._changed:
            self._shown = self._shown or (is_frame and self._steps > 0)

    def wait(self, timeout_s: float) -> None:
        """Until something else is wanted."""
        with self._changed:
            self._changed.wait(timeout_s)
