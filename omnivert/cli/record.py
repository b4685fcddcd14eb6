"""`omnivert record OUT.mcap`: write down all that a running system says."""

import os
import time
from pathlib import Path
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, JsonOption, RobotOption
from omnivert.cli.whom import meant
from omnivert.errors import DataError


def record(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="Recording to write; must not exist yet.")],
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    as_json: JsonOption = False,
) -> None:
    """Record a running system until ctrl-c; what is written stays readable even when this is killed.

    Without --config and --robot it is the robot that is there.
    """
    from omnivert.wire.bus import Bus
    from services.recorder import run

    check_new_recording(output)
    chosen = meant(config, robot, connect, f"record {output}")
    began_s = time.monotonic()
    with Bus(chosen, "recorder", f"r{os.getpid()}", patience_s=PATIENCE_S) as bus:
        say.story(f"recording robot {chosen.robot.id} to {output}; ctrl-c ends it")
        written = run(bus, chosen, output)
    if not written:
        output.unlink(missing_ok=True)
        lasted_s = time.monotonic() - began_s
        because = f"no sensor and no result of robot {chosen.robot.id} was heard in {lasted_s:.0f} s"
        raise DataError("OV308", "nothing was recorded", because, "omnivert monitor   # shows who is there")
    kinds = ", ".join(f"{times} {kind}" for kind, times in sorted(written.items()))
    size = output.stat().st_size
    say.story(f"saved   {output}  {size / 1e6:.1f} MB: {kinds}")
    if as_json:
        body = {"recording": str(output), "robot": chosen.robot.id, "bytes": size, "messages": dict(written)}
        say.json_result(body)
