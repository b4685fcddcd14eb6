"""Processes start, stop when told to, come back when they die, and none is left behind."""

import json
import os
import queue
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from omnivert.cli.robot.supervisor import Event, Happened, Supervisor
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Health, Ticks
from omnivert.wire.bus import Bus, Router
from omnivert.wire.channels import HEALTH, PLAYBACK, TICKS
from omnivert.wire.recording import Recording
from services.recorder import unused
from services.router import is_local
from tests.processes import own

DEADLINE_S = 30.0


@pytest.fixture
def file(config: Config, folder: Path) -> Path:
    path = folder / "config.json"
    path.write_text(json.dumps(config.model_dump(mode="json")), encoding="utf-8")
    return path


@contextmanager
def process(service: str, file: Path, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-P", "-m", f"services.{service}", "--config", str(file), "--supervised", *more]
    with own(subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)) as started:
        try:
            yield started
        finally:
            started.kill()


# ------------------------------------------------------------------ one process


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_service_that_still_connects_stops_when_told_to(file: Path, config: Config, number: int) -> None:
    with socket.socket(socket.AF_UNIX) as mute:  # takes the connection, and never says a word
        mute.settimeout(DEADLINE_S)
        mute.bind(config.bus.endpoint.partition("/")[2])
        mute.listen()
        with process("vision", file) as service:
            mute.accept()[0].close()
            service.send_signal(number)
            assert service.wait(DEADLINE_S) == 0


@pytest.mark.parametrize("stop", ["SIGTERM", "end of input"])
@pytest.mark.parametrize("service", ["calibration", "recorder"])
def test_a_service_at_work_stops_when_told_to(
    file: Path, config: Config, folder: Path, service: str, stop: str
) -> None:
    more = ("--output", str(folder / "a.mcap")) if service == "recorder" else ()
    with Router(config), Bus(config, "test", "test") as bus, process(service, file, *more) as started:
        assert bus.await_presence(lambda: (service, "front") in bus.present(), DEADLINE_S)
        if stop == "SIGTERM":
            started.terminate()
        else:
            assert started.stdin is not None
            started.stdin.close()
        assert started.wait(DEADLINE_S) == 0
        assert bus.await_presence(lambda: not bus.present(), DEADLINE_S)


def test_the_router_tells_its_health_and_that_it_is_here(file: Path, config: Config) -> None:
    with process("router", file) as started, Bus(config, "test", "test") as bus:
        heard = bus.listen(HEALTH)
        assert bus.await_presence(lambda: ("router", "front") in bus.present(), DEADLINE_S)
        (router,) = bus.incarnations("router")
        told = [r.message for r, _ in zip((r for r in heard if r and r.publisher == router), range(2), strict=False)]
        assert all(isinstance(health, Health) and health.service == "router" for health in told)
        started.terminate()
        assert started.wait(DEADLINE_S) == 0


@pytest.mark.parametrize("service", ["router", "storage", "calibration", "vision"])
def test_a_service_that_goes_on_after_ctrl_z_stops_when_told_to(file: Path, config: Config, service: str) -> None:
    """What comes right after that, the kernel gives to any of its threads: the main one has a signal to deal with."""
    with ExitStack() as others:
        if service != "router":
            others.enter_context(Router(config))
        started = others.enter_context(process(service, file))
        bus = others.enter_context(Bus(config, "test", "test"))
        assert bus.await_presence(lambda: (service, "front") in bus.present(), DEADLINE_S)
        started.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, started.pid, os.WSTOPPED)
        started.send_signal(signal.SIGCONT)
        started.send_signal(signal.SIGTERM)
        assert started.wait(DEADLINE_S) == 0


def test_a_wrong_configuration_is_refused_in_one_line(folder: Path) -> None:
    wrong = folder / "robot.toml"
    wrong.write_text("[robot]\nwheel_base_mm = 400\n", encoding="utf-8")
    with process("vision", wrong) as started:
        _, said = started.communicate(timeout=DEADLINE_S)
    assert started.returncode == 2
    assert said.count(b"\n") == 1
    assert b"OV203" in said
    assert b"wheel_base_m" in said


def test_a_playback_waits_in_vain_for_a_service_that_does_not_come(file: Path, config: Config, folder: Path) -> None:
    from services import player

    hasty = config.model_copy(update={"player": config.player.model_copy(update={"wait_s": 0.0})})
    recording = folder / "a.mcap"
    write_ticks(recording, config)
    with Router(config), Bus(hasty, "player", "front") as bus:
        with pytest.raises(DataError, match="vision has not come") as refused:
            player.run(bus, hasty, recording, wait_for=("vision",))
        assert refused.value.code == "OV404"


def test_a_player_stops_when_a_bridge_comes_and_the_bridge_waits_for_that(
    file: Path, config: Config, folder: Path
) -> None:
    recording = folder / "a.mcap"
    write_ticks(recording, config)
    with Router(config), Bus(config, "test", "test") as bus:
        told = bus.listen(PLAYBACK)
        with process("player", file, "--recording", str(recording), "--loop") as it:
            assert next(received for received in told if received is not None)
            with Bus(config, "bridge", "front") as bridge:
                bridge.refuse_beside("player", "bridge")
                assert not bridge.incarnations("player")
                _, said = it.communicate(timeout=DEADLINE_S)
        assert (it.returncode, b"error[OV402]" in said) == (2, True), said


