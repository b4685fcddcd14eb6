"""`omnivert demo`: the packaged recording through the real services, with the truth beside the result."""

import json
import math
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import results, say
from omnivert.cli.demo_watch import Heard, watched
from omnivert.cli.outputs import check_outputs, made_folder
from omnivert.cli.settings import PACKAGED, JsonOption, opened, recording_path
from omnivert.config import Config, parsed
from omnivert.errors import DataError, UseError
from omnivert.messages import Extrinsics, Frame
from omnivert.pictures.words import word

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording

SERVICES = ("router", "vision", "calibration", "storage")


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the result.")] = Path("omnivert-demo"),
    speed: Annotated[float, typer.Option(min=0.0, help="1 is as recorded; 0 is as fast as the results come.")] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """See it work: a recorded drive through the real services, no camera and no robot needed."""
    began = time.monotonic()
    if not math.isfinite(speed):
        raise UseError("OV205", f"omnivert demo: --speed {speed}", "0 is as fast as the results come", "--speed 0")
    source = opened(PACKAGED)
    truth = results.truth_of(source)
    store, picture = made_folder(output) / "extrinsics.db", output / "result.png"
    check_outputs({"recording": source.path}, {"the store": store, "the picture": picture})
    say.story("[bold]omnivert demo[/]: a robot drives through a corridor; the camera's true place is known.\n")
    with tempfile.TemporaryDirectory(prefix="omnivert-", dir=_short_folder()) as private:
        config = demo_config(source, Path(private), store)
        heard, stored = played(source, config, Path(private), speed, began)
    _draw(picture, source, config, heard, truth)
    _tell(stored, truth, store, picture, as_json, time.monotonic() - began, heard)


def demo_config(source: "Recording", private: Path, store: Path) -> Config:
    """The recording's rig, a private socket, and a store of its own."""
    given = source.config(Config()).model_dump(mode="json")
    given["bus"]["endpoint"] = f"unixsock-stream/{private}/bus.sock"
    given["storage"]["path"] = str(store.resolve())
    given["calibration"]["resume"] = False  # each time from nothing, as the first time
    return parsed(given, "the demo")


def played(
    source: "Recording", config: Config, private: Path, speed: float, began: float
) -> tuple[Heard, Extrinsics | None]:
    """Start the services, play the recording through them, and ask the storage what it holds then."""
    from omnivert.cli.supervisor import Supervisor
    from omnivert.cli.troubles import START_S, Troubles, await_services
    from omnivert.wire import channels
    from omnivert.wire.bus import Bus

    file = private / "demo.json"
    file.write_text(json.dumps(config.model_dump(mode="json")), encoding="utf-8")
    stamps = [message.stamp_ns for _, message in source.messages(types=(Frame,))]
    heard = Heard(total_frames=len(stamps), end_ns=stamps[-1])
    troubles = Troubles()
    with Supervisor(file, troubles) as supervisor:
        for service in SERVICES:
            supervisor.start(service)
        with Bus(config, "demo", "demo", patience_s=START_S) as bus:
            await_services(bus, {"vision", "calibration", "storage"}, troubles)
            up_s = time.monotonic() - began
            say.story(f"  [green]✓[/] services   {', '.join(SERVICES)} up in {up_s:.1f} s  (a private socket)")
            pace = "as fast as the results come" if speed == 0 else f"{speed:g} x"
            seconds = 1e-9 * (stamps[-1] - stamps[0])
            say.story(f"  [cyan]▶[/] playing    {PACKAGED}, {len(stamps)} frames of {seconds:.0f} s, {pace}")
            supervisor.start("player", "--recording", str(recording_path(PACKAGED)), "--speed", f"{speed:g}")
            watched(bus, heard, say.err(), source.start_ns, troubles)
            if bus.stopped:
                raise KeyboardInterrupt
            answer = bus.ask(channels.EXTRINSICS, timeout_s=3.0)
    return heard, answer if isinstance(answer, Extrinsics) else None


def _tell(
    stored: Extrinsics | None,
    truth: results.Truth | None,
    store: Path,
    picture: Path,
    as_json: bool,
    seconds: float,
    heard: Heard,
) -> None:
    if stored is None:
        because = "; ".join(heard.estimates[-1].reasons) if heard.estimates else "no estimate came"
        raise DataError("OV421", "the storage service holds nothing", because, "omnivert calibrate corridor")
    if as_json:
        say.json_result(
            {
                **results.mount_json(stored.mount),
                "verdict": stored.state.value,
                "frames": stored.frames,
                "entry": None if heard.receipt is None else heard.receipt.entry,
                "store": str(store),
                "picture": str(picture),
                "seconds": round(seconds, 2),
                **results.truth_json(stored.mount, truth),
            }
        )
        return
    say.result(f"  stored   {word(stored.state)}, from {stored.frames} frames")
    for row in results.rows(stored.mount, ("", "", ""), truth):
        say.result(f"    {row}")
    entry = "" if heard.receipt is None else f" (#{heard.receipt.entry})"
    say.result("")
    say.result(f"  Stored in   {store}{entry}")
    say.result(f"  Picture     {picture}")
    say.story(f"  Took        {seconds:.1f} s")
    say.story(f"  Next        what is stored:  omnivert extrinsics show --store {store}")
    say.story("              your robot:      omnivert config > robot.toml, then omnivert up --config robot.toml")
    say.story("              your recording:  omnivert import frames DIR -o d.mcap && omnivert calibrate d.mcap")


def _draw(picture: Path, source: "Recording", config: Config, heard: Heard, truth: results.Truth | None) -> None:
    from omnivert.cli.drawn import drawn_frame
    from omnivert.pictures.result import write_result

    last = None
    for _, message in source.messages(types=(Frame,)):
        last = message
    drawn = None
    if isinstance(last, Frame) and heard.last_bearings is not None:
        drawn = drawn_frame(last, heard.last_bearings, config)
    if heard.estimates:
        write_result(picture, heard.estimates, config.robot.id, config.robot.wheel_base_m, drawn, truth)


def _short_folder() -> str:
    """Where a socket's path stays below what the system allows, about 100 characters."""
    usual = tempfile.gettempdir()
    return usual if len(usual) < 60 else "/tmp"
