"""The demo end to end: real processes on a real bus, from nothing to a stored mount with its picture."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.cli.robot.demo_watch import SETTLE_S, SILENCE_S, Heard
from omnivert.messages import Estimate, Extrinsics, Mount, ParameterVerdict, Playback, Receipt, State
from omnivert.store import Store
from tests.processes import own

OMNIVERT = (sys.executable, "-c", "from omnivert.cli import main; main()")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for left-over processes in /proc")
def test_the_demo_calibrates_stores_and_draws_and_leaves_no_process(tmp_path: Path, marked: Any, omnivert: Any) -> None:
    output = tmp_path / "out"
    command = [*OMNIVERT, "demo", "--output", str(output), "--json"]
    ran = subprocess.run(command, env=marked.environment, capture_output=True, text=True, timeout=110, check=False)
    assert ran.returncode == 0, ran.stderr
    body = json.loads(ran.stdout)
    assert body["verdict"] == "calibrated"
    assert max(body["off_in_sigmas"].values()) < 3.0
    assert abs(body["off"]["phi_rad"]) < 0.035
    assert abs(body["off"]["rho_m"]) < 0.015
    assert abs(body["off"]["psi_rad"]) < 0.035
    picture = cv2.imread(str(output / "result.png"))
    assert picture is not None
    assert picture.std() > 20
    with Store(output / "extrinsics.db", writable=False) as store:
        latest = store.latest("demo", "front")
    assert latest is not None
    assert latest.entry == body["entry"]
    assert body["frames"] == 158  # the last one's: what is stored is the last row of the table
    mount = latest.extrinsics.mount
    offline = omnivert("calibrate", "corridor", "--json").json
    for told in (body, offline):  # every bit of it: the services and the file give the same
        assert (mount.phi_rad, mount.rho_m, mount.psi_rad) == (told["phi_rad"], told["rho_m"], told["psi_rad"])
        assert mount.covariance.tolist() == told["covariance"]
    for state in ("not yet", "calibrated"):
        assert state in ran.stderr
    assert marked.processes() == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_the_demo_and_all_its_processes(tmp_path: Path, marked: Any, number: int) -> None:
    command = [*OMNIVERT, "demo", "--output", str(tmp_path / "out")]
    with own(
        subprocess.Popen(
            command,
            env=marked.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    ) as demo:
        assert demo.stderr is not None
        for line in demo.stderr:
            if "playing" in line:
                break
        demo.send_signal(number)
        rest = demo.stderr.read()
        assert demo.wait(30) == 128 + number
    assert "Traceback" not in rest
    assert marked.processes() == []


PART = ParameterVerdict(State.CALIBRATED)
MOUNT = Mount(0.1, 0.2, 0.3, np.eye(3))


def heard_all() -> Heard:
    """Two frames played, the last one's estimate in, what was claimed stored."""
    heard = Heard(total_frames=2, end_ns=20)
    heard.step(Estimate(20, 2, MOUNT, State.CALIBRATED, PART, PART, PART, "", 1.0, 1.0, 5, 0, 0))
    heard.step(Extrinsics(20, "demo", "front", MOUNT, State.CALIBRATED, 2, (), "omnivert 0.1.0", "x"))
    heard.step(Receipt(20, "demo", "front", 1))
    heard.step(Playback(20, 2, 2, True))
    return heard


def test_the_demo_waits_for_the_receipt_of_the_last_claim() -> None:
    heard = heard_all()
    assert heard.complete
    heard.receipt = Receipt(10, "demo", "front", 1)
    assert not heard.complete
    assert heard.patience_s == SILENCE_S  # the store of a busy machine takes a while
    heard.step(Extrinsics(10, "demo", "front", MOUNT, State.CALIBRATED, 1, (), "omnivert 0.1.0", "x"))
    assert not heard.complete  # the claim of the final state is on its way


def test_the_demo_does_not_wait_long_for_frames_that_are_lost_when_all_is_stored() -> None:
    heard = heard_all()
    heard.end_ns = 30
    assert not heard.complete
    assert heard.patience_s == SETTLE_S


def test_the_demo_waits_for_the_last_frame_and_the_player() -> None:
    heard = heard_all()
    heard.played = Playback(20, 2, 2, False)
    assert not heard.complete
    heard = heard_all()
    heard.end_ns = 30
    assert not heard.complete


def test_why_nothing_is_stored_is_told_even_of_an_estimate_without_a_reason() -> None:
    heard = Heard(total_frames=2, end_ns=20)
    assert heard.why() == "no estimate came"
    usable = ParameterVerdict(State.USABLE)
    heard.step(Estimate(20, 1, MOUNT, State.USABLE, usable, usable, usable, "", 1.0, 1.0, 5, 0, 0))
    assert heard.why() == "the drive ended usable; 1 of 2 frames were taken"
    short = ParameterVerdict(State.NOT_YET, "because the way is short")
    reasons = ("the ticks stop",)
    heard.step(Estimate(30, 2, None, State.NOT_YET, short, short, short, "", 1.0, 1.0, 5, 0, 0, reasons))
    assert heard.why() == "the ticks stop; the way is short; 2 of 2 frames were taken"
