"""Exports: other programs read back the very numbers, in the frames that they expect."""

import json
import math
import re
import shlex
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnivert.formats.extrinsics_export import Form, body, exported
from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Entry

FLOAT_1_1 = re.compile(r"[-+]?([0-9][0-9_]*)?\.[0-9]*([eE][-+][0-9]+)?")  # what YAML 1.1 takes for a float

angles = st.floats(-3.14, 3.14)


def entry(phi: float, rho: float, psi: float) -> Entry:
    mount = Mount(phi, rho, psi, np.diag([1e-5, 1e-8, 4e-5]))
    said = Extrinsics(7, "demo", "front", mount, State.CALIBRATED, 99, ('a "b": c # d',), "omnivert 0.1.0", "00ff")
    return Entry(41, "2026-01-01T00:00:00.000Z", said)


def place(phi: float, rho: float, psi: float) -> tuple[complex, complex]:
    """Camera's place in the robot's frame, and its direction."""
    return rho * np.exp(1j * phi), np.exp(1j * (phi + psi))


def agrees(x: float, y: float, yaw: float, truth: tuple[complex, complex]) -> bool:
    return abs(complex(x, y) - truth[0]) < 2e-6 and abs(np.exp(1j * yaw) - truth[1]) < 2e-6


@given(phi=angles, rho=st.floats(0.0, 2.0), psi=angles)
def test_urdf_and_ros_2_put_the_camera_where_the_mount_says(phi: float, rho: float, psi: float) -> None:
    joint = ET.fromstring(exported(entry(phi, rho, psi), Form.URDF, "base <link>", 0.9))
    origin = joint.find("origin")
    parent, child = joint.find("parent"), joint.find("child")
    assert origin is not None
    assert parent is not None
    assert child is not None
    assert (joint.get("type"), parent.get("link"), child.get("link")) == ("fixed", "base <link>", "front")
    x, y, z = map(float, origin.attrib["xyz"].split())
    roll, pitch, yaw = map(float, origin.attrib["rpy"].split())
    assert (z, roll, pitch) == (0.9, 0.0, 0.0)
    assert agrees(x, y, yaw, place(phi, rho, psi))

    words = shlex.split(exported(entry(phi, rho, psi), Form.ROS2, "base link", 0.9))
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    options = dict(zip(words[4::2], words[5::2], strict=True))
    assert options["--frame-id"] == "base link"
    assert options["--child-frame-id"] == "front"
    assert (float(options["--z"]), float(options["--roll"]), float(options["--pitch"])) == (0.9, 0.0, 0.0)
    x, y, yaw = (float(options[name]) for name in ("--x", "--y", "--yaw"))
    assert agrees(x, y, yaw, place(phi, rho, psi))


def test_a_height_that_is_no_number_is_a_wrong_call() -> None:
    with pytest.raises(ValueError, match="height"):
        exported(entry(0.1, 0.2, 0.3), Form.ROS2, z_m=math.nan)


def test_the_corridors_mount_by_hand() -> None:
    x, y, yaw = (body(entry(-0.34, 0.23, 0.33))["robot_from_camera"][name] for name in ("x_m", "y_m", "yaw_rad"))
    assert math.isclose(x, 0.21683, abs_tol=1e-5)
    assert math.isclose(y, -0.07670, abs_tol=1e-5)
    assert math.isclose(yaw, -0.01, abs_tol=1e-12)


def test_json_holds_every_number_to_the_last_bit() -> None:
    facts = json.loads(exported(entry(0.1 + 0.2, 1 / 3, -math.pi / 3), Form.JSON))
    assert (facts["phi_rad"], facts["rho_m"], facts["psi_rad"]) == (0.1 + 0.2, 1 / 3, -math.pi / 3)
    assert facts["covariance"] == [[1e-5, 0, 0], [0, 1e-8, 0], [0, 0, 4e-5]]
    assert facts["verdict"] == "calibrated"
    assert (facts["entry"], facts["stamp_ns"], facts["rig_digest"]) == (41, 7, "00ff")


def test_yaml_says_the_same_and_its_numbers_are_numbers_in_both_versions_of_yaml() -> None:
    facts = body(entry(0.1 + 0.2, 1 / 3, 1e-7), 0.5)
    lines = exported(entry(0.1 + 0.2, 1 / 3, 1e-7), Form.YAML, z_m=0.5).splitlines()
    read: dict[str, object] = {}
    nested: dict[str, object] = read
    for line in lines:
        key, _, value = line.strip().partition(": ")
        nested = nested if line.startswith("  ") else read
        if line.endswith(":"):
            nested = read[key.rstrip(":")] = {}
            continue
        for number in re.findall(r"(?<![\w\"])-?\d[\d.]*e?[-+\d]*", value) if not value.startswith('"') else ():
            assert number.lstrip("-").isdecimal() or FLOAT_1_1.fullmatch(number), line
        nested[key] = json.loads(value)
    assert read == facts
