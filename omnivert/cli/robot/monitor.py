"""`omnivert monitor`: watch a running system, from the robot or from another machine."""

import os
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, JsonOption, RobotOption
from omnivert.cli.whom import meant


def monitor(
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    once: Annotated[bool, typer.Option("--once", help="Print one screen after two seconds and stop.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Watch a robot: the estimates with their sigmas, what to drive next, every service's health.

    Without --config and --robot it is the one that is there.
    """
    from omnivert.wire.bus import Bus
    from services.monitor import run

    chosen = meant(config, robot, connect, "monitor")
    with Bus(chosen, "monitor", f"m{os.getpid()}", patience_s=PATIENCE_S) as bus:
        run(bus, chosen, once, say.json_result if as_json else None, rate_known=config is not None)
