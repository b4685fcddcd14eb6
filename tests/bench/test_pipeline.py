"""The benchmark measures what it says: every stage, the whole, and latency beside raw zenoh."""

import json
from pathlib import Path

import pytest

from omnivert.bench.latency import latency
from omnivert.bench.pipeline import pipeline_times
from omnivert.bench.spread import Spread
from omnivert.calibration.ekf import Filter
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


def test_every_stage_is_timed_and_the_stages_make_up_the_step(short: Path) -> None:
    recording = Recording(short)
    config = recording.config(Config())
    times = pipeline_times(recording, config)
    assert list(times.stages) == [stage.name for stage in FrontEnd(config).stages]
    assert all(spread.median_ms > 0 for spread in (*times.stages.values(), times.sobel_pair, times.vision))
    assert sum(spread.median_ms for spread in times.stages.values()) < 3.0 * times.vision.median_ms


def test_measuring_leaves_the_filter_as_it_was(short: Path) -> None:
    before = Filter.predict, Filter.update
    pipeline_times(Recording(short), Config())
    assert (Filter.predict, Filter.update) == before


def test_latency_over_the_bus_is_at_least_a_raw_round(short: Path) -> None:
    recording = Recording(short)
    measured = latency(recording, recording.config(Config()), 8)
    assert measured.frame_to_bearings.count == 5
    assert measured.raw_round.count == 5
    assert 0 < measured.raw_round.median_ms < measured.frame_to_bearings.median_ms
    assert measured.frame_bytes > 10_000


def test_the_command_prints_one_object(short: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "pipeline", str(short), "--no-bus", "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["vision_step"]["sobel_pairs"] > 0
    assert set(body["stages"]) >= {"edges", "ring", "lines", "descriptors", "tracking"}
