"""The stamps of a topic, held to what one drive on one clock has."""

from omnivert.errors import DataError
from omnivert.formats.drive_folder import LONGEST_GAP_S
from omnivert.formats.rosbag.file import Received
from omnivert.formats.table import NS_PER_S

_CURE = "--bag-times stamps everything by the time of recording: less exact, but of one clock"


class InOrder:
    """Follows a topic from message to message.

    bag_times  the time of recording is taken, not the stamp in the message
    place      of the newest message
    """

    def __init__(self, bag_times: bool) -> None:
        self.place = ""
        self._bag_times = bag_times
        self._newest_ns: int | None = None

    def stamp_ns(self, received: Received) -> int:
        """Of this message.

        raises  DataError when it is zero, runs backwards, or jumps farther than any drive stands still
        """
        stamp = received.bag_ns if self._bag_times else received.header_ns
        if stamp == 0:
            because = "its stamp is zero: whoever sent it did not stamp it"
            raise DataError("OV333", received.place, because, _CURE)
        if self._newest_ns is not None:
            step_s = (stamp - self._newest_ns) / NS_PER_S
            if step_s < 0:
                because = f"the time runs backwards, by {-step_s:.9g} s: a clock was set, or two senders share a topic"
                raise DataError("OV333", received.place, because, "" if self._bag_times else _CURE)
            if step_s > LONGEST_GAP_S:
                because = f"the time jumps by {step_s:.9g} s; one drive has no such gap"
                raise DataError("OV333", received.place, because, "" if self._bag_times else _CURE)
        self._newest_ns, self.place = stamp, received.place
        return stamp
