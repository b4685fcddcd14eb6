"""omnivert's vision over a recording, timed without decoding, and the frames left behind for its peers."""

import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import islice
from pathlib import Path

from omnivert.bench.contender import Contender
from omnivert.bench.score.truth import Sighting
from omnivert.bench.yardstick import sobel_pair_s
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd, Work
from omnivert.vision.image import Grey, grey_from_frame
from omnivert.wire.recording import Recording


def vision_run(
    recording: Recording, config: Config, frames: int, left: Path | None, moved: Callable[[], None] = lambda: None
) -> Contender:
    """The front end over the first frames of the recording, on one thread of OpenCV.

    left   folder for the frames and ring centres that the peers work on; None: no peers
    moved  called after each frame
    """
    front_end = FrontEnd(config)
    sobel: list[float] = []
    step: list[float] = []
    stages: dict[str, list[float]] = defaultdict(list)
    sightings: list[Sighting] = []
    shape = (config.camera.height_px, config.camera.width_px)
    with nullcontext() if left is None else (left / "pictures").open("wb") as pictures:
        for frame in decoded(recording, frames):
            if frame.format is PixelFormat.GREY8:
                sobel.append(sobel_pair_s(frame.data.reshape(frame.height_px, frame.width_px)))
            bearings, took = timed_step(front_end, frame, stages)
            step.append(took)
            sightings.append(Sighting.of(bearings))
            if pictures is not None:
                good = frame.format is PixelFormat.GREY8 and (frame.height_px, frame.width_px) == shape
                pictures.write(frame.data.tobytes() if good else bytes(shape[0] * shape[1]))
            moved()
    if left is not None:
        _leave_job(left, config, sightings)
    return Contender.of_seconds(sobel, step, stages, sightings)


def decoded(recording: Recording, frames: int) -> Iterator[Frame]:
    """The first frames as raw grey, so that nobody's time has the decoding in it; broken ones as they are."""
    messages = (message for _, message in recording.messages(types=(Frame,)) if isinstance(message, Frame))
    for frame in islice(messages, frames):
        try:
            grey = grey_from_frame(frame)
        except ValueError:
            yield frame
        else:
            yield raw(grey, frame.stamp_ns)


def raw(grey: Grey, stamp_ns: int) -> Frame:
    """A picture (height, width) as a frame that needs no decoding."""
    return Frame(stamp_ns, PixelFormat.GREY8, grey.shape[1], grey.shape[0], grey.ravel())


def timed_step(front_end: FrontEnd, frame: Frame, stages: dict[str, list[float]]) -> tuple[Bearings, float]:
    """The frame's bearings and the seconds that they took; the parts go to `stages`."""
    clock = time.perf_counter
    work = Work(frame)
    total = 0.0
    for stage in front_end.stages:
        began = clock()
        stage.run(work)
        took = clock() - began
        stages[stage.name].append(took)
        total += took
    began = clock()
    bearings = front_end.bearings(work)
    return bearings, total + clock() - began


def _leave_job(folder: Path, config: Config, sightings: list[Sighting]) -> None:
    """The form that omnivert/bench/peers/run.py reads."""
    job = {
        "width_px": config.camera.width_px,
        "height_px": config.camera.height_px,
        "centers_px": [sighting.center_px for sighting in sightings],
        "r_min_px": config.ring.r_min_px,
        "r_max_px": config.ring.r_max_px,
        "bearing_sign": config.camera.bearing_sign,
    }
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
