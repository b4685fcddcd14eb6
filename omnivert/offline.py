"""A recording through the very steppers that the services run: the same bytes of result, without a process or a bus."""

from collections.abc import Iterator, Sequence

from omnivert.calibration.calibrator import Calibrator
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Message, Ticks
from omnivert.threads import one_thread
from omnivert.timeline import Timeline
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.channels import FRAME
from omnivert.wire.recording import Recording


def tracked(recording: Recording, config: Config) -> Iterator[Bearings]:
    """The lines of every frame in the recording, as the vision service would publish them."""
    one_thread()
    front_end = FrontEnd(config)
    for _, message in recording.messages(types=(Frame,)):
        if isinstance(message, Frame):
            yield front_end.step(message)


def calibrated(recording: Recording, config: Config) -> Iterator[Bearings | Estimate | Extrinsics]:
    """Lines and what the calibration makes of them, as the services would publish them.

    A recording of a bearing sensor carries Bearings instead of frames; they are taken as they are.
    """
    one_thread()
    front_end = FrontEnd(config)
    timeline = Timeline((Ticks, Bearings), config.timeline)
    calibrator = Calibrator(config)
    has_frames = FRAME.key(config) in recording.counts

    def results(ordered: Sequence[Message]) -> Iterator[Estimate | Extrinsics]:
        for message in ordered:
            if isinstance(message, Ticks | Bearings):
                yield from calibrator.step(message)

    for _, recorded in recording.messages(types=(Frame, Ticks) if has_frames else (Bearings, Ticks)):
        message = front_end.step(recorded) if isinstance(recorded, Frame) else recorded
        if isinstance(message, Bearings):
            yield message
        yield from results(timeline.push(message, replay=True))
    yield from results(timeline.drain())
    yield from calibrator.close()
