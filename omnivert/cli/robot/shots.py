"""Pictures from wherever a person has them: image files, folders, recordings, or the camera itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2

from omnivert.cli import say
from omnivert.cli.settings import PACKAGED, opened, title
from omnivert.config import Camera, Config
from omnivert.drivers.camera_look import patient_events
from omnivert.drivers.device import Finished, Lost, Refused
from omnivert.drivers.image_file import frame_from_path
from omnivert.drivers.image_folder import image_files
from omnivert.errors import DataError, UseError
from omnivert.messages import Frame
from omnivert.vision.image import Grey, grey_from_frame

MOST_SHOTS = 48
MOST_PIXELS = 200_000_000  # of all pictures together
LIVE_SHOTS = 8
LIVE_EVERY_S = 0.5  # between two shots of a camera: a robot that drives shows another place
LIVE_PATIENCE_S = 10.0  # for the next frame of a camera
T = TypeVar("T")


@dataclass(slots=True)
class Shots:
    """Grey pictures of one size, and what could not be used."""

    pictures: list[Grey] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # name: why

    def take(self, name: str, frame: Callable[[], Frame]) -> None:
        """One more, or the reason why not.

        raises  DataError when it is of another size than those before
        """
        try:
            grey = grey_from_frame(frame())
        except (OSError, ValueError) as error:
            self.left_out.append(f"{name}: {error}")
            return
        if self.pictures and grey.shape != self.pictures[0].shape:
            (h, w), (other_h, other_w) = self.pictures[0].shape, grey.shape
            because = f"{self.names[0]} has {w} x {h} pixels, {name} {other_w} x {other_h}"
            raise DataError(
                "OV121", "the pictures are not of one size", because, "give pictures of one camera in one of its modes"
            )
        self.pictures.append(grey)
        self.names.append(name)


def shots(sources: Sequence[str], config: Config) -> Shots:
    """Some pictures, evenly spread where there are many; of the configured camera where no source is named.

    raises  UseError where there is no such source; DataError when none can be used, or they differ in size
    """
    taken = Shots()
    if not sources:
        _shoot(taken, config.camera)
    else:
        _read(taken, sources)
    if not taken.pictures:
        because = taken.left_out[0] if taken.left_out else "there is no image in it"
        raise DataError("OV121", f"no picture of {', '.join(sources) or 'the camera'} can be used", because)
    return taken


def _read(taken: Shots, sources: Sequence[str]) -> None:
    files: list[Path] = []
    for source in sources:
        path = Path(source)
        if source == PACKAGED or path.suffix == ".mcap":
            _replay(taken, source)
        elif path.is_dir():
            files += image_files(path)
        elif path.is_file():
            files.append(path)
        else:
            raise UseError("OV321", f"no picture {source}", "there is no such file", "omnivert setup ring --help")
    for path in say.counted(spread(files, MOST_SHOTS), "reading", min(len(files), MOST_SHOTS)):
        if not _has_room(taken):
            taken.left_out.append(f"{path.name}: as many as there is room for are here")
            continue
        taken.take(path.name, partial(frame_from_path, path, 0))


def _replay(taken: Shots, name: str) -> None:
    """Frames of a recording."""
    from omnivert.cli.given import count
    from omnivert.wire.channels import FRAME

    source = opened(name)
    number = count(source, FRAME)
    if not number:
        raise DataError("OV101", f"there are no frames in {title(name)}", "the ring is seen in them")
    wanted = set(spread(range(number), MOST_SHOTS))
    for index, (_, frame) in enumerate(say.counted(source.messages(types=(Frame,)), "reading", number)):
        if index in wanted and isinstance(frame, Frame) and _has_room(taken):
            taken.take(f"{title(name)}, frame {index}", partial(_itself, frame))


def _shoot(taken: Shots, camera: Camera) -> None:
    """A few frames of the camera, apart from each other.

    raises  DataError when it gives none in time
    """
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what is wrong is said in one line
    say.story(f"looking through the camera {camera.source}; let the robot drive or turn: other places make it surer")
    lost = "it gives nothing"
    last_ns = -(2**62)
    with say.progress("looking", LIVE_SHOTS) as bar:
        for event in patient_events(camera, LIVE_PATIENCE_S):
            match event:
                case Frame() if event.stamp_ns - last_ns >= LIVE_EVERY_S * 1e9:
                    last_ns = event.stamp_ns
                    taken.take(f"shot {len(taken.pictures) + 1}", partial(_itself, event))
                    bar.step()
                case Lost(reason) | Refused(reason):
                    lost = reason
                case Finished():
                    break
            if len(taken.pictures) == LIVE_SHOTS:
                break
    if not taken.pictures:
        help = "stop omnivert up if it runs: a camera is open to one program; or give pictures: omnivert setup ring DIR"
        raise DataError("OV501", f"the camera {camera.source} gives no picture", lost, help)


def _itself(frame: Frame) -> Frame:
    return frame


def _has_room(taken: Shots) -> bool:
    pixels = sum(picture.size for picture in taken.pictures[:1]) * (len(taken.pictures) + 1)
    return len(taken.pictures) < MOST_SHOTS and pixels <= MOST_PIXELS


def spread(items: Sequence[T], most: int) -> list[T]:
    """At most so many of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return list(items)
    return [items[round(k * (len(items) - 1) / (most - 1))] for k in range(most)]
