"""Devices tried by themselves: real pseudo-terminals, real folders, another process that holds the port."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from omnivert.config import Config, parsed
from omnivert.doctor import devices
from omnivert.doctor.evidence import Device, Service
from omnivert.messages import Health
from tests.doctor.devices_here import pictures, sending, settings

HOLD = "import sys; port = open(sys.argv[1], 'rb', 0); print('held', flush=True); sys.stdin.read()"


def config(port: Path, source: Path, more: Mapping[str, Mapping[str, Any]] | None = None) -> Config:
    tables = {name: {**table, **(more or {}).get(name, {})} for name, table in settings(port, source).items()}
    return parsed(tables, "the test")


def test_devices_that_work_are_fine_and_say_how_fast(tmp_path: Path) -> None:
    source = pictures(tmp_path / "images")
    with sending(tmp_path / "tty") as port:
        encoder, camera = devices.tried(config(port, source))
    assert not encoder.trouble, encoder
    assert "readings a second" in encoder.fact
    assert not camera.trouble, camera
    assert "64 x 48 px" in camera.fact


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    found = devices.encoder(config(tmp_path / "tty", tmp_path).encoder)
    assert found.trouble == f"{tmp_path / 'tty'} is not there"
    assert found.help


def test_a_board_that_speaks_in_another_baud_rate(tmp_path: Path) -> None:
    with sending(tmp_path / "tty", lambda k: bytes([k % 7 + 128]) * 20 + b"\n") as port:
        found = devices.encoder(config(port, tmp_path).encoder)
    assert found.trouble == f"{port} sends what cannot be read"
    assert "encoder.protocol, which is omnivert, and encoder.baud, which is 115200" in found.help


def test_a_board_that_is_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "LISTEN_S", 0.3)
    with sending(tmp_path / "tty", lambda _: b"") as port:
        found = devices.encoder(config(port, tmp_path).encoder)
    assert found.trouble == f"{port} is open and silent"


def test_a_port_that_another_process_holds_stays_closed_and_its_holder_is_named(tmp_path: Path) -> None:
    with sending(tmp_path / "tty") as port:
        holder = subprocess.Popen(
            [sys.executable, "-c", HOLD, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        with holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "held\n"
            found = devices.encoder(config(port, tmp_path).encoder)
            holder.communicate("")
    assert f"(process {holder.pid})" in found.trouble
    assert "is held by" in found.trouble


def test_a_port_that_is_forbidden_says_which_group_opens_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)  # whoever runs the tests may be root
    monkeypatch.setattr(devices, "_group", lambda _: "dialout")
    with sending(tmp_path / "tty") as port:
        found = devices.encoder(config(port, tmp_path).encoder)
    assert found.trouble == f"{port}: permission denied"
    assert found.reason == "you are not in the group dialout"
    assert found.help.startswith("sudo usermod -aG dialout ")


def test_a_camera_of_another_size(tmp_path: Path) -> None:
    source = pictures(tmp_path / "images", 80, 60)
    found = devices.camera(config(tmp_path, source).camera)
    assert found.trouble == f"{source} gives 80 x 60 px, the configuration says 64 x 48"
    assert "camera.width_px = 80, camera.height_px = 60" in found.help


def test_a_camera_that_is_not_there(tmp_path: Path) -> None:
    assert devices.camera(config(tmp_path, tmp_path / "none").camera).trouble == f"{tmp_path / 'none'} is not there"


def test_a_folder_without_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "LISTEN_S", 0.3)
    (tmp_path / "images").mkdir()
    assert devices.camera(config(tmp_path, tmp_path / "images").camera).trouble


def bridge(*notes: str, refused: dict[str, int] | None = None) -> Service:
    return Service("bridge", "front", True, None, Health(0, "bridge", "front", 9.0, notes=notes, refused=refused or {}))


def told(what: str, service: Service, place: str = "/dev/ttyUSB0") -> Device:
    return devices.as_the_bridge_tells(what, place, service)


def test_what_the_bridge_says_of_its_devices_is_believed() -> None:
    silent = "encoder: /dev/ttyUSB0 is open and has given nothing usable for 5 s"
    found = told("encoder", bridge(silent, refused={"encoder: checksum differs": 9, "encoder: too long": 1}))
    assert (found.trouble, found.reason) == (silent.removeprefix("encoder: "), "checksum differs")
    assert not told("encoder", bridge("camera: 0 does not open")).trouble
    assert not told("camera", bridge("camera: source finished")).trouble
    stamped = told("camera", bridge("camera: stamped by the kernel's driver, 15 Hz"), "0")
    assert (stamped.trouble, stamped.fact) == ("", "0: the bridge reads it; stamped by the kernel's driver, 15 Hz")
    size = "camera: frames have 800 x 600 pixels, the configuration says 640 x 480"
    assert told("camera", bridge(size), "0").help.startswith("set camera.width_px = 800 and camera.height_px = 600")
    assert not devices.as_the_bridge_tells("camera", "0", Service("bridge", "front", True)).known
