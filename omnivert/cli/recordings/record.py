"""`omnivert record OUT.mcap`: write down all that a running system says."""

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, JsonOption, RobotOption, with_recorder
from omnivert.cli.whom import meant
from omnivert.errors import DataError, UseError
from omnivert.pictures.words import amounts

if TYPE_CHECKING:
    from services.recorder import Recorded


def record(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="Recording to write; must not exist yet.")],
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    split_mb: Annotated[
        float | None, typer.Option(help="Begin the next file before one is larger; 10^6 bytes.", min=0.0)
    ] = None,
    split_s: Annotated[
        float | None, typer.Option(help="Begin the next file when the drive in one has lasted so long.", min=0.0)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Record a running system until ctrl-c; what is written stays readable even when this is killed.

    Without --config and --robot it is the robot that is there.

    With a split the files are OUT-001.mcap, OUT-002.mcap and so on; omnivert rec merge makes one of them.
    """
    from omnivert.wire.bus import Bus
    from services._parts import is_split, numbered
    from services.recorder import run

    check_new_recording(output)
    chosen = with_recorder(meant(config, robot, connect, f"record {output}"), split_mb, split_s)
    if is_split(chosen) and next(numbered(output)).stem != f"{output.stem}-001":
        because = "the files of a recording that is split carry numbers, and the first is there already"
        raise UseError("OV208", f"{output.stem}-001{output.suffix} exists already", because, "choose another name")
    began_s = time.monotonic()
    with Bus(chosen, "recorder", f"r{os.getpid()}", patience_s=PATIENCE_S) as bus, say.status() as now:
        say.story(f"recording robot {chosen.robot.id} to {escape(str(output))}; ctrl-c ends it")
        recorded = run(bus, chosen, output, lambda so_far: now(_status(so_far, time.monotonic() - began_s)))
    if not recorded.messages:
        for path in recorded.paths:
            path.unlink(missing_ok=True)
        lasted_s = time.monotonic() - began_s
        because = f"no sensor and no result of robot {chosen.robot.id} was heard in {lasted_s:.0f} s"
        raise DataError("OV308", "nothing was recorded", because, "omnivert monitor   # shows who is there")
    kinds = amounts(dict(sorted(recorded.messages.items())))
    names = f"{recorded.paths[0]}" + (f" to {recorded.paths[-1].name}" if len(recorded.paths) > 1 else "")
    say.story(f"saved   {names}  {recorded.bytes / 1e6:.1f} MB · {kinds}")
    if recorded.lost:
        say.story(f"[yellow]lost[/]    {recorded.lost} messages: the disk or the link was too slow for them")
    if as_json:
        body = {
            "recording": str(recorded.paths[0]),
            "parts": [str(path) for path in recorded.paths],
            "robot": chosen.robot.id,
            "bytes": recorded.bytes,
            "messages": dict(recorded.messages),
            "lost": recorded.lost,
        }
        say.json_result(body)


def _status(so_far: "Recorded", seconds: float) -> str:
    parts = f" in {len(so_far.paths)} files" if len(so_far.paths) > 1 else ""
    lost = f" · {so_far.lost} lost" if so_far.lost else ""
    return f"{seconds:.0f} s · {so_far.bytes / 1e6:.1f} MB{parts} · {so_far.messages.total()} messages{lost}"
