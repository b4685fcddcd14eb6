"""`omnivert record OUT.mcap`: write down all that a running system says."""

import os
from pathlib import Path
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, RobotOption, settings
from omnivert.errors import UseError


def record(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="Recording to write; must not exist yet.")],
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
) -> None:
    """Record a running system until ctrl-c; what is written stays readable even when this is killed."""
    from omnivert.wire.bus import Bus
    from services.recorder import run

    if output.exists():
        raise UseError("OV208", f"{output} exists already", "a recording is never overwritten", "choose another name")
    chosen = settings(config, robot, connect)
    with Bus(chosen, "recorder", f"r{os.getpid()}", patience_s=PATIENCE_S) as bus:
        say.story(f"recording robot {chosen.robot.id} to {output}; ctrl-c ends it")
        run(bus, chosen, output)
    say.story(f"saved   {output}  {output.stat().st_size / 1e6:.1f} MB")
