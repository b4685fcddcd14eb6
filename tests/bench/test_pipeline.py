"""The benchmark measures what it says: every stage, the whole, and latency beside raw zenoh."""

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from omnivert.bench import pipeline
from omnivert.bench.latency import latency
from omnivert.bench.pipeline import pipeline_times
from omnivert.bench.spread import Spread
from omnivert.calibration.kalman.ekf import Filter
from omnivert.cli.app import run
from omnivert.cli.settings import recording_path
from omnivert.config import Config
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.recording import Recording, RecordingWriter


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 5 s of the packaged drive."""
    path = tmp_path_factory.mktemp("bench") / "short.mcap"
    corridor = Recording(recording_path("corridor"))
    with RecordingWriter(path, corridor.config(Config())) as writer:
        for key, message in corridor.messages(to_s=5.0):
            writer.write(key, message)
    return path


def test_a_spread_is_median_and_99th_percentile_in_ms() -> None:
    spread = Spread.of_seconds([k * 1e-3 for k in range(101)])
    assert (spread.median_ms, spread.p99_ms, spread.count) == pytest.approx((50.0, 99.0, 101))
    assert spread.json(Spread(10.0, 1.0, 1))["sobel_pairs"] == pytest.approx(5.0)
    with pytest.raises(ValueError, match="nothing"):
        Spread.of_seconds([])


def test_every_stage_is_timed(short: Path) -> None:
    recording = Recording(short)
    config = recording.config(Config())
    times = pipeline_times(recording, config)
    assert list(times.stages) == [stage.name for stage in FrontEnd(config).stages]
    assert all(spread.median_ms > 0 for spread in (*times.stages.values(), times.sobel_pair, times.vision))


def test_the_stages_make_up_the_step(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a clock that goes on by a millisecond whenever it is looked at."""
    looks = itertools.count()
    clock = SimpleNamespace(perf_counter=lambda: 1e-3 * next(looks))
    monkeypatch.setattr(pipeline, "time", clock)
    recording = Recording(short)
    times = pipeline_times(recording, recording.config(Config()))
    spent = [spread.median_ms for spread in times.stages.values()]
    assert spent == pytest.approx([1.0] * len(spent))
    between = len(spent) + 1  # from the step's beginning to the first stage, from stage to stage, to the step's end
    assert times.vision.median_ms == pytest.approx(sum(spent) + between)


def test_measuring_leaves_the_filter_as_it_was(short: Path) -> None:
    before = Filter.predict, Filter.update
    pipeline_times(Recording(short), Config())
    assert (Filter.predict, Filter.update) == before


def test_latency_over_the_bus_is_measured_beside_as_many_raw_rounds(short: Path) -> None:
    recording = Recording(short)
    measured = latency(recording, recording.config(Config()), 8)
    assert measured.frame_to_bearings.count == 5
    assert measured.raw_round.count == 5
    assert min(measured.raw_round.median_ms, measured.frame_to_bearings.median_ms) > 0
    assert measured.frame_bytes > 10_000


def test_the_command_prints_one_object(short: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "pipeline", str(short), "--no-bus", "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["vision_step"]["sobel_pairs"] > 0
    assert set(body["stages"]) >= {"edges", "ring", "lines", "descriptors", "tracking"}
