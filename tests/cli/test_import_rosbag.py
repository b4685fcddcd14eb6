"""`omnivert import rosbag`, as a person meets it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnivert.cli.robot.show_config import annotated
from omnivert.messages import Ticks
from omnivert.wire.recording import Recording
from tests.formats.bags import ORIGIN_NS, RIG, BagMaker, small_drive

DRIVE = small_drive()


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    with BagMaker(tmp_path / "drive", "mcap") as maker:
        maker.drive(DRIVE)
    return maker.path


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(annotated(RIG))
    return path


def test_it_says_what_it_took_and_what_to_type_next(omnivert: Any, bag: Path, config: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    ran = omnivert("import", "rosbag", bag, "-o", out, "--config", config)
    assert ran.code == 0
    assert ran.out.strip().endswith("MB · 20 frames · 101 ticks · 8 scans")
    *notes, last = ran.err.splitlines()
    assert last == f"next    omnivert calibrate {out}"
    assert notes[0] == "note    images are taken from /camera/image_raw (sensor_msgs/CompressedImage, 20 messages)"
    assert not any("--config" in note for note in notes)
    assert max(map(len, notes)) <= 100
    assert Recording(out).rig["robot"] == {"id": "r7", "wheel_base_m": 0.5}


def test_without_a_configuration_it_says_whose_rig_this_is(omnivert: Any, tmp_path: Path) -> None:
    with BagMaker(tmp_path / "plain", "mcap") as maker:
        maker.pixels("/image", ORIGIN_NS, ORIGIN_NS, 640, 480, "mono8", 640, np.zeros(640 * 480, np.uint8))
        maker.counts("/wheels", Ticks(0, 1, 2), ORIGIN_NS)
    ran = omnivert("import", "rosbag", maker.path, "-o", tmp_path / "out.mcap")
    assert "--config robot.toml" in ran.err
    assert max(map(len, ran.err.splitlines()[:-1])) <= 100  # the last line is a command, and stays whole
    notes = omnivert("import", "rosbag", maker.path, "-o", tmp_path / "more.mcap", "--json").json["notes"]
    assert any("those of the defaults" in note and "--config robot.toml" in note for note in notes)


def test_two_of_a_kind_are_refused_and_one_of_them_can_be_named(omnivert: Any, config: Path, tmp_path: Path) -> None:
    with BagMaker(tmp_path / "two", "mcap") as maker:
        maker.drive(DRIVE)
        maker.pixels("/rear/image", ORIGIN_NS, ORIGIN_NS, 64, 48, "mono8", 64, np.zeros(64 * 48, np.uint8))
    command = ("import", "rosbag", maker.path, "-o", tmp_path / "out.mcap", "--config", config)
    refused = omnivert(*command)
    assert (refused.code, refused.out) == (1, "")
    assert "error[OV332]: there are 2 image topics" in refused.err
    assert "help     --image-topic /camera/image_raw" in refused.err
    assert not (tmp_path / "out.mcap").exists()
    assert omnivert(*command, "--image-topic", "/camera/image_raw").code == 0


def test_without_the_library_one_line_says_how_to_get_it(bag: Path, tmp_path: Path) -> None:
    script = "import sys; sys.modules['rosbags'] = None; from omnivert.cli import main; main()"
    command = [sys.executable, "-c", script, "import", "rosbag", str(bag), "-o", str(tmp_path / "out.mcap")]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert ran.stderr.splitlines() == [
        "error[OV330]: reading a bag needs rosbags",
        "  because  the library rosbags is not installed",
        "  help     pip install 'omnivert[ros]'",
    ]


def test_whoever_would_calibrate_a_bag_is_told_to_import_it(omnivert: Any, bag: Path) -> None:
    refused = omnivert("calibrate", bag)
    assert refused.code == 2
    assert f"help     omnivert import rosbag {bag} -o drive.mcap" in refused.err
