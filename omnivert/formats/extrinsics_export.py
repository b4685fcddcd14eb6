"""Extrinsics as text for other programs: JSON, YAML, a URDF joint, a ROS 2 static transform.

All say where the camera frame sits in the robot frame (ROS names: base_link -> camera): x = rho cos phi forward,
y = rho sin phi to the left, yaw = phi + psi counter-clockwise. The camera frame has its x axis where bearings are 0.
The calibration is planar: z, roll and pitch are not measured; z is what the caller says, roll and pitch are 0.
"""

import json
from enum import StrEnum
from math import cos, degrees, isfinite, sin
from shlex import quote
from typing import Any
from xml.sax.saxutils import quoteattr

from omnivert.angles import wrap
from omnivert.messages import Extrinsics, Mount
from omnivert.store import Entry


class Form(StrEnum):
    """A file format for extrinsics."""

    JSON = "json"
    YAML = "yaml"
    URDF = "urdf"  # a fixed joint
    ROS2 = "ros2"  # a static_transform_publisher line


def exported(entry: Entry, form: Form, parent: str = "base_link", z_m: float = 0.0) -> str:
    """The text, without a line end after its last line; the camera's id names its frame.

    parent  name of the robot's frame
    z_m     height of the camera above it, measured by hand
    raises  ValueError when it is not finite
    """
    if not isfinite(z_m):
        raise ValueError(f"a height of {z_m} m")
    match form:
        case Form.JSON:
            return json.dumps(body(entry, z_m), indent=2, ensure_ascii=False)
        case Form.YAML:
            return "\n".join(_yaml(body(entry, z_m)))
        case Form.URDF:
            return _urdf(entry.extrinsics, parent, z_m)
        case Form.ROS2:
            return _ros2(entry.extrinsics, parent, z_m)


def robot_from_camera(mount: Mount) -> tuple[float, float, float]:
    """x and y (m) and yaw (rad, (-pi, pi]) of the camera in the robot's frame."""
    x, y = mount.rho_m * cos(mount.phi_rad), mount.rho_m * sin(mount.phi_rad)
    return x, y, wrap(mount.phi_rad + mount.psi_rad)


def body(entry: Entry, z_m: float = 0.0) -> dict[str, Any]:
    """An entry of the store with all that belongs to it; the covariance is in the order phi, rho, psi."""
    extrinsics, mount = entry.extrinsics, entry.extrinsics.mount
    x, y, yaw = robot_from_camera(mount)
    return {
        "entry": entry.entry,
        "saved_at": entry.saved_at,
        "robot": extrinsics.robot,
        "camera": extrinsics.camera,
        "verdict": extrinsics.state.value,
        "reasons": list(extrinsics.reasons),
        "phi_rad": float(mount.phi_rad),
        "rho_m": float(mount.rho_m),
        "psi_rad": float(mount.psi_rad),
        "covariance": [[float(value) for value in row] for row in mount.covariance],
        "sigma": dict(zip(("phi_rad", "rho_m", "psi_rad"), _sigmas(mount), strict=True)),
        "robot_from_camera": {"x_m": x, "y_m": y, "z_m": z_m, "yaw_rad": yaw},
        "frames": extrinsics.frames,
        "replayed": entry.replayed,
        "stamp_ns": extrinsics.stamp_ns,
        "software": extrinsics.software,
        "rig_digest": extrinsics.rig_digest,
    }


def _yaml(facts: dict[str, Any], indent: str = "") -> list[str]:
    """Block style; texts, whole numbers and lists as JSON writes them, which YAML reads alike."""
    lines = []
    for key, value in facts.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}:", *_yaml(value, indent + "  ")]
        else:
            lines.append(f"{indent}{key}: {_yaml_value(value)}")
    return lines


def _yaml_value(value: Any) -> str:
    if isinstance(value, float):
        # YAML 1.1 takes 1e-05 for a text: its numbers want a point and a sign in the exponent.
        mantissa, mark, exponent = repr(value).partition("e")
        sign = "" if not mark or exponent[0] in "+-" else "+"
        return f"{mantissa if '.' in mantissa else mantissa + '.0'}{mark}{sign}{exponent}"
    if isinstance(value, list):
        return "[" + ", ".join(_yaml_value(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)


def _urdf(extrinsics: Extrinsics, parent: str, z_m: float) -> str:
    x, y, yaw = robot_from_camera(extrinsics.mount)
    return "\n".join(
        (
            f"<!-- {_numbers(extrinsics)} -->",
            f'<joint name="{extrinsics.camera}_joint" type="fixed">',
            f"  <parent link={quoteattr(parent)}/>",
            f'  <child link="{extrinsics.camera}"/>',
            f'  <origin xyz="{x:.6f} {y:.6f} {z_m:.6f}" rpy="0 0 {yaw:.8f}"/>',
            "</joint>",
        )
    )


def _ros2(extrinsics: Extrinsics, parent: str, z_m: float) -> str:
    x, y, yaw = robot_from_camera(extrinsics.mount)
    place = f"--x {x:.6f} --y {y:.6f} --z {z_m:.6f} --yaw {yaw:.8f} --pitch 0 --roll 0"
    frames = f"--frame-id {quote(parent)} --child-frame-id {quote(extrinsics.camera)}"
    return f"ros2 run tf2_ros static_transform_publisher {place} {frames}"


def _numbers(extrinsics: Extrinsics) -> str:
    """The numbers with their sigmas, in words that an XML comment can hold."""
    mount = extrinsics.mount
    phi, rho, psi = _sigmas(mount)
    return (
        f"{extrinsics.state.value.replace('_', ' ')}: phi {degrees(mount.phi_rad):.2f} +/- {degrees(phi):.2f} deg, "
        f"rho {mount.rho_m:.4f} +/- {rho:.4f} m, psi {degrees(mount.psi_rad):.2f} +/- {degrees(psi):.2f} deg"
    )


def _sigmas(mount: Mount) -> tuple[float, ...]:
    return tuple(max(float(mount.covariance[k, k]), 0.0) ** 0.5 for k in range(3))
