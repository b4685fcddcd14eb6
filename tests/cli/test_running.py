"""up and monitor on a real bus."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from omnivert.config import Config, parsed
from omnivert.wire.bus import Router

OMNIVERT = (sys.executable, "-c", "from omnivert.cli import main; main()")


def test_a_monitor_on_a_bus_without_services_says_what_to_start(omnivert: Any, tmp_path: Path) -> None:
    endpoint = f"unixsock-stream/{tmp_path}/bus.sock"
    config = parsed({**Config().model_dump(mode="json"), "bus": {"endpoint": endpoint}}, "test")
    with Router(config):
        ran = omnivert("monitor", "--once", "--connect", endpoint, "--robot", "r2")
    assert ran.code == 0
    assert "robot r2" in ran.out
    assert "WAITING" in ran.out
    assert "omnivert up" in ran.out


def test_up_says_what_it_listens_on_and_ctrl_c_ends_it_cleanly(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    cv2.imwrite(str(frames / "0.png"), np.full((480, 640), 90, np.uint8))
    (tmp_path / "robot.toml").write_text(
        f'''
        [robot]
        id = "r2"
        [camera]
        source = "{frames}"
        [encoder]
        port = "{tmp_path}/no-such-port"
        [bus]
        endpoint = "unixsock-stream/{tmp_path}/bus.sock"
        [storage]
        path = "{tmp_path}/extrinsics.db"
        '''
    )
    command = [*OMNIVERT, "up", "--config", str(tmp_path / "robot.toml"), "--record", str(tmp_path / "drive.mcap")]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True) as up:
        assert up.stderr is not None
        told = []
        for line in up.stderr:
            told.append(line)
            if "router: listening" in line:
                break
        up.send_signal(signal.SIGINT)
        told += up.stderr.readlines()
        assert up.wait(30) == 0, told
    text = "".join(told)
    assert f"unixsock-stream/{tmp_path}/bus.sock   (this machine only)" in text
    assert "robot r2" in text
    assert "stopped; extrinsics in" in text
    assert "Traceback" not in text
