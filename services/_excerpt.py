"""What of a recording is played: the sensors' messages between two times of it, once or round after round."""

import dataclasses
from collections.abc import Iterator

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Bearings, Frame, Message, Scan, Ticks
from omnivert.wire.channels import BEARINGS, FRAME, SCAN, TICKS, Channel
from omnivert.wire.recording import Recording

CHANNELS: dict[type[Message], Channel] = {Frame: FRAME, Ticks: TICKS, Scan: SCAN, Bearings: BEARINGS}
SECOND = 1_000_000_000


class Excerpt:
    """The sensors' messages between two times of a recording."""

    def __init__(self, recording: Recording, config: Config, from_s: float | None, to_s: float | None) -> None:
        self._recording = recording
        self._from_s, self._to_s = from_s, to_s
        rig = recording.config(config)
        camera = Frame if FRAME.key(rig) in recording.counts else Bearings
        self._types: tuple[type[Message], ...] = (camera, Ticks, Scan)
        self.consumer = "vision" if camera is Frame else "calibration"
        self._period_ns = round(SECOND / rig.camera.frame_rate_hz)
        self._keys = {CHANNELS[sensor].key(rig) for sensor in self._types}
        if not self._keys & set(recording.counts):
            raise DataError("OV305", f"{recording.path} holds no sensor data", f"only {', '.join(recording.counts)}")
        if not self.count():
            because = f"it lasts {1e-9 * (recording.end_ns - recording.start_ns):.1f} s"
            again = "omnivert play corridor --from 5 --to 10"
            raise DataError("OV305", f"{recording.path} holds no sensor data in this part", because, again)

    def count(self) -> int:
        return self._recording.count(self._keys, self._from_s, self._to_s)

    def rounds(self, loop: bool) -> Iterator[Message]:
        """The messages in order; in a loop stamps and ticks go on growing from round to round."""
        later_ns, left, right = 0, 0, 0
        while True:
            first_ns, last_ns, frames = -1, 0, 0
            first: tuple[int, int] | None = None
            last = (0, 0)
            for key, message in self._recording.messages(self._types, self._from_s, self._to_s):
                if key not in self._keys:
                    continue
                if first_ns < 0:
                    first_ns = message.stamp_ns
                last_ns = message.stamp_ns
                frames += isinstance(message, Frame | Bearings)
                if isinstance(message, Ticks):
                    first, last = first or (message.left, message.right), (message.left, message.right)
                    message = dataclasses.replace(message, left=message.left + left, right=message.right + right)
                yield dataclasses.replace(message, stamp_ns=message.stamp_ns + later_ns)
            if not loop or first_ns < 0:
                return
            lasted_ns = last_ns - first_ns
            later_ns += lasted_ns + (lasted_ns // (frames - 1) if frames > 1 else self._period_ns)
            if first is not None:
                left, right = left + last[0] - first[0], right + last[1] - first[1]
