"""A bearing sensor from its folder to the result: import, calibrate, and what has no image to work on."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from omnivert.config import Config, with_rig
from omnivert.formats.meta import METRE_WHEEL
from omnivert.simulation.recording import Drive, Scene, recorded
from tests.processes import own

OMNIVERT = (sys.executable, "-c", "from omnivert.cli import main; main()")


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory, write_bearings: Callable[[Path, Drive, Config], None]) -> Path:
    """A drive of three straights and turns past lasting lines, with a truth that says more than is needed."""
    rig = with_rig(Config(), {"encoder": METRE_WHEEL}, "test")
    scene = Scene(mount=(-0.34, 0.23, 0.33), lasting=True, visible=6.0, lines=8, outliers=0.0)
    drive = recorded(scene, rig, 11)
    there = tmp_path_factory.mktemp("sensor") / "drive"
    write_bearings(there, drive, rig)
    (there / "truth").mkdir()
    truth = {"phi_rad": -0.34, "rho_m": 0.23, "psi_rad": 0.33, "camera_yaw_rad": -0.01, "accuracy": "exact"}
    (there / "truth" / "extrinsics.json").write_text(json.dumps(truth))
    return there


@pytest.fixture
def sensor(omnivert: Any, folder: Path, tmp_path: Path) -> Path:
    assert omnivert("import", "bearings", folder, "-o", tmp_path / "sensor.mcap").code == 0
    return tmp_path / "sensor.mcap"


def test_an_import_says_what_it_wrote_and_what_to_type_next(omnivert: Any, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    ran = omnivert("import", "bearings", folder, "-o", out)
    assert re.search(r"out\.mcap  0\.1 MB · \d+ bearings · \d+ ticks$", ran.out.strip())
    assert ran.err.splitlines() == [f"next    omnivert calibrate {out}"]
    assert (omnivert("import", "bearings", folder, "-o", out).code, out.is_file()) == (2, True)  # never overwritten
    told = omnivert("import", "bearings", folder, "-o", tmp_path / "other.mcap", "--json").json
    assert (set(told["messages"]), told["notes"]) == ({"Bearings", "Ticks"}, [])


def test_wheels_that_will_not_be_believed_are_noted(omnivert: Any, folder: Path, tmp_path: Path) -> None:
    slow = tmp_path / "slow"
    slow.mkdir()
    for name in ("meta.json", "bearings.csv"):
        (slow / name).write_bytes((folder / name).read_bytes())
    header, *rows = (folder / "wheels.csv").read_text().splitlines()
    (slow / "wheels.csv").write_text("\n".join([header, *rows[::40]]))
    told = omnivert("import", "bearings", slow, "-o", tmp_path / "out.mcap").err
    note = " ".join(told.partition("note ")[2].partition("next ")[0].split())
    assert note.startswith("wheels.csv: silent while the wheels turned")
    assert "encoder.max_gap_s = 0.5" in note


def test_a_fault_is_refused_and_leaves_nothing(omnivert: Any, tmp_path: Path) -> None:
    ran = omnivert("import", "bearings", tmp_path / "none", "-o", tmp_path / "out.mcap")
    assert (ran.code, ran.out, "error[OV310]" in ran.err) == (1, "", True)
    assert list(tmp_path.iterdir()) == []


def test_a_bearing_sensor_is_calibrated_with_its_truth_beside_it(omnivert: Any, sensor: Path, tmp_path: Path) -> None:
    ran = omnivert("calibrate", sensor, "--json", "--picture", tmp_path / "result.png")
    result = ran.json
    assert (result["given"]["images"], result["given"]["missing"]) == (False, None)
    assert result["frames"] == result["given"]["frames"]
    assert result["truth"] == {"phi_rad": -0.34, "rho_m": 0.23, "psi_rad": 0.33}
    assert all(sigmas < 4.0 for sigmas in result["off_in_sigmas"].values())
    given, *_ = ran.err.splitlines()
    assert re.match(r"given   sensor\.mcap  \d+\.\d s · \d+ bearings frames \(3\.0 Hz, longest gap \d+ ms\)", given)
    assert (tmp_path / "result.png").read_bytes()[:4] == b"\x89PNG"


def test_what_the_recording_holds_is_called_bearings(omnivert: Any, sensor: Path) -> None:
    assert " bearings frames (3.0 Hz" in omnivert("play", sensor, "--info").out


def test_bearings_are_not_tracked_again(omnivert: Any, sensor: Path) -> None:
    ran = omnivert("track", sensor)
    assert (ran.code, ran.out) == (1, "")
    assert "error[OV101]: there are no frames in sensor.mcap" in ran.err
    assert f"help     omnivert calibrate {sensor}" in ran.err


@pytest.mark.parametrize("command", ["calibrate", "track"])
def test_a_folder_in_place_of_a_recording_leads_to_its_own_import(omnivert: Any, folder: Path, command: str) -> None:
    ran = omnivert(command, folder)
    assert (ran.code, f"omnivert import bearings {folder} -o" in ran.err) == (2, True)


def test_up_plays_bearings_with_the_wheels_that_they_came_with(sensor: Path, tmp_path: Path) -> None:
    robot, store = tmp_path / "robot.toml", tmp_path / "extrinsics.db"
    robot.write_text(
        f'[robot]\nid = "r7"\nwheel_base_m = 0.5\n[bus]\nendpoint = "unixsock-stream/{tmp_path}/bus.sock"\n'
        f'[storage]\npath = "{store}"\n'
    )
    command = [*OMNIVERT, "up", "--config", str(robot), "--play", str(sensor), "--speed", "0"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with own(
        subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    ) as up:
        assert up.stderr is not None
        told = []
        for line in up.stderr:
            told.append(line)
            if "the playback has ended" in line:
                break
        up.send_signal(signal.SIGINT)
        told += up.stderr.readlines()
        assert up.wait(30) == 0, told
    text = "".join(told)
    assert "not used of the configuration: robot.wheel_base_m;" in text
    assert "robot r7" in text
    assert re.search(r"player: played \d+ messages, \d+ frames of them, .* 0 lost", text), text
    assert re.search(rf"stopped; stored #.* in {store}", text), text
