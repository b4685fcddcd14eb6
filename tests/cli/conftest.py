"""Command lines run in this process, and small recordings to run them on."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnivert.cli.app import run
from omnivert.cli.settings import recording_path
from omnivert.config import Config
from omnivert.messages import Extrinsics, Message, Mount, State, Ticks
from omnivert.store import Store
from omnivert.wire.recording import Recording, RecordingWriter


@dataclass(frozen=True, slots=True)
class Ran:
    """What a command line did."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        lines = self.out.splitlines()
        assert len(lines) == 1, self.out
        body = json.loads(lines[0])
        assert isinstance(body, dict)
        return body


Omnivert = Callable[..., Ran]


@pytest.fixture
def omnivert(capsys: pytest.CaptureFixture[str]) -> Omnivert:
    """The command in this process."""

    def called(*arguments: object) -> Ran:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        return Ran(code, *capsys.readouterr())

    return called


class Marked:
    """Processes that can be found again by a mark in their environment."""

    def __init__(self, mark: Path) -> None:
        self._mark = f"OMNIVERT_TEST_MARK={mark}"
        self.environment = {**os.environ, "OMNIVERT_TEST_MARK": str(mark), "PYTHONUNBUFFERED": "1"}

    def processes(self) -> list[Path]:
        """Those that run."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                marked = f"{self._mark}\0".encode() in (process / "environ").read_bytes()
            except OSError:
                continue
            found += [process] if marked else []
        return found


@pytest.fixture
def marked(tmp_path: Path) -> Marked:
    return Marked(tmp_path)


TRUTH = ("truth/lines.csv", "truth/nonstatic_lines.csv", "truth/centers.csv")


def part_of_corridor(
    path: Path,
    seconds: float,
    *leave_out: type[Message],
    from_s: float | None = None,
    truth: Mapping[str, bytes] | None = None,
) -> Path:
    """The first seconds of the packaged drive, straight ahead, or others of it: from 22.5 to 42 s it turns."""
    corridor = Recording(recording_path("corridor"))
    with RecordingWriter(path, corridor.config(Config())) as writer:
        for key, message in corridor.messages(from_s=from_s, to_s=seconds):
            if not isinstance(message, leave_out):
                writer.write(key, message)
        for name, data in (truth or {}).items():
            writer.attach(name, data)
    return path


@pytest.fixture(scope="session")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 8 s straight ahead."""
    return part_of_corridor(tmp_path_factory.mktemp("rec") / "straight.mcap", 8.0)


@pytest.fixture(scope="session")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6 s of turning on the spot."""
    return part_of_corridor(tmp_path_factory.mktemp("rec") / "turning.mcap", 28.5, from_s=22.5)


@pytest.fixture(scope="session")
def without_ticks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return part_of_corridor(tmp_path_factory.mktemp("rec") / "no-ticks.mcap", 1.0, Ticks)


@pytest.fixture(scope="session")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive of 8 s straight ahead with the truth of its lines."""
    corridor = Recording(recording_path("corridor"))
    path = tmp_path_factory.mktemp("rec") / "scored.mcap"
    return part_of_corridor(path, 8.0, truth={name: corridor.attachment(name) for name in TRUTH})


@pytest.fixture(scope="session")
def damaged_truth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return part_of_corridor(tmp_path_factory.mktemp("rec") / "damaged.mcap", 1.0, truth={TRUTH[0]: b"no table"})


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with two entries for demo/front and one for arm/wrist."""
    path = tmp_path / "extrinsics.db"
    with Store(path) as opened:
        opened.put(extrinsics("demo", "front", 1, 0.5))
        opened.put(extrinsics("arm", "wrist", 2, 1.0))
        opened.put(extrinsics("demo", "front", 3, 0.6))
    return path


def extrinsics(robot: str, camera: str, stamp_ns: int, phi: float) -> Extrinsics:
    covariance = np.diag([0.01**2, 0.002**2, 0.01**2])
    covariance[0, 2] = covariance[2, 0] = -0.95 * 0.01**2
    mount = Mount(phi, 0.25, -0.2, covariance)
    return Extrinsics(stamp_ns, robot, camera, mount, State.CALIBRATED, 120, (), "omnivert 0.1.0", "0123456789abcdef")
