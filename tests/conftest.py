"""What all tests share."""

import fcntl
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from omnivert.calibration import warm_up as calibration
from omnivert.config import Config
from omnivert.messages import Ticks
from omnivert.simulation.recording import Drive
from omnivert.threads import one_thread
from omnivert.vision import warm_up as vision

PROJECT = Path(__file__).resolve().parents[1]

settings.register_profile("untimed", deadline=None)  # a busy machine is no wrong result; benchmarks measure time
settings.load_profile("untimed")


@pytest.fixture(scope="session", autouse=True)
def _one_thread_each() -> None:
    """As in the services; two test processes whose libraries each take all cores would wait for each other."""
    one_thread()


@pytest.fixture(scope="session", autouse=True)
def _compiled_once(worker_id: str, tmp_path_factory: pytest.TempPathFactory, _one_thread_each: None) -> None:
    """On a new machine each kernel is compiled by one of the test processes, while the others compile other ones."""
    kernels = {"vision": vision.warm_up, "calibration": calibration.warm_up}
    if worker_id == "master" or any((PROJECT / "omnivert" / "vision").glob("__pycache__/*.nbi")):
        return
    for name in sorted(kernels, reverse=worker_id.endswith(("0", "2", "4", "6", "8"))):
        with (tmp_path_factory.getbasetemp().parent / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            kernels[name](Config())


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings and photographs that stand beside the project; a test that needs them is skipped without them."""
    folder = PROJECT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs ../shared/data, which is not here")
    return folder


@pytest.fixture(scope="session")
def strong_edges_deg() -> tuple[float, ...]:
    """Bearings of windows and shelf in the first photograph of real/vmr, measured by eye."""
    return 35.6, 43.7, 60.4, 92.2, 101.3


@pytest.fixture(scope="session")
def write_bearings() -> Callable[[Path, Drive, Config], None]:
    """Writes a drive into a new folder, as the logger of a bearing sensor would have written it."""

    def write(folder: Path, drive: Drive, config: Config) -> None:
        folder.mkdir()
        meta = {"robot": {"wheel_base_m": config.robot.wheel_base_m}, "bearing_std_rad": 0.003}
        (folder / "meta.json").write_text(json.dumps(meta))
        scale = config.encoder.metres_per_tick
        wheels, bearings = ["t_s,left_m,right_m"], ["t_s,track_id,bearing_rad"]
        for message in drive.messages:
            at = f"{message.stamp_ns / 1e9:.9f}"
            if isinstance(message, Ticks):
                wheels.append(f"{at},{message.left * scale:.7f},{message.right * scale:.7f}")
            else:
                pairs = zip(message.track_id.tolist(), message.bearing_rad.tolist(), strict=True)
                bearings += [f"{at},{track},{beta!r}" for track, beta in pairs]
        (folder / "wheels.csv").write_text("\n".join(wheels))
        (folder / "bearings.csv").write_text("\n".join(bearings))

    return write
