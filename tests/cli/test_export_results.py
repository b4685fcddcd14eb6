"""Recordings for Foxglove and ROS: recorded results are taken as they are, and where there are none they are made."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from omnivert.cli.recordings.export_results import foxglove, rosbag
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.rosbag.file import Bag
from omnivert.messages import Bearings, Estimate, Mount, ParameterVerdict, State, Ticks
from omnivert.wire.channels import BEARINGS, ESTIMATE, TICKS
from omnivert.wire.recording import RecordingWriter

ORIGIN_NS = 1_700_000_000 * 10**9


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A drive with results in it, from a bag whose clock counts from 1970."""
    config, word = Config(), ParameterVerdict(State.USABLE)
    mount = Mount(-0.34, 0.23, 0.33, 1e-4 * np.eye(3))
    with RecordingWriter(tmp_path / "drive.mcap", config) as writer:
        for k in range(1, 4):
            at = k * 10**9
            kinds = (np.int64, np.float64, np.float64, np.int32, np.float32)
            writer.write(TICKS.key(config), Ticks(at, k, k))
            writer.write(BEARINGS.key(config), Bearings(at, *(np.zeros(0, kind) for kind in kinds)))  # type: ignore[arg-type]
            writer.write(
                ESTIMATE.key(config), Estimate(at, k, mount, word.state, word, word, word, "", 1.0, 1.0, 1, 1, 1)
            )
        writer.attach("rosbag.json", json.dumps({"clock_origin_ns": ORIGIN_NS}).encode())
        writer.attach("meta.json", json.dumps({"laser": {"x": 0.1, "y": 0.0, "yaw": 0.0}}).encode())
    return tmp_path / "drive.mcap"


def topics(path: Path) -> dict[str, int]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {channel.topic: counts[number] for number, channel in summary.channels.items()}


def test_a_file_for_foxglove_holds_what_was_recorded(recording: Path, tmp_path: Path, capsys: Any) -> None:
    foxglove(str(recording), tmp_path / "out.mcap")
    assert topics(tmp_path / "out.mcap") == {
        "/encoder/base/ticks": 3,
        "/tf": 4,  # the laser once, the camera at each usable estimate
        "/vision/front/bearings": 3,
        "/vision/front/lines": 3,
        "/calibration/front/estimate": 3,
    }
    said = capsys.readouterr()
    assert said.out.startswith(f"{tmp_path / 'out.mcap'}  0.0 MB · 3 ticks · 3 bearings · 3 estimates")
    assert f"import {tmp_path / 'out.layout.json'} as a layout" in said.err


def test_a_bag_has_the_times_of_the_bag_that_the_drive_came_from(recording: Path, tmp_path: Path, capsys: Any) -> None:
    rosbag(str(recording), tmp_path / "out.bag", as_json=True)
    said = json.loads(capsys.readouterr().out)
    assert said["messages"] == {"/omnivert/front/mount": 3, "/tf": 3}
    bag = Bag(tmp_path / "out.bag")
    stamps = [received.header_ns for received in bag.messages(bag.topics["/omnivert/front/mount"])]
    assert stamps == [ORIGIN_NS + k * 10**9 for k in range(1, 4)]


def test_the_command_takes_one_place_to_write_to(omnivert: Any, recording: Path, tmp_path: Path) -> None:
    told = omnivert("rec", "export", recording, "--foxglove", tmp_path / "out.mcap", "--json").json
    assert (told["file"], told["messages"]["Estimate"]) == (str(tmp_path / "out.mcap"), 3)
    told = omnivert("rec", "export", recording, "--rosbag", tmp_path / "result", "--json").json
    assert told == {"bag": str(tmp_path / "result"), "messages": {"/omnivert/front/mount": 3, "/tf": 3}}
    again = omnivert("rec", "export", recording, "--rosbag", tmp_path / "result")
    assert (again.code, "exists already" in again.err) == (2, True)
    for wrong in ((), ("--rosbag", tmp_path / "a", "--foxglove", tmp_path / "b")):
        refused = omnivert("rec", "export", recording, *wrong)
        assert (refused.code, "where to?" in refused.err) == (2, True)


def test_results_that_were_not_recorded_are_made(straight: Path, tmp_path: Path) -> None:
    foxglove(str(straight), tmp_path / "out.mcap")
    found = topics(tmp_path / "out.mcap")
    assert found["/vision/front/lines"] == found["/camera/front/image"] > 20
    frames = found["/camera/front/image"]
    assert found["/calibration/front/estimate"] == frames + 1  # the last one once more, at the end


def test_without_the_library_the_refusal_says_how_to_get_it(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package, extra, export in (("foxglove", "foxglove", foxglove), ("rosbags", "ros", rosbag)):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(DataError, match="is not installed") as refusal:
            export(str(recording), tmp_path / "out")
        assert (refusal.value.code, refusal.value.help) == ("OV330", f"pip install 'omnivert[{extra}]'")
