"""`omnivert doctor REC`: what a person sees, what a script gets, what it refuses."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from omnivert.cli.app import run
from omnivert.cli.settings import opened
from omnivert.config import Config
from omnivert.messages import Ticks
from omnivert.wire.recording import RecordingWriter


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = run(["doctor", *map(str, arguments)])
    return (code, *capsys.readouterr())


def test_the_corridor_is_healthy_without_a_warning(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bundle = tmp_path / "doctor.zip"
    code, out, _ = told(capsys, "corridor", "--bundle", bundle)
    assert code == 0
    assert "✗" not in out
    assert "!" not in out
    assert "–" not in out  # all is checked
    assert "calibrated" in out
    assert max(map(len, out.splitlines())) <= 100
    assert out.endswith("Nothing stands in the way of a calibration.\n")
    with zipfile.ZipFile(bundle) as file:
        assert set(file.namelist()) == {"report.txt", "report.json", "config.json", "versions.json", "health.json"}
        assert file.read("report.txt").decode() == out
        assert json.loads(file.read("report.json"))["healthy"] is True
        Config.model_validate(json.loads(file.read("config.json")))


def test_a_recording_with_a_reversed_wheel(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The counts in a real file; the fault is named first, the fix beside it, and the exit code says so."""
    corridor, path = opened("corridor"), tmp_path / "left.mcap"
    with RecordingWriter(path, corridor.config(Config())) as writer:
        for key, message in corridor.messages(from_s=18.0, to_s=28.0):
            writer.write(key, replace(message, left=-message.left) if isinstance(message, Ticks) else message)
    code, out, _ = told(capsys, path)
    assert code == 1
    marked = [line for line in out.splitlines() if "✗" in line or "!" in line]
    assert marked == ["signs      ✗ the left wheel counts backwards"]
    assert "help: encoder.left_sign = -1" in out
    assert f"mail this: omnivert doctor {path} --bundle doctor.zip" in out
    body = as_json(capsys, path)
    assert (body["first"], body["healthy"], body["stops"]) == ("wheels", False, ["wheels"])
    only = as_json(capsys, path, "--only", "streams", "--only", "ring")
    assert [check["name"] for check in only["checks"]] == ["frames", "ticks", "clock", "ring"]
    assert only["healthy"]


def as_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    _, out, _ = told(capsys, *arguments, "--json")
    body = json.loads(out)
    assert isinstance(body, dict)
    return body


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("corridor", "--only", "sins"), "did you mean signs"),
        (("corridor", "--push"), "without a robot"),
        (("corridor", "--connect", "tcp/127.0.0.1:1"), "without a robot"),
        (("corridr",), "did you mean corridor"),
        (("--seconds", "0.1"), "0.5"),
    ],
)
def test_wrong_use_is_refused(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str) -> None:
    code, out, err = told(capsys, *arguments)
    assert (code, out) == (2, "")
    assert said in err


def test_a_bundle_overwrites_nothing_that_is_read(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text("[robot]\nwheel_base_m = 0.3\n")
    assert told(capsys, "--config", config, "--bundle", config)[0] == 2
    assert config.read_text() == "[robot]\nwheel_base_m = 0.3\n"
