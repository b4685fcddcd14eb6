"""up and monitor on a real bus."""

import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.cli.interrupts import held_back, interruptible
from omnivert.cli.robot import up
from omnivert.cli.settings import opened
from omnivert.config import Config, load, parsed
from omnivert.wire.bus import Bus, Router
from omnivert.wire.recording import Recording
from services.recorder import Recorded
from tests.processes import own

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


def test_a_monitor_tells_its_one_state_as_json(omnivert: Any, tmp_path: Path) -> None:
    endpoint = f"unixsock-stream/{tmp_path}/bus.sock"
    config = parsed({**Config().model_dump(mode="json"), "bus": {"endpoint": endpoint}}, "test")
    with Router(config), Bus(config, "vision", "front") as vision:
        vision.ready()
        vision.refuse("a fault")
        told = omnivert("monitor", "--json", "--connect", endpoint).json
    assert (told["robot"], told["state"], told["stored"]) == ("demo", "waiting", None)
    (service,) = [service for service in told["services"] if service["service"] == "vision"]
    assert service["present"]
    assert service["health"]["refused"] == {"a fault": 1}


def test_ctrl_c_while_it_loads_is_silent() -> None:
    loads = "import builtins, os, signal\nfrom omnivert.cli import main\nwhole = builtins.__import__\n"
    loads += "def half(name, *rest):\n    if name == 'typer': os.kill(os.getpid(), signal.SIGINT)\n"
    loads += "    return whole(name, *rest)\nbuiltins.__import__ = half\nmain()"
    done = subprocess.run([sys.executable, "-c", loads, "config"], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")


def interrupted(number: int, arguments: Sequence[str], mark: str, **options: Any) -> tuple[int, str]:
    """Exit code and story of a command that gets a signal when its story holds the mark."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with own(
        subprocess.Popen(
            [*OMNIVERT, *arguments],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **options,
        )
    ) as process:
        assert process.stderr is not None
        told = []
        for line in process.stderr:
            told.append(line)
            if mark in line:
                break
        process.send_signal(number)
        told += process.stderr.readlines()
        return process.wait(30), "".join(told)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_calibration_as_ctrl_c_does(number: int) -> None:
    assert interrupted(number, ("calibrate", "corridor"), "given")[0] == 128 + number


def test_a_command_puts_in_order_what_it_began_when_it_is_told_to_end() -> None:
    ends = "import os, signal, sys\nfrom omnivert.cli.offline import track\n"
    ends += "def told(*rest):\n    try:\n        os.kill(os.getpid(), signal.SIGTERM)\n        signal.pause()\n"
    ends += "    finally:\n        print('in order')\ntrack._report = told\nfrom omnivert.cli import main\nmain()"
    command = [sys.executable, "-c", ends, "track", "corridor"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, "Traceback" in done.stderr) == (143, "in order\n", False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_that_a_library_makes_another_error_of_is_one_all_the_same(number: int) -> None:
    ends = "import os, signal, sys\nfrom omnivert.cli import app\nfrom omnivert.cli.explain import command\n"
    ends += f"def told(*rest, **more):\n    try:\n        os.kill(os.getpid(), {int(number)})\n        signal.pause()\n"
    ends += "    except KeyboardInterrupt as error:\n        raise ValueError('from a callback') from error\n"
    ends += "app.app = told\nfrom omnivert.cli import main\nmain()"
    command = [sys.executable, "-c", ends, "explain"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (128 + number, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_what_must_not_be_cut_short(number: int) -> None:
    steps: list[str] = []
    came: list[int] = []

    def work() -> None:
        with interruptible(came):
            with held_back():
                signal.raise_signal(number)
                steps.append("whole")
            steps.append("never")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert (steps, came[0]) == (["whole"], number)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_recording_told_to_end_ends_as_at_ctrl_c(tmp_path: Path) -> None:
    config = on_bus(tmp_path)
    command = ("record", str(tmp_path / "d.mcap"), "--connect", config.bus.endpoint, "--json")
    with Router(config):
        code, told = interrupted(signal.SIGTERM, command, "recording robot")
    assert (code, "error[OV308]" in told) == (1, True)  # nobody was there to be heard, and it says so


def test_what_was_recorded_is_said_as_json(omnivert: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(bus: Bus, config: Config, path: Path, told: object) -> Recorded:
        path.write_bytes(b"twelve bytes")
        return Recorded([path], 12, Counter(ticks=3, frame=2), 1)

    monkeypatch.setattr("services.recorder.run", run)
    config = on_bus(tmp_path)
    with Router(config):
        ran = omnivert("record", tmp_path / "d.mcap", "--connect", config.bus.endpoint, "--json")
    assert ran.code == 0
    path = f"{tmp_path}/d.mcap"
    said = {"recording": path, "parts": [path], "robot": "demo", "bytes": 12, "lost": 1}
    assert ran.json == {**said, "messages": {"ticks": 3, "frame": 2}}
    assert "1 messages" in ran.err


def on_bus(folder: Path) -> Config:
    return parsed({"bus": {"endpoint": f"unixsock-stream/{folder}/bus.sock"}}, "test")


def test_a_playback_to_nobody_says_so_and_how_it_went(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    config = on_bus(tmp_path)
    with Router(config):
        ran = omnivert("play", straight, "--connect", config.bus.endpoint, "--speed", "0", "--to", "2")
    assert ran.code == 0
    assert "no vision service of robot demo listens" in ran.err
    assert re.search(r"played \d+ messages, \d+ frames of them, in \d+\.\d s; 0 lost$", ran.err.strip())


def test_a_playback_beside_a_bridge_is_refused_each_time_and_ends_cleanly(straight: Path, tmp_path: Path) -> None:
    config = on_bus(tmp_path)
    command = [*OMNIVERT, "play", str(straight), "--connect", config.bus.endpoint]
    with Router(config), Bus(config, "bridge", "front") as bridge:
        bridge.refuse_beside("player")
        started = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(4)]
        ended = [(process.communicate(timeout=60)[1], process.returncode) for process in started]
    assert [code for _, code in ended] == [2] * 4, ended
    for text, _ in ended:
        assert "error[OV402]" in text
        assert "omnivert up --play" in text
        assert "FATAL" not in text


def test_up_plays_a_recording_in_place_of_the_bridge(straight: Path, tmp_path: Path) -> None:
    whole = Recording(straight).config(on_bus(tmp_path)).model_dump(mode="json")
    whole["storage"]["path"] = str(tmp_path / "extrinsics.db")
    (tmp_path / "robot.json").write_text(json.dumps(whole))
    command = [*OMNIVERT, "up", "--config", str(tmp_path / "robot.json"), "--play", str(straight), "--speed", "1"]
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
    assert "plays     straight.mcap, in place of the robot" in text
    assert re.search(r"player: played \d+ messages, 24 frames of them, .* 0 lost", text), text
    assert "bridge" not in text
    assert text.count("ready: all services are at work") == 1, text
    assert text.index("ready: ") < text.index("the calibration begins from nothing: a playback")
    assert f"next: omnivert monitor --config {tmp_path}/robot.json" in text


def test_without_a_configuration_up_takes_the_rig_of_the_recording() -> None:
    with up._file(None, "corridor", None) as file:
        assert load(file).rig_digest() == opened("corridor").config(Config()).rig_digest()


def test_a_simulated_robot_has_a_store_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(f'storage.path = "{tmp_path}/kept.db"\nrobot.wheel_base_m = 0.5\n')
    with up._file(file, None, "office") as simulated, up._file(file, None, None) as real:
        assert load(real).storage.path == tmp_path / "kept.db"
        assert load(simulated).storage.path == tmp_path / "kept-sim.db"
        assert load(simulated).rig_digest() == load(real).rig_digest()
    with up._file(None, None, "office") as simulated:
        assert load(simulated).storage.path == Path("extrinsics-sim.db")


@pytest.mark.parametrize("options", [("--speed", "2"), ("--loop",)])
def test_what_belongs_to_a_playback_needs_one(omnivert: Any, options: tuple[str, ...]) -> None:
    ran = omnivert("up", "--config", "robot.toml", *options)
    assert (ran.code, "omnivert up --play" in ran.err) == (2, True)


def unwrapped(text: str) -> str:
    return " ".join(text.split())


def test_up_tells_a_store_that_cannot_be_written_and_that_nothing_was_stored(straight: Path, tmp_path: Path) -> None:
    whole = Recording(straight).config(on_bus(tmp_path)).model_dump(mode="json")
    whole["storage"]["path"] = str(tmp_path / "no" / "x.db")
    (tmp_path / "robot.json").write_text(json.dumps(whole))
    command = [*OMNIVERT, "up", "--config", str(tmp_path / "robot.json"), "--play", str(straight)]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "1000"}
    with own(
        subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    ) as up:
        assert up.stderr is not None
        told = []
        for line in up.stderr:
            told.append(line)
            if "error[OV602]" in line:
                break
        up.send_signal(signal.SIGINT)
        told += up.stderr.readlines()
        assert up.wait(30) == 0, told
    because = f"the store {tmp_path}/no/x.db cannot be opened: there is no folder {tmp_path}/no"
    assert any(f"! storage: error[OV602]: {because}; what is to be stored waits" in line for line in told)
    assert told[-1].startswith(f"stopped; nothing was stored: {because}; nothing waited"), told[-1]


def robot_with_a_folder(folder: Path) -> Path:
    """The configuration of a robot whose camera is a folder of one image, and whose encoder is away."""
    frames = folder / "frames"
    frames.mkdir()
    cv2.imwrite(str(frames / "0.png"), np.full((480, 640), 90, np.uint8))
    file = folder / "robot.toml"
    file.write_text(
        f'''
        [robot]
        id = "r2"
        [camera]
        source = "{frames}"
        [encoder]
        port = "{folder}/no-such-port"
        [bus]
        endpoint = "unixsock-stream/{folder}/bus.sock"
        [storage]
        path = "{folder}/extrinsics.db"
        '''
    )
    return file


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for left-over processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_all_that_up_has_started_and_nobody_by_force(
    tmp_path: Path, marked: Any, number: signal.Signals
) -> None:
    file = robot_with_a_folder(tmp_path)
    command = [*OMNIVERT, "up", "--config", str(file), "--record", str(tmp_path / "drive.mcap")]
    wanted = {*up.SERVICES, "recorder"}
    with own(
        subprocess.Popen(command, env=marked.environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    ) as started:
        with Bus(load(file), "test", "test") as bus:
            assert bus.await_presence(lambda: wanted <= {service for service, _ in bus.present()}, 60.0)
        assert len(marked.processes()) == 1 + len(wanted)
        started.send_signal(number)
        _, told = started.communicate(timeout=30)
    assert started.returncode == 0, told
    assert marked.processes() == []
    assert "killed" not in told
    assert "by force" not in told
    assert "died" not in told
    assert "stopped; " in told


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_up_says_what_it_listens_on_and_ctrl_c_ends_it_cleanly(tmp_path: Path, number: int) -> None:
    file = robot_with_a_folder(tmp_path)
    command = [*OMNIVERT, "up", "--config", str(file), "--record", str(tmp_path / "drive.mcap")]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with own(
        subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    ) as up:
        assert up.stderr is not None
        told = []
        for line in up.stderr:
            told.append(line)
            if "router: listening" in line:
                break
        up.send_signal(number)
        told += up.stderr.readlines()
        assert up.wait(30) == 0, told
    text = "".join(told)
    assert f"unixsock-stream/{tmp_path}/bus.sock   (this machine only)" in text
    assert "robot r2" in text
    assert f"stopped; nothing was stored in {tmp_path}/extrinsics.db: nothing was calibrated" in unwrapped(text)
    assert "Traceback" not in text
