"""The latency of ticks is measured through a real bridge, and with a camera that really runs."""

import json
from pathlib import Path

import pytest

from omnivert.bench.ticks import WARM_UP
from omnivert.cli.app import run
from omnivert.config import Config
from omnivert.messages import Ticks
from omnivert.wire.channels import TICKS
from omnivert.wire.recording import RecordingWriter


def test_ticks_are_timed_alone_and_beside_a_camera(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "ticks", "--lines", "150", "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["recording"] == "corridor"
    for name in ("alone", "with_camera"):
        assert 0 < body[name]["count"] <= 150 - WARM_UP
        assert 0.05 < body[name]["median_ms"] <= body[name]["p99_ms"]
    assert body["longest_ms"] >= body["with_camera"]["p99_ms"] - 1e-6
    assert body["lost"] == 0
    assert body["frames"] >= 20  # at 30 Hz in 1.5 s, and what came before


def test_a_recording_without_frames_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "ticks.mcap"
    with RecordingWriter(path, Config()) as writer:
        writer.write(TICKS.key(Config()), Ticks(1, 0, 0))
    assert run(["bench", "ticks", str(path)]) == 1
    assert "there are no frames" in capsys.readouterr().err
