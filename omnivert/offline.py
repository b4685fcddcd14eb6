"""A recording through the very steppers that the services run: the same bytes of result, without a process or a bus."""

from collections.abc import Iterator, Sequence

from omnivert.calibration.calibrator import Calibrator
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Message, Ticks
from omnivert.threads import one_thread
from omnivert.timeline import LoneStream, Timeline
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.channels import FRAME
from omnivert.wire.recording import Recording


def tracked(recording: Recording, config: Config) -> Iterator[Bearings]:
    """The lines of every frame in the recording, as the vision service would publish them."""
    return (bearings for _, bearings in seen(recording, config))


def seen(recording: Recording, config: Config) -> Iterator[tuple[Frame, Bearings]]:
    """Each frame with its lines; without those whose stamps the vision service would refuse."""
    one_thread()
    front_end, frames = FrontEnd(config), LoneStream(Frame, config.timeline)
    for _, message in recording.messages(types=(Frame,)):
        for frame in frames.push(message):
            if isinstance(frame, Frame):
                yield frame, front_end.step(frame)


def calibrated(recording: Recording, config: Config) -> Iterator[Bearings | Estimate | Extrinsics]:
    """Lines and what the calibration makes of them, as the services would publish them.

    A recording of a bearing sensor carries Bearings instead of frames; they are taken as they are.
    """
    one_thread()
    front_end, frames = FrontEnd(config), LoneStream(Frame, config.timeline)
    timeline = Timeline((Ticks, Bearings), config.timeline)
    calibrator = Calibrator(config)
    has_frames = FRAME.key(config) in recording.counts

    def results(ordered: Sequence[Message]) -> Iterator[Estimate | Extrinsics]:
        for message in ordered:
            if isinstance(message, Ticks | Bearings):
                yield from calibrator.step(message)

    for _, recorded in recording.messages(types=(Frame, Ticks) if has_frames else (Bearings, Ticks)):
        for believed in frames.push(recorded) if isinstance(recorded, Frame) else (recorded,):
            message = front_end.step(believed) if isinstance(believed, Frame) else believed
            if isinstance(message, Bearings):
                yield message
            yield from results(timeline.push(message, replay=True))
    yield from results(timeline.drain())
    yield from calibrator.close()
