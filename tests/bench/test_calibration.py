"""The calibration's benchmark: points, growth, chart and one JSON object."""

import json
from pathlib import Path

import numpy as np
import pytest

from omnivert.bench import calibration
from omnivert.bench.calibration import CalibrationTimes, FilterPoint, StartPoint, calibration_times, exponent
from omnivert.bench.spread import Spread
from omnivert.cli.app import run
from omnivert.cli.bench.app import _tell_calibration
from omnivert.config import Config


def test_the_exponent_is_that_of_a_power() -> None:
    size = np.array([10.0, 20.0, 50.0])
    assert exponent(size.tolist(), (3e-3 * size**2.5).tolist()) == pytest.approx(2.5)
    assert exponent([10.0], [1.0]) == 0.0


def test_more_lines_take_more_time_and_every_point_is_told() -> None:
    seen: list[int] = []
    times = calibration_times(Config(), (10, 60), (15.0,), 20, lambda: seen.append(1))
    assert len(seen) == 3
    assert [p.lines for p in times.filter] == [10, 60]
    assert times.filter[1].step.median_ms > times.filter[0].step.median_ms > 0.0
    assert times.filter[0].step.count == 20
    assert times.filter_exponent > 0.0
    assert times.start[0].seconds > 0.0
    assert 40 <= times.start[0].frames <= 46  # three a second


def test_the_command_prints_one_object_and_draws_a_chart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    full = calibration.calibration_times

    def small(config: Config, moved: object = None) -> calibration.CalibrationTimes:
        return full(config, (10, 20), (15.0, 20.0), 10)

    monkeypatch.setattr(calibration, "calibration_times", small)
    assert run(["bench", "calibration", "--json", "--plots", str(tmp_path / "charts")]) == 0
    body = json.loads(capsys.readouterr().out)
    assert [p["lines"] for p in body["filter"]] == [10, 20]
    assert body["filter"][0]["step"]["sobel_pairs"] > 0.0
    assert body["start"][0]["drive_s"] == 15.0
    assert (tmp_path / "charts" / "calibration-growth.png").read_bytes()[:4] == b"\x89PNG"


def test_the_growth_is_said_with_what_it_is_of(capsys: pytest.CaptureFixture[str]) -> None:
    def spread(ms: float) -> Spread:
        return Spread(ms, 2.0 * ms, 9)

    filters = tuple(FilterPoint(lines, spread(1e-3 * lines**1.5), spread(0.1)) for lines in (10, 100, 400))
    starts = tuple(StartPoint(seconds, 45, 0.01 * seconds, True) for seconds in (15.0, 120.0))
    _tell_calibration(CalibrationTimes(spread(0.2), filters, starts))
    told = capsys.readouterr().out
    assert "from 100 to 400 lines the time grows as lines^1.5" in told
    assert "from 15 to 120 s of driving the time grows as length^1.0" in told
    assert "a Sobel pair, two filters over the whole frame, takes 0.20 ms here" in told
