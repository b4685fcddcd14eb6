"""A ROS bag -> messages in order of stamp: pictures, the wheels' counts, and laser scans where there are some."""

import heapq
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import islice, pairwise
from pathlib import Path
from statistics import median
from typing import Any

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.formats import origin
from omnivert.formats.rosbag.file import Bag, Received, Topic
from omnivert.formats.rosbag.sensors import frame, scan
from omnivert.formats.rosbag.stamps import InOrder
from omnivert.formats.rosbag.topics import Named, chosen
from omnivert.formats.rosbag.wheels import turned
from omnivert.formats.table import NS_PER_S
from omnivert.formats.wheels import passed_over
from omnivert.formats.written import Progress
from omnivert.messages import Frame, Message

_FIRST = 50  # images that the rate is taken from
_SLOWEST_HZ, _FASTEST_HZ = 1e-3, 1000.0  # rates that a configuration can hold


class RosBag:
    """A bag whose wheels have been read and held to their form; images and scans are read when their turn comes.

    config    `base` with what the bag says of the rig in it
    counts    messages by type; of images and scans as the bag tells, and as they were once all have been read
    read      messages of the wheels
    shift_ns  what is added to every stamp, so that the drive begins within a second of zero
    notes     which topics were taken and what was made of them, in words
    raises    DataError naming topic and message, UseError when what was named is not there
    """

    def __init__(self, path: Path, base: Config, named: Named, bag_times: bool, progress: Progress | None) -> None:
        self._bag = Bag(path)
        self._streams = chosen(self._bag, named)
        self._bag_times = bag_times
        self.read = 0
        first, rate_hz = self._first_images()
        self._size = first.width_px, first.height_px
        self._turned = turned(self._bag, self._streams.wheels, base, bag_times, self._step(progress))
        self.config = self._config(base, rate_hz)
        self._first_image_ns, firsts = first.stamp_ns, [first.stamp_ns, int(self._turned.stamp_ns[0])]
        if self._streams.scan is not None:
            firsts += [stamp for stamp, _ in islice(self._stamped(self._streams.scan), 1)]
        self.shift_ns = -(min(firsts) // NS_PER_S * NS_PER_S)
        counts = {
            "Frame": self._streams.image.count,
            "Ticks": len(self._turned.stamp_ns),
            "Scan": self._streams.scan.count if self._streams.scan is not None else 0,
        }
        self.counts = {name: count for name, count in counts.items() if count}
        self.notes = self._notes(base)

    def messages(self) -> Iterator[Message]:
        """Everything in order of stamp; at equal stamps ticks, then scans, then frames.

        raises  DataError where the bag cannot be read on, or wheels and images have no time in common
        """
        found: Counter[str] = Counter()
        streams: list[Iterator[Message]] = [self._turned.ticks(self.shift_ns)]
        if self._streams.scan is not None:
            streams.append(
                scan(received, stamp + self.shift_ns) for stamp, received in self._stamped(self._streams.scan)
            )
        streams.append(self._frames())
        for message in heapq.merge(*streams, key=lambda message: message.stamp_ns):
            found[type(message).__name__] += 1
            yield message
        self.counts = {name: found[name] for name in ("Frame", "Ticks", "Scan") if found[name]}

    def attachments(self) -> Iterator[tuple[str, bytes]]:
        """Where the recording is from, and where its clock has its origin."""
        scan_topic = self._streams.scan.name if self._streams.scan is not None else None
        told = origin.written(
            -self.shift_ns,
            bag=self._bag.path.name,
            image_topic=self._streams.image.name,
            wheels=[topic.name for topic in self._streams.wheels.topics],
            scan_topic=scan_topic,
            notes=list(self.notes),
        )
        yield origin.ATTACHMENT, told

    def _step(self, progress: Progress | None) -> Callable[[], None]:
        wheels = sum(topic.count for topic in self._streams.wheels.topics)
        images = self._streams.image.count

        def step() -> None:
            self.read += 1
            if progress is not None:
                progress(self.read, 2 * wheels + images)

        return step

    def _stamped(self, topic: Topic) -> Iterator[tuple[int, Received]]:
        order = InOrder(self._bag_times)
        return ((order.stamp_ns(received), received) for received in self._bag.messages(topic))

    def _first_images(self) -> tuple[Frame, float]:
        """The first image, and how many come in a second by the median interval of the first ones."""
        stamps: list[int] = []
        first: Frame | None = None
        for stamp, received in islice(self._stamped(self._streams.image), _FIRST):
            first = first or frame(received, stamp)
            stamps.append(stamp)
        if first is None:  # the bag's index has told otherwise
            raise DataError("OV332", f"{self._streams.image} holds nothing", "", "omnivert explain OV332")
        steps = [after - before for before, after in pairwise(stamps) if after > before]
        rate = NS_PER_S / median(steps) if steps else 1.0
        return first, float(f"{min(max(rate, _SLOWEST_HZ), _FASTEST_HZ):.4g}")

    def _frames(self) -> Iterator[Frame]:
        """Each of the size of the first one."""
        newest, first_place = self._first_image_ns, ""
        for newest, received in self._stamped(self._streams.image):
            if not first_place:
                first_place = received.place
                self._hold_begun(first_place)
            image = frame(received, newest + self.shift_ns)
            if (image.width_px, image.height_px) != self._size:
                size, said = f"{image.width_px} x {image.height_px}", f"{self._size[0]} x {self._size[1]}"
                because = f"the image has {size} pixels, the first one {said}"
                raise DataError("OV333", received.place, because, "omnivert explain OV333")
            yield image
        early_s = (self._turned.stamp_ns[0] - newest) / NS_PER_S
        if early_s > 0:
            because = f"begins {early_s:.9g} s after the last image: not of one drive, or not of one clock"
            raise DataError("OV333", self._turned.first, because, self._one_clock)

    def _hold_begun(self, place: str) -> None:
        """raises DataError when the wheels end before the images begin"""
        late_s = (self._first_image_ns - self._turned.stamp_ns[-1]) / NS_PER_S
        if late_s > 0:
            because = f"ends {late_s:.9g} s before the first image ({place}): not of one drive, or not of one clock"
            raise DataError("OV333", self._turned.last, because, self._one_clock)

    @property
    def _one_clock(self) -> str:
        return "" if self._bag_times else "--bag-times stamps everything by the time of recording"

    def _config(self, base: Config, rate_hz: float) -> Config:
        width, height = self._size
        rig: dict[str, dict[str, Any]] = {
            "camera": {"width_px": width, "height_px": height, "frame_rate_hz": rate_hz},
            "encoder": self._turned.encoder,
        }
        try:
            return with_rig(base, rig, str(self._bag.path))
        except UseError as error:
            help = "set [ring] in the configuration to what these images show, and give it with --config"
            raise DataError("OV333", error.what, error.because, help) from error

    def _notes(self, base: Config) -> tuple[str, ...]:
        camera, (width, height) = base.camera, self._size
        wheels = " and ".join(map(str, self._streams.wheels.topics))
        taken = [f"images are taken from {self._streams.image}", f"the wheels are taken from {wheels}"]
        if self._streams.scan is not None:
            taken.append(f"laser scans are taken from {self._streams.scan}")
        if (width, height) != (camera.width_px, camera.height_px):
            taken.append(
                f"the images have {width} x {height} pixels, the configuration says {camera.width_px} x "
                f"{camera.height_px}: see that its [ring] is measured in these images"
            )
        if self.shift_ns:
            origin_s = -self.shift_ns // NS_PER_S
            date = datetime.fromtimestamp(origin_s, UTC)
            taken.append(f"stamps count from {origin_s} s of the bag's clock ({date:%Y-%m-%d %H:%M:%S} UTC)")
        if self._bag_times:
            taken.append("everything is stamped by the time of recording, later than it was measured")
        doubted = passed_over("the wheels", self._turned.ticks(), self.config)
        unread = (self._bag.unread,) if self._bag.unread else ()
        return (*taken, *self._streams.notes, *self._turned.notes, *doubted, *unread)
