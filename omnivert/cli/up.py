"""`omnivert up`: every service of a robot, looked after."""

from pathlib import Path
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.settings import settings
from omnivert.config import Config
from omnivert.errors import UseError

SERVICES = ("router", "bridge", "vision", "calibration", "storage")


def up(
    config: Annotated[Path | None, typer.Option("--config", "-c", help="TOML file of the robot.")] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Record everything into this file.")] = None,
) -> None:
    """Start router, bridge, vision, calibration and storage; restart what dies; ctrl-c stops all."""
    from omnivert.cli.supervisor import Supervisor
    from omnivert.cli.troubles import Troubles

    if config is None:
        because = "camera, encoder and wheels differ from robot to robot"
        raise UseError("OV209", "omnivert up needs --config", because, "omnivert config > robot.toml")
    if record is not None and record.exists():
        raise UseError("OV208", f"{record} exists already", "a recording is never overwritten", "choose another name")
    chosen = settings(config)
    _tell(chosen, record)
    troubles = Troubles(loud=True)
    try:
        with Supervisor(config, troubles) as supervisor:
            for service in SERVICES:
                supervisor.start(service)
            if record is not None:
                supervisor.start("recorder", "--output", str(record))
            while not troubles.fatal.wait(0.2):
                pass
    except KeyboardInterrupt:
        pass
    troubles.check()
    saved = f"; recording in {record}" if record is not None else ""
    say.story(f"stopped; extrinsics in {chosen.storage.path}{saved}")


def _tell(config: Config, record: Path | None) -> None:
    from services.router import is_local

    robot, camera, encoder = config.robot, config.camera, config.encoder
    say.story(f"[bold]omnivert up[/]: robot {robot.id}")
    for endpoint in (config.bus.endpoint, *config.bus.listen):
        who = "this machine only" if is_local(endpoint) else "[yellow]open to the network, without a password[/]"
        say.story(f"  listens   {endpoint}   ({who})")
    say.story(f"  camera    {camera.id}: {camera.source}, {camera.width_px} x {camera.height_px}")
    say.story(f"  encoder   {encoder.id}: {encoder.port}, {encoder.baud} baud")
    say.story(f"  store     {config.storage.path}")
    if record is not None:
        say.story(f"  records   {record}")
    say.story("  watch     omnivert monitor     ctrl-c stops all\n")
