"""The doctor at real services that play the corridor at its own pace: healthy, and with what befalls processes.

All waiting is for events, with a deadline.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from omnivert.cli.app import run
from omnivert.cli.settings import opened, recording_path
from omnivert.config import Config, load, parsed
from omnivert.doctor.live import NO_COUNTS_S, Robot, live
from omnivert.doctor.pushed import Push, Stage
from omnivert.messages import Estimate, Ticks
from omnivert.wire.bus import Bus, Router
from omnivert.wire.channels import BEARINGS, ESTIMATE, HEALTH, TICKS
from tests.doctor.devices_here import pictures, sending, settings
from tests.doctor.test_pushed import messages

DEADLINE_S = 60.0
Doctor = Callable[..., dict[str, Any]]


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="ov-") as name:  # a socket's path must stay below 108 bytes
        yield Path(name)


@pytest.fixture
def doctor(capsys: pytest.CaptureFixture[str]) -> Doctor:
    """The command's JSON; its exit code must fit it."""

    def called(*arguments: object) -> dict[str, Any]:
        capsys.readouterr()
        code = run(["doctor", "--json", *map(str, arguments)])
        out, _ = capsys.readouterr()
        body = json.loads(out)
        assert isinstance(body, dict)
        assert code == (1 if body["stops"] else 0)
        return body

    return called


def written(folder: Path, config: Config) -> Path:
    file = folder / "robot.json"
    file.write_text(json.dumps(config.model_dump(mode="json")), encoding="utf-8")
    return file


