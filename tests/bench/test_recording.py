"""The benchmark of recording measures what it says, on real processes and a real disk."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

from omnivert.bench import recording as module
from omnivert.bench.recording import _cpu_s, _errors_s, _memory_mb, _messages, recording_times
from omnivert.bench.spread import Spread
from omnivert.cli.app import run
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Frame


def test_a_short_drive_is_recorded_whole_and_played(tmp_path: Path) -> None:
    moved: list[None] = []
    times = recording_times(Config(), tmp_path, 1.5, 1.0, 1.0, lambda: moved.append(None))
    assert (times.frames, times.ticks) == (45, 150)
    assert 0 <= times.lost <= 20  # a machine that is far too busy may lose some on the way: to see that it is there
    assert times.file_bytes > 0.5 * times.frames * 640 * 480
    assert times.cpu_share == pytest.approx(times.cpu_s / 1.5)
    assert times.cpu_s > 0.0
    assert all(10.0 < megabytes < 1000.0 for megabytes in times.memory_mb)
    assert 110 <= times.pace.count <= 130  # thirty frames and a hundred ticks of the first second
    assert times.sleep.count == 100
    assert len(moved) >= 2
    assert list(tmp_path.iterdir()) == []


def test_the_drive_has_its_rates_and_comes_in_order() -> None:
    pictures = [np.zeros((480, 640), np.uint8)]
    messages = list(_messages(pictures, 2.0))
    stamps = [message.stamp_ns for message in messages]
    assert stamps == sorted(stamps)
    frames = [message.stamp_ns for message in messages if isinstance(message, Frame)]
    assert (len(frames), len(messages)) == (60, 260)
    assert frames[30] == 10**9


def test_an_error_of_pace_is_the_distance_from_what_the_stamps_say() -> None:
    """Whenever it began, and however late the first one was."""
    stamps = np.arange(5) * 10_000_000
    sent = 7_000_000_000 + stamps + np.array([5_000_000, 0, 0, -1_000_000, 0])
    assert _errors_s(sent, stamps) == pytest.approx([0.005, 0.0, 0.0, 0.001, 0.0])


def test_time_and_memory_are_those_of_the_process() -> None:
    before_s, cpu_s = time.process_time(), _cpu_s(os.getpid())
    while time.process_time() - before_s < 0.1:
        pass
    assert _cpu_s(os.getpid()) - cpu_s == pytest.approx(time.process_time() - before_s, abs=0.03)
    before_mb = _memory_mb(os.getpid())
    held = np.ones(50_000_000, np.uint8)
    assert _memory_mb(os.getpid()) - before_mb == pytest.approx(held.nbytes / 1e6, abs=10.0)


def test_memory_that_only_waits_for_the_disk_is_no_growth() -> None:
    samples = [50.0] * 100
    samples[15:18] = samples[95:98] = [300.0] * 3
    assert module._memory_of(samples) == (50.0, 50.0, 300.0)
    assert module._memory_of([50.0 + k for k in range(100)]) == (60.0, 140.0, 149.0)
    assert module._memory_of([7.0]) == (7.0, 7.0, 7.0)


def test_a_disk_without_room_is_refused_before_it_begins(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there is no room") as refused:
        recording_times(Config(), tmp_path, 1e9, 1.0, 1.0)
    assert refused.value.code == "OV322"
    assert list(tmp_path.iterdir()) == []


def test_the_command_prints_one_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spread = Spread(0.1, 0.2, 3)
    times = module.RecordingTimes(30, 100, 1.0, 0, 9, 0.1, 0.1, (50.0, 51.0, 60.0), 2.0, spread, spread)
    monkeypatch.setattr(module, "recording_times", lambda *given: times)
    assert run(["bench", "recording", "--folder", str(tmp_path), "--json"]) == 0
    body = json.loads(capsys.readouterr().out)
    assert (body["lost"], body["memory_mb"], body["pace"]["p99_ms"]) == (0, [50.0, 51.0, 60.0], 0.2)
    assert run(["bench", "recording", "--folder", str(tmp_path)]) == 0
    assert "recorder  10.0 % of a core live" in capsys.readouterr().out
    assert run(["bench", "recording", "--folder", str(tmp_path / "none")]) == 2