def write_ticks(path: Path, config: Config) -> None:
    from omnivert.wire.recording import RecordingWriter

    with RecordingWriter(path, config) as writer:
        for i in range(10):
            writer.write(TICKS.key(config), Ticks(i, i, i))


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("unixsock-stream//run/bus", True),
        ("tcp/127.0.0.1:7447", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/192.168.1.5:7447", False),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/127.0.0.1.example.org:7447", False),
    ],
)
def test_the_router_knows_which_end_points_the_network_can_reach(endpoint: str, local: bool) -> None:
    assert is_local(endpoint) is local


# ------------------------------------------------------------------ recorder


def test_a_recording_is_readable_after_the_recorder_was_killed(file: Path, config: Config, folder: Path) -> None:
    path = folder / "a.mcap"
    with Router(config), Bus(config, "bridge", "front") as bus, process("recorder", file, "--output", str(path)) as it:
        assert bus.await_presence(lambda: ("recorder", "front") in bus.present(), DEADLINE_S)
        for i in range(500):
            bus.publish(TICKS, Ticks(i * 20_000_000, i, i))

        def on_disk() -> int:
            try:
                return Recording(path).counts[TICKS.key(config)]
            except DataError:
                return 0

        wait(lambda: on_disk() >= 450)  # a chunk is closed with each second of the stamps
        it.kill()
        it.wait()
        recording = Recording(path)
    assert recording.cut
    ticks = [m.left for _, m in recording.messages((Ticks,)) if isinstance(m, Ticks)]
    assert len(ticks) >= 450
    assert ticks == list(range(len(ticks)))


def wait(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < deadline


def test_a_recorder_that_comes_back_overwrites_nothing(folder: Path) -> None:
    names = []
    for _ in range(3):
        names.append(unused(folder / "a.mcap"))
        names[-1].touch()
    assert [name.name for name in names] == ["a.mcap", "a-2.mcap", "a-3.mcap"]


# ------------------------------------------------------------------ supervisor


class Events:
    """The supervisor's events, to be waited for."""

    def __init__(self) -> None:
        self._queue: queue.Queue[Event] = queue.Queue()
        self.all: list[Event] = []

    def __call__(self, event: Event) -> None:
        self._queue.put(event)

    def until(self, happened: Happened) -> Event:
        while True:
            event = self._queue.get(timeout=DEADLINE_S)
            self.all.append(event)
            if event.happened is happened:
                return event


def test_who_dies_is_started_again_and_all_are_stopped_at_the_end(file: Path) -> None:
    events = Events()
    with Supervisor(file, events) as supervisor:
        supervisor.start("router")
        events.until(Happened.SAID)
        first = supervisor.pid("router")
        assert first is not None
        os.kill(first, signal.SIGKILL)
        assert "SIGKILL" in str(events.until(Happened.DIED))
        events.until(Happened.SAID)
        second = supervisor.pid("router")
        assert second not in (None, first)
    assert supervisor.pid("router") is None
    assert supervisor.wait("router", 0.0)


def test_who_does_not_stop_is_killed(file: Path) -> None:
    events = Events()
    with Supervisor(file, events) as supervisor:
        supervisor.start("router")
        events.until(Happened.SAID)
        frozen = supervisor.pid("router")
        assert frozen is not None
        os.kill(frozen, signal.SIGSTOP)
    events.until(Happened.KILLED)
    assert supervisor.pid("router") is None


def test_who_is_used_wrongly_is_not_started_again(folder: Path) -> None:
    events = Events()
    with Supervisor(folder / "absent.toml", events) as supervisor:
        supervisor.start("router")
        refused = events.until(Happened.REFUSED)
        assert "OV201" in refused.text
        assert supervisor.wait("router", DEADLINE_S)
    with pytest.raises(ValueError, match="already"):
        supervisor.start("router")


def test_when_the_supervisor_is_killed_its_services_stop(file: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from omnivert.cli.robot.supervisor import Supervisor\n"
        "with Supervisor(Path(sys.argv[1]), lambda event: print(event, flush=True)) as supervisor:\n"
        "    supervisor.start('router'); supervisor.wait('router')\n"
    )
    with own(subprocess.Popen([sys.executable, "-c", program, str(file)], stdout=subprocess.PIPE)) as supervisor:
        assert supervisor.stdout is not None
        for line in supervisor.stdout:
            if b"listening" in line:
                break
        supervisor.kill()
        assert supervisor.stdout.read() is not None  # ends when the last process that holds it has ended


def test_sigterm_stops_the_supervisor_and_its_services(file: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from omnivert.cli.robot.supervisor import Supervisor\n"
        "with Supervisor(Path(sys.argv[1]), lambda event: print(event, flush=True)) as supervisor:\n"
        "    supervisor.start('router'); supervisor.wait_for_signal()\n"
    )
    with own(subprocess.Popen([sys.executable, "-c", program, str(file)], stdout=subprocess.PIPE)) as supervisor:
        assert supervisor.stdout is not None
        for line in supervisor.stdout:
            if b"listening" in line:
                break
        supervisor.terminate()
        rest = supervisor.stdout.read()
        assert supervisor.wait(DEADLINE_S) == 0
        assert b"killed" not in rest