@contextmanager
def service(file: Path, name: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-P", "-m", f"services.{name}", "--config", str(file), *arguments]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10.0)


def listened(bus: Bus, channel: Any, holds: Callable[[Any], bool]) -> None:
    """Until a message of the channel holds."""
    heard = bus.listen(channel, period_s=0.5)
    for _ in range(round(DEADLINE_S * 2 + 1000)):
        received = next(heard)
        if received is not None and holds(received.message):
            return
    raise AssertionError("it did not come")


def test_the_demo_is_healthy_and_each_fault_of_a_process_is_named_first(folder: Path, doctor: Doctor) -> None:
    whole = opened("corridor").config(Config()).model_dump(mode="json")
    whole["bus"]["endpoint"] = f"unixsock-stream/{folder / 'bus'}"
    whole["storage"]["path"] = str(folder / "kept" / "store.db")  # a folder that is not there yet
    whole["vision"]["max_lines"] = 40  # enough, and faster
    config = parsed(whole, "the test")
    file, rec = written(folder, config), str(recording_path("corridor"))
    playing = ("--recording", rec, "--speed", "1", "--wait-for", "vision,calibration,storage,test")

    with ExitStack() as stack:
        router = stack.enter_context(service(file, "router"))
        vision = stack.enter_context(service(file, "vision"))
        for name, arguments in (("calibration", ()), ("storage", ()), ("player", playing)):
            stack.enter_context(service(file, name, *arguments))
        with Bus(config, "test", "test") as bus:
            listened(bus, ESTIMATE, lambda message: isinstance(message, Estimate))

            unwritable = doctor("--config", file, "--seconds", "1.5")
            assert (unwritable["first"], unwritable["stops"]) == ("store", ["store"])

            (folder / "kept").mkdir()
            listened(bus, HEALTH, lambda h: h.service == "storage" and not h.notes)
            healthy = doctor("--config", file)
            assert (healthy["first"], healthy["healthy"], healthy["worse"]) == (None, True, [])
            assert doctor("--connect", config.bus.endpoint, "--seconds", "2.5", "--only", "streams")["healthy"]

            with service(file, "storage"):
                assert bus.await_presence(lambda: len(bus.incarnations("storage")) == 2, DEADLINE_S)
                twice = doctor("--config", file, "--seconds", "1.5")
            assert (twice["first"], twice["stops"]) == ("publishers", ["publishers"])
            assert bus.await_presence(lambda: len(bus.incarnations("storage")) == 1, DEADLINE_S)

            vision.kill()
            assert bus.await_presence(lambda: "vision" not in dict(bus.present()), DEADLINE_S)
            dead = doctor("--config", file, "--seconds", "1.5")
            assert (dead["first"], dead["stops"]) == ("services", ["services"])
            assert "vision not running" in str(dead["checks"])

        router.kill()
        router.wait()
        gone = doctor("--config", file, "--only", "bus")
        assert (gone["first"], gone["stops"]) == ("router", ["router"])


def test_a_robot_whose_services_do_not_run_has_its_devices_tried_and_no_router(folder: Path, doctor: Doctor) -> None:
    source = pictures(folder / "images")
    with sending(folder / "tty") as port:
        tables = settings(port, source)
        tables["bus"] = {"endpoint": f"unixsock-stream/{folder / 'bus'}"}
        tables["storage"] = {"path": str(folder / "store.db")}
        found = doctor("--config", written(folder, parsed(tables, "the test")))
    assert (found["first"], found["stops"]) == ("router", ["router"])
    fine = {check["name"] for check in found["checks"] if check["status"] == "fine"}
    assert {"encoder-device", "camera-device", "store", "disk"} <= fine
    assert not (folder / "store.db").exists()  # it changes nothing


def test_a_port_that_is_missing_comes_before_the_router(folder: Path, doctor: Doctor) -> None:
    tables = settings(folder / "tty", pictures(folder / "images"))
    tables["bus"] = {"endpoint": f"unixsock-stream/{folder / 'bus'}"}
    found = doctor("--config", written(folder, parsed(tables, "the test")))
    assert found["first"] == "encoder-device"


def test_a_push_is_heard_on_the_bus(folder: Path) -> None:
    """Straight on, a rest, a turn: as fast as a bus brings all of it, for a push goes by the stamps."""
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"}}, "the test")
    stages: list[Stage] = []
    with Router(config), Bus(config, "bridge", "front") as bridge:

        def push() -> None:
            bridge.await_presence(lambda: "doctor" in dict(bridge.present()), DEADLINE_S)
            for message in messages(left=-1.0):
                bridge.publish(TICKS if isinstance(message, Ticks) else BEARINGS, message)
                bridge.wait_stopped(0.002)

        person = threading.Thread(target=push)
        person.start()
        watch = Push(config)
        robot = Robot(config, "robot.json", is_local=True)
        pushed = live(robot, DEADLINE_S, watch, lambda stage, _: stages.append(stage or Stage.DONE)).pushed
        person.join()
    assert list(dict.fromkeys(stages)) == [Stage.STRAIGHT, Stage.TURN]
    assert pushed is not None
    assert pushed.turn is not None
    assert (pushed.straight.right_m, pushed.straight.left_m) == pytest.approx((1.0, -1.0), abs=0.01)
    assert pushed.turn.picture_rad == pytest.approx(1.5, abs=0.02)


def test_nobody_waits_for_a_push_when_the_wheels_counts_have_ended(folder: Path) -> None:
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"}}, "the test")
    robot = Robot(config, "robot.json", is_local=True)
    with Router(config), Bus(config, "bridge", "front") as bridge:

        def leave() -> None:
            bridge.await_presence(lambda: "doctor" in dict(bridge.present()), DEADLINE_S)
            bridge.publish(TICKS, Ticks(1, 0, 0))

        person = threading.Thread(target=leave)
        person.start()
        heard = live(robot, 100.0 * NO_COUNTS_S, Push(config), lambda stage, _: None)
        person.join()
    assert heard.pushed is None
    assert NO_COUNTS_S < heard.bus.seconds < 10.0 * NO_COUNTS_S


def test_two_that_publish_one_stream_at_once_are_seen_also_without_a_name(folder: Path, doctor: Doctor) -> None:
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"}}, "the test")
    file, others = written(folder, config), ("vision", "calibration", "storage")
    with Router(config), ExitStack() as stack:
        for name in others:
            stack.enter_context(Bus(config, name, "front")).ready()
        first, second = (stack.enter_context(Bus(config, name, "front")) for name in ("bridge", "stranger"))
        stop = threading.Event()

        def both() -> None:
            for number in count():
                if stop.wait(0.02):
                    return
                (first, second)[number % 2].publish(TICKS, Ticks(time.monotonic_ns(), number, number))

        talk = threading.Thread(target=both)
        talk.start()
        found = doctor("--config", file, "--seconds", "1")
        stop.set()
        talk.join()
    assert found["first"] == "publishers"
    assert "2 processes publish the encoder's stream" in str(found["checks"])


def test_a_service_that_is_there_and_silent_is_frozen(folder: Path, doctor: Doctor) -> None:
    """Its token is there, its health is not."""
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{folder / 'bus'}"}}, "the test")
    file = written(folder, config)
    others = ("player", "calibration", "storage")
    with Router(config), ExitStack() as stack:
        for name in (*others, "vision"):
            bus = stack.enter_context(Bus(load(file), name, "front"))
            bus.ready()
            if name == "vision":
                bus._publish_health = lambda: None  # type: ignore[method-assign]
        found = doctor("--config", file, "--seconds", "2.2")
    assert found["first"] == "services"
    assert "vision silent for 2 s" in str(found["checks"])
