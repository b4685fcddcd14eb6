"""`omnivert up`: every service of a robot, looked after; with a recording in place of the robot, if asked for."""

import json
import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.given import count
from omnivert.cli.offline.simulate import check_names
from omnivert.cli.outputs import check_distinct, check_new_recording
from omnivert.cli.recordings.followed import followed_from_outside
from omnivert.cli.robot.kept import Before
from omnivert.cli.settings import opened, recording_path, rig_of, settings, title
from omnivert.config import Config
from omnivert.errors import UseError
from omnivert.wire.channels import BEARINGS, FRAME

if TYPE_CHECKING:
    from omnivert.cli.robot.readiness import Readiness
    from omnivert.cli.robot.supervisor import Event

SERVICES = ("router", "bridge", "vision", "calibration", "storage")
CONSUMERS = "vision,calibration,storage"  # the player waits for them


def up(
    config: Annotated[Path | None, typer.Option("--config", "-c", help="TOML file of the robot.")] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Record everything into this file.")] = None,
    play: Annotated[
        str | None, typer.Option("--play", metavar="REC", help="Play this recording in place of the bridge.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Of --play: 1 is as recorded; 0 is as fast as the results come.", min=0.0)
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Of --play: begin again at the end.")] = False,
    sim: Annotated[
        str | None, typer.Option("--sim", metavar="WORLD", help="A simulated robot in place of the bridge.")
    ] = None,
    path: Annotated[
        str | None, typer.Option("--path", help="Of --sim: drive this path; else it waits for omnivert drive.")
    ] = None,
) -> None:
    """Start router, bridge, vision, calibration and storage; restart what dies; ctrl-c stops all."""
    from omnivert.cli.robot.readiness import watched
    from omnivert.cli.robot.supervisor import Happened, Supervisor
    from omnivert.cli.robot.troubles import Troubles

    _check(config, record, play, sim, speed, loop)
    _check_simulated(sim, path, play)
    troubles, readiness = Troubles(loud=True), _needed(record, play, sim)

    def report(event: "Event") -> None:
        troubles(event)
        if event.service == "player" and event.happened is Happened.ENDED:
            say.story("the playback has ended; omnivert extrinsics show tells what is stored, ctrl-c stops all")
            readiness.is_over = True

    with _file(config, play, sim) as file:
        chosen = settings(file)
        before = Before.of(chosen)
        inputs = {"configuration": config, "recording": None if play is None else recording_path(play)}
        check_distinct(inputs, {"--record": record, "storage.path": chosen.storage.path})
        of_config = "" if config is None else f" --config {quote(str(config))}"
        _tell(chosen, record, play, sim, of_config)
        following = "drive" if sim is not None and path is None else "monitor"
        try:
            with Supervisor(file, report) as supervisor:
                for service in SERVICES:
                    if service == "bridge" and play is not None:
                        pace = () if speed is None else ("--speed", f"{speed!r}")
                        again = ("--loop",) if loop else ()
                        rec = str(recording_path(play))
                        supervisor.start("player", "--recording", rec, "--wait-for", CONSUMERS, *pace, *again)
                    elif service == "bridge" and sim is not None:
                        way = () if path is None else ("--path", path)
                        supervisor.start("simulator", "--world", sim, "--wait-for", CONSUMERS, *way)
                    else:
                        supervisor.start(service)
                if record is not None:
                    supervisor.start("recorder", "--output", str(record))
                following_up = followed_from_outside(chosen) if play is not None else nullcontext()
                with following_up, watched(chosen, readiness, f"omnivert {following}{of_config}"):
                    while not troubles.fatal.wait(0.2):
                        pass
        except KeyboardInterrupt:
            pass
    troubles.check()
    saved = f"; recording in {_files(record, chosen)}" if record is not None else ""
    say.story(f"stopped; {escape(before.told(chosen, troubles.unresolved('storage')))}{saved}")


def _needed(record: Path | None, play: str | None, sim: str | None) -> "Readiness":
    """Who has to be there, and what gives the sensors' data."""
    from omnivert.cli.robot.readiness import Readiness

    source, words = "bridge", "bridge"
    if play is not None:
        source, words = "player", "the playback"
    elif sim is not None:
        words = "the simulated robot"
    services = [source if name == "bridge" else name for name in SERVICES]
    return Readiness((*services, *(("recorder",) if record is not None else ())), words)


def _files(record: Path, config: Config) -> str:
    """Where the recorder has written: with a limit into files with numbers."""
    from services._parts import is_split

    return f"{record.with_name(f'{record.stem}-001{record.suffix}')} and on" if is_split(config) else str(record)


def _check(
    config: Path | None, record: Path | None, play: str | None, sim: str | None, speed: float | None, loop: bool
) -> None:
    """raises UseError when these options do not go together"""
    if config is None and play is None and sim is None:
        because = "camera, encoder and wheels differ from robot to robot"
        raise UseError("OV209", "omnivert up needs --config", because, "omnivert config > robot.toml")
    if play is None and (speed is not None or loop):
        what = "omnivert up: --speed and --loop are of a playback"
        raise UseError("OV205", what, "without --play the robot itself is heard", "omnivert up --play REC --loop")
    if speed is not None and not math.isfinite(speed):
        raise UseError("OV205", f"omnivert up: --speed {speed}", "0 is as fast as the results come", "--speed 0")
    if record is not None:
        check_new_recording(record)


def _check_simulated(sim: str | None, path: str | None, play: str | None) -> None:
    """raises UseError when these options do not go together, or name nothing that there is"""
    if sim is None:
        if path is not None:
            raise UseError("OV205", "omnivert up: --path is of a simulated robot", help="omnivert up --sim office")
        return
    if play is not None:
        what = "omnivert up: --sim and --play exclude each other"
        raise UseError("OV205", what, "either takes the robot's place", "leave one of them out")
    check_names(sim, path)


@contextmanager
def _file(config: Path | None, play: str | None, sim: str | None = None) -> Iterator[Path]:
    """The configuration that the services are started with; without one it is that of the recording's rig.

    Bearings of another sensor come with wheels of their own, which no configuration of a robot describes: the rig is
    the recording's then, too, under the names of the configuration. What is simulated has a store of its own.
    """
    source = opened(play, quick=True) if play is not None else None
    rig = _simulated(settings(config)) if sim is not None else None
    if source is not None and config is None:
        rig = source.config(Config())
    elif source is not None and not count(source, FRAME) and count(source, BEARINGS):
        from services.player import named_alike

        chosen = settings(config)
        with_its_names = named_alike(chosen, source.config(chosen))  # other names are none of what is not used
        rig = named_alike(rig_of(source, with_its_names), chosen)
    if rig is not None:
        with tempfile.TemporaryDirectory(prefix="omnivert-") as folder:
            path = Path(folder) / "robot.json"
            path.write_text(json.dumps(rig.model_dump(mode="json")), encoding="utf-8")
            yield path
    elif config is not None:
        yield config


def _simulated(config: Config) -> Config:
    """The same with a store of its own: nothing that the real robot stored is superseded by a robot that is none."""
    path = config.storage.path
    path = path.with_name(f"{path.stem}-sim{path.suffix}")
    return config.model_copy(update={"storage": config.storage.model_copy(update={"path": path})})


def _tell(config: Config, record: Path | None, play: str | None, sim: str | None, of_config: str) -> None:
    """What is about to run.

    of_config  the option by which other commands find it
    """
    from services.router import is_local

    robot, camera, encoder = config.robot, config.camera, config.encoder
    say.story(f"[bold]omnivert up[/]: robot {robot.id}")
    for endpoint in (config.bus.endpoint, *config.bus.listen):
        who = "this machine only" if is_local(endpoint) else "[yellow]open to the network, without a password[/]"
        say.story(f"  listens   {endpoint}   ({who})")
    if play is not None:
        say.story(f"  plays     {escape(title(play))}, in place of the robot")
    elif sim is not None:
        say.story(f"  simulates a robot in {escape(title(sim))}; steer it with: {escape(f'omnivert drive{of_config}')}")
    else:
        say.story(f"  camera    {camera.id}: {camera.source}, {camera.width_px} x {camera.height_px}")
        say.story(f"  encoder   {encoder.id}: {encoder.port}, {encoder.baud} baud")
    told = f"   (omnivert extrinsics show --store {quote(str(config.storage.path))})" if sim is not None else ""
    say.story(f"  store     {escape(f'{config.storage.path}{told}')}")
    if record is not None:
        say.story(f"  records   {record}")
    say.story(f"  watch     {escape(f'omnivert monitor{of_config}')}     ctrl-c stops all\n")
