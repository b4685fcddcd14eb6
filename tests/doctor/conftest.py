"""The corridor as the vision sees it, once; faults are put into what it and the wheels tell."""

from dataclasses import dataclass, replace

import pytest

from omnivert.cli.settings import opened
from omnivert.config import Config, parsed
from omnivert.doctor.evidence import Evidence, Seen
from omnivert.doctor.host import this_host
from omnivert.doctor.stream import Stream
from omnivert.messages import Bearings, Frame, Ticks
from omnivert.offline import seen


@dataclass(frozen=True, slots=True)
class Told:
    """What a recording holds, and the vision's lines."""

    config: Config
    frames: tuple[Frame, ...]
    ticks: tuple[Ticks, ...]
    bearings: tuple[Bearings, ...]

    def set(self, table: str, **values: object) -> "Told":
        """With other settings."""
        given = self.config.model_dump(mode="json")
        given[table] = {**given[table], **values}
        return replace(self, config=parsed(given, "the test"))

    @property
    def evidence(self) -> Evidence:
        """As of a recording; the calibration is not asked."""
        frames = Stream.recorded([frame.stamp_ns for frame in self.frames])
        ticks = Stream.recorded([tick.stamp_ns for tick in self.ticks])
        looked = Seen.of(self.config, frames, (ticks, list(self.ticks)), list(self.bearings))
        return Evidence(self.config, "a drive", True, True, this_host(), looked)


@pytest.fixture(scope="session")
def corridor() -> Told:
    recording = opened("corridor")
    config = recording.config(Config())
    pairs = list(seen(recording, config))
    ticks = tuple(message for _, message in recording.messages(types=(Ticks,)) if isinstance(message, Ticks))
    return Told(config, tuple(frame for frame, _ in pairs), ticks, tuple(lines for _, lines in pairs))
