"""`omnivert play REC`: a recording into a running system, on the keys of the bridge."""

import threading
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.given import Given
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
from omnivert.messages import Playback

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus


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
    """Play a recording in place of the bridge."""
    source = opened(recording)
    if info or as_json:
        given = Given.of(source)
        if as_json:
            say.json_result({"recording": title(recording), **given.json(), "messages": dict(source.counts)})
        else:
            say.result(f"{title(recording)}  {given}")
        if info:
            return
    from omnivert.wire.bus import Bus
    from services.player import run

    chosen = settings(config, robot, connect)
    if config is None:  # nobody says which rig runs here: it is the recording's
        chosen = with_robot(source.config(chosen), robot)
    with Bus(chosen, "player", chosen.camera.id, patience_s=PATIENCE_S) as bus:
        say.story(f"playing {title(recording)} to robot {chosen.robot.id}; ctrl-c ends it")
        threading.Thread(target=_follow, args=(bus,), name="progress", daemon=True).start()
        run(bus, chosen, recording_path(recording), speed=speed, loop=loop, from_s=start, to_s=end)


def _follow(bus: "Bus") -> None:
    """A bar that moves with what this player says of itself."""
    from omnivert.wire.channels import PLAYBACK

    with say.progress("playing", None) as bar:
        for received in bus.listen(PLAYBACK, period_s=1.0):
            if received is not None and isinstance(received.message, Playback):
                bar.reach(received.message.played, received.message.total or None)
