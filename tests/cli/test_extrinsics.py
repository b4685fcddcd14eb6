"""The store's contents in every form say the same pose."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from omnivert.config import load
from omnivert.messages import State
from omnivert.store import Store

from .conftest import extrinsics


def pose() -> tuple[float, float, float]:
    """x, y, yaw of phi 0.6, rho 0.25, psi -0.2, by complex numbers."""
    place = 0.25 * complex(math.cos(0.6), math.sin(0.6))
    return place.real, place.imag, 0.4


def test_the_list_shows_the_latest_of_each_camera(omnivert: Any, store: Path) -> None:
    ran = omnivert("extrinsics", "list", "--store", store)
    assert ran.code == 0
    rows = ran.out.splitlines()
    assert len(rows) == 5
    assert (rows[1], rows[3]) == ("robot arm, camera wrist", "robot demo, camera front")
    assert [row.split()[0] for row in rows[2::2]] == ["#2", "#3"]
    assert "phi, deg" in rows[0]
    assert "34.38 ± 0.57" in rows[4]


def test_a_table_of_long_names_and_sharp_results_fits_a_terminal(omnivert: Any, tmp_path: Path) -> None:
    with Store(tmp_path / "x.db") as store:
        for number in range(30):
            sharp = extrinsics("robot-number-" + "9" * 19, "camera-" + "8" * 25, number, -2.5)
            mount = replace(sharp.mount, covariance=1e-4 * sharp.mount.covariance)
            store.put(replace(sharp, mount=mount), replayed=number % 2 == 0)
    for command in ("list", "history"):
        names = ("--robot", sharp.robot, "--camera", sharp.camera) if command == "history" else ()
        rows = omnivert("extrinsics", command, "--store", tmp_path / "x.db", *names).out.splitlines()
        assert max(map(len, rows)) <= 100, rows
        assert rows[2].split()[0] == "#30"
    told = " ".join(rows)
    assert "from playbacks, behind what the robot itself gave: #29, #27" in told


def test_the_history_is_newest_first(omnivert: Any, store: Path) -> None:
    entries = omnivert("extrinsics", "history", "--store", store, "--json").json["entries"]
    assert [entry["entry"] for entry in entries] == [3, 1]


def test_one_entry_is_shown_with_all_that_belongs_to_it(omnivert: Any, store: Path) -> None:
    shown = omnivert("extrinsics", "show", "--store", store)
    assert "#3  robot demo, camera front  calibrated" in shown.out
    assert "0123456789abcdef" in shown.out
    body = omnivert("extrinsics", "show", "--store", store, "--robot", "arm", "--camera", "wrist", "--json").json
    assert (body["entry"], body["phi_rad"], body["frames"]) == (2, 1.0, 120)
    assert omnivert("extrinsics", "show", "--store", store, "--entry", 1, "--json").json["phi_rad"] == 0.5


def test_every_export_holds_the_same_pose(omnivert: Any, store: Path) -> None:
    x, y, yaw = pose()

    def exported(form: str) -> str:
        ran = omnivert("extrinsics", "export", "--store", store, "--format", form, "--z-m", 0.4)
        assert ran.code == 0
        return str(ran.out)

    assert json.loads(exported("json"))["robot_from_camera"]["x_m"] == pytest.approx(x, abs=1e-9)
    assert f"  yaw_rad: {json.loads(exported('json'))['robot_from_camera']['yaw_rad']}" in exported("yaml")
    urdf = re.search(r'xyz="(\S+) (\S+) (\S+)" rpy="0 0 (\S+)"', exported("urdf"))
    assert urdf is not None
    assert [float(v) for v in urdf.groups()] == pytest.approx([x, y, 0.4, yaw], abs=1e-6)
    ros2 = dict(re.findall(r"--(x|y|z|yaw) (\S+)", exported("ros2")))
    assert [float(ros2[k]) for k in ("x", "y", "z", "yaw")] == pytest.approx([x, y, 0.4, yaw], abs=1e-6)


def test_nothing_stored_is_said_with_what_is(omnivert: Any, store: Path, tmp_path: Path) -> None:
    ran = omnivert("extrinsics", "show", "--store", store, "--robot", "other")
    assert ran.code == 1
    assert "arm/wrist, demo/front" in ran.err
    assert "--robot arm --camera wrist" in ran.err
    ran = omnivert("extrinsics", "list", "--store", tmp_path / "none.db")
    assert (ran.code, ran.out) == (1, "")
    assert "error[OV605]" in ran.err
    assert not (tmp_path / "none.db").exists()


def test_an_entry_of_another_rig_than_the_configurations_is_warned_of(omnivert: Any, tmp_path: Path) -> None:
    robot, other = tmp_path / "robot.toml", tmp_path / "other.toml"
    robot.write_text("[robot]\nwheel_base_m = 0.5\n")
    other.write_text("[robot]\nwheel_base_m = 0.5\n[encoder]\nticks_per_rev = 1000\n")
    with Store(tmp_path / "x.db") as store:
        store.put(replace(extrinsics("demo", "front", 1, 0.6), rig_digest=load(robot).rig_digest()))
    for command in (("show",), ("show", "--json"), ("export", "--format", "urdf")):
        given = ("extrinsics", *command, "--store", tmp_path / "x.db")
        plain = omnivert(*given)
        assert (plain.code, plain.err) == (0, "")
        assert omnivert(*given, "--config", robot) == plain
        warned = omnivert(*given, "--config", other)
        assert (warned.code, warned.out) == (0, plain.out)
        assert "#1 was stored for another rig than that of" in warned.err
        assert "what differs is encoder (" in warned.err
        assert "robot (" not in warned.err


@pytest.mark.parametrize("name", ["extrinsics.db", "extrinsics.db-wal", "./extrinsics.db"])
def test_an_export_does_not_overwrite_the_store_it_reads(omnivert: Any, store: Path, name: str) -> None:
    before = store.read_bytes()
    ran = omnivert("extrinsics", "export", "-f", "json", "--store", store, "-o", f"{store.parent}/{name}")
    assert (ran.code, "error[OV208]" in ran.err) == (2, True)
    assert store.read_bytes() == before


@pytest.mark.parametrize("height", ["nan", "inf", "-inf"])
def test_a_height_that_is_no_number_is_wrong_use(omnivert: Any, store: Path, height: str) -> None:
    ran = omnivert("extrinsics", "export", "-f", "urdf", "--store", store, f"--z-m={height}")
    assert (ran.code, ran.out) == (2, "")


def test_entries_are_counted_from_one(omnivert: Any, store: Path) -> None:
    assert omnivert("extrinsics", "show", "--store", store, "--entry", -1).code == 2
    assert omnivert("extrinsics", "show", "--store", store, "--entry", 99).code == 1


def test_a_store_that_is_a_folder_is_called_so(omnivert: Any, tmp_path: Path) -> None:
    ran = omnivert("extrinsics", "list", "--store", tmp_path)
    assert (ran.code, "is a folder" in ran.err) == (2, True)


def test_an_unknown_format_is_wrong_use(omnivert: Any, store: Path) -> None:
    assert omnivert("extrinsics", "export", "--store", store, "--format", "xml").code == 2


def test_the_only_robot_in_a_store_need_not_be_named(omnivert: Any, tmp_path: Path) -> None:
    with Store(tmp_path / "x.db") as store:
        store.put(extrinsics("rob7", "rear", 1, 0.6))
    for command in (("show",), ("history",), ("export", "--format", "ros2")):
        assert omnivert("extrinsics", *command, "--store", tmp_path / "x.db").code == 0
    other = omnivert("extrinsics", "history", "--store", tmp_path / "x.db", "--robot", "other")
    assert (other.code, "--robot rob7 --camera rear" in other.err) == (1, True)


def test_the_place_of_a_camera_that_has_moved_is_exported_only_when_asked_for(omnivert: Any, tmp_path: Path) -> None:
    with Store(tmp_path / "x.db") as store:
        store.put(extrinsics("demo", "front", 1, 0.6))
        store.put(replace(extrinsics("demo", "front", 2, 0.6), state=State.MOVED, reasons=("knocked by 2 deg",)))
    export = ("extrinsics", "export", "--store", tmp_path / "x.db", "--format", "json")
    refused = omnivert(*export)
    assert (refused.code, refused.out, "knocked by 2 deg" in refused.err) == (1, "", True)
    assert json.loads(omnivert(*export, "--entry", 2).out)["verdict"] == "moved"
