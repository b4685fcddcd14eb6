"""`omnivert play REC`: a recording into a running system, on the keys of the bridge."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.given import Given
from omnivert.cli.keys import RIGHT, keys
from omnivert.cli.recordings.followed import followed
from omnivert.cli.settings import (
    PATIENCE_S,
    ConfigOption,
    ConnectOption,
    JsonOption,
    RecordingArgument,
    RobotOption,
    opened,
    recording_path,
    settings,
    title,
    with_robot,
)
from omnivert.errors import UseError

if TYPE_CHECKING:
    from services._controls import Controls

LISTENER_S = 1.0  # for those who are here to be seen


def play(
    recording: RecordingArgument,
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    speed: Annotated[float, typer.Option(help="1 is as recorded; 0 is as fast as the results come.", min=0.0)] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end, until ctrl-c.")] = False,
    start: Annotated[float | None, typer.Option("--from", help="Second to begin at.", min=0.0)] = None,
    end: Annotated[float | None, typer.Option("--to", help="Second to end at.", min=0.0)] = None,
    info: Annotated[bool, typer.Option("--info", help="Say what the recording holds, and play nothing.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Play a recording in place of the bridge.

    On a terminal the space bar pauses it and lets it go on, n or the right arrow plays one frame, q ends it.
    """
    if not math.isfinite(speed):
        raise UseError("OV205", f"omnivert play: --speed {speed}", "0 is as fast as the results come", "--speed 0")
    for option, second in (("--from", start), ("--to", end)):
        if second is not None and not math.isfinite(second):
            help = "omnivert play REC --info   # shows how long it is"
            raise UseError("OV205", f"omnivert play: {option} {second}", "it is a second of the recording", help)
    source = opened(recording, quick=not (info or as_json))
    if info or as_json:
        given = Given.of(source)
        if as_json:
            say.json_result({"recording": title(recording), **given.json(), "messages": dict(source.counts)})
        else:
            say.result(f"{title(recording)}  {given}")
        if info:
            return
    from omnivert.wire.bus import Bus
    from services._controls import Controls
    from services._start import prepare
    from services.player import run

    prepare()
    controls = Controls()
    chosen = settings(config, robot, connect)
    if config is None:  # nobody says which rig runs here: it is the recording's
        chosen = with_robot(source.config(chosen), robot)
    path = recording_path(recording)
    with Bus(chosen, "player", chosen.camera.id, patience_s=PATIENCE_S) as bus, keys(_actions(controls)) as has_keys:
        ends = "space pauses, n or the right arrow steps, q ends it" if has_keys else "ctrl-c ends it"

        def begun(service: str) -> None:
            say.story(f"playing {escape(title(recording))} to robot {chosen.robot.id}; {ends}")
            if not bus.await_presence(lambda: bool(bus.incarnations(service)), LISTENER_S) and not bus.stopped:
                nobody = f"no {service} service of robot {chosen.robot.id} listens"
                say.story(f"[yellow]{nobody}[/]: omnivert monitor shows who is here")

        with followed(bus, lambda: "paused " if controls.paused else "playing"):
            played = run(
                bus, chosen, path, speed=speed, loop=loop, from_s=start, to_s=end, begun=begun, controls=controls
            )
    say.story(f"{played}")


def _actions(controls: "Controls") -> dict[bytes, Callable[[], None]]:
    steps = dict.fromkeys((b"n", RIGHT), controls.step)
    return {b" ": controls.pause_or_go, b"q": controls.end, **steps}
