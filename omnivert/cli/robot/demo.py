"""`omnivert demo`: a recorded or a simulated drive through the real services, with the truth beside the result."""

import json
import math
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.offline import results
from omnivert.cli.offline.simulate import PATH, WORLD, PathOption, WorldOption, staged
from omnivert.cli.outputs import check_outputs, made_folder
from omnivert.cli.robot.demo_watch import Heard, await_frame, watched
from omnivert.cli.settings import PACKAGED, JsonOption, opened, recording_path
from omnivert.config import Config, parsed
from omnivert.errors import DataError, UseError
from omnivert.messages import Extrinsics, Frame
from omnivert.pictures.words import word

if TYPE_CHECKING:
    from omnivert.cli.robot.supervisor import Supervisor
    from omnivert.cli.robot.troubles import Troubles
    from omnivert.simulation.trip import Trip
    from omnivert.wire.bus import Bus
    from omnivert.wire.recording import Recording

SIMULATED_HZ = 5.0  # pictures a second: enough for a robot that drives 0.15 m/s
SERVICES = ("router", "vision", "calibration", "storage")


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the result.")] = Path("omnivert-demo"),
    speed: Annotated[float, typer.Option(min=0.0, help="1 is as recorded; 0 is as fast as the results come.")] = 0.0,
    sim: Annotated[bool, typer.Option("--sim", help="A simulated robot, live, in place of the recording.")] = False,
    world: WorldOption = WORLD,
    path: PathOption = PATH,
    as_json: JsonOption = False,
) -> None:
    """See it work: a recorded drive through the real services, no camera and no robot needed.

    --world and --path are of --sim.
    """
    began = time.monotonic()
    if not math.isfinite(speed):
        raise UseError("OV205", f"omnivert demo: --speed {speed}", "0 is as fast as the results come", "--speed 0")
    if sim:
        _demo_simulated(output, speed, world, path, as_json, began)
        return
    source = opened(PACKAGED)
    truth = results.truth_of(source)
    store, picture = made_folder(output) / "extrinsics.db", output / "result.png"
    check_outputs({"recording": source.path}, {"the store": store, "the picture": picture})
    say.story("[bold]omnivert demo[/]: a robot drives through a corridor; the camera's place is known.\n")
    with tempfile.TemporaryDirectory(prefix="omnivert-", dir=_short_folder()) as private:
        config = demo_config(source.config(Config()), Path(private), store)
        heard, stored = played(source, config, Path(private), speed, began)
    _draw(picture, _last_frame(source), config, heard, truth)
    _tell(stored, truth, store, picture, as_json, time.monotonic() - began, heard)


def _demo_simulated(output: Path, speed: float, world: str, path: str, as_json: bool, began: float) -> None:
    """The same with a robot that drives now."""
    from omnivert.simulation.route import Route
    from omnivert.simulation.toml_file import loaded
    from omnivert.simulation.trip import Trip

    if speed != 0.0:
        what, because = f"omnivert demo --sim: --speed {speed:g}", "a simulated robot drives at its own pace"
        raise UseError("OV205", what, because, "omnivert demo --sim")
    rig = parsed({"camera": {"frame_rate_hz": SIMULATED_HZ}}, "the demo")
    stage = staged(rig, world, 1, None, None)
    trip = Trip(stage, loaded(path, "paths", Route), rig.encoder.noise_k_m)  # before anything starts: does it fit?
    store, picture = made_folder(output) / "extrinsics.db", output / "result.png"
    check_outputs({}, {"the store": store, "the picture": picture})
    say.story(
        f"[bold]omnivert demo[/]: a simulated robot drives for {trip.seconds:.0f} s; the camera's place is known.\n"
    )
    with tempfile.TemporaryDirectory(prefix="omnivert-", dir=_short_folder()) as private:
        config = demo_config(rig, Path(private), store)
        heard, stored = driven(config, Path(private), world, path, trip, began)
    _draw(picture, heard.last_frame, config, heard, stage.mount)
    _tell(stored, stage.mount, store, picture, as_json, time.monotonic() - began, heard)


def demo_config(rig: Config, private: Path, store: Path) -> Config:
    """The drive's rig, a private socket, and a store of its own."""
    given = rig.model_dump(mode="json")
    given["bus"]["endpoint"] = f"unixsock-stream/{private}/bus.sock"
    given["storage"]["path"] = str(store.resolve())
    given["calibration"]["resume"] = False  # each time from nothing, as the first time
    return parsed(given, "the demo")


def played(
    source: "Recording", config: Config, private: Path, speed: float, began: float
) -> tuple[Heard, Extrinsics | None]:
    """Start the services, play the recording through them, and ask the storage what it holds then."""
    stamps = [message.stamp_ns for _, message in source.messages(types=(Frame,))]
    heard = Heard(total_frames=len(stamps), end_ns=stamps[-1])
    with _services(config, private, began) as (supervisor, bus, troubles):
        pace = "as fast as the results come" if speed == 0 else f"{speed:g} x"
        seconds = 1e-9 * (stamps[-1] - stamps[0])
        say.story(f"  [cyan]▶[/] playing    {PACKAGED}, {len(stamps)} frames of {seconds:.0f} s, {pace}")
        supervisor.start("player", "--recording", str(recording_path(PACKAGED)), "--speed", f"{speed:g}")
        watched(bus, heard, say.err(), source.start_ns, troubles)
        return heard, _stored(bus)


def driven(
    config: Config, private: Path, world: str, path: str, trip: "Trip", began: float
) -> tuple[Heard, Extrinsics | None]:
    """Start the services, let the simulated robot drive its path, and ask the storage what it holds then."""
    heard = Heard(total_frames=trip.frames, end_ns=0)
    with _services(config, private, began) as (supervisor, bus, troubles):
        say.story(f"  [cyan]▶[/] driving    {path} in {world}, {SIMULATED_HZ:g} pictures a second")
        options = ("--world", world, "--path", path, "--exit-when-done", "--wait-for", ",".join(SERVICES[1:]))
        supervisor.start("simulator", *options)
        start_ns = await_frame(bus, troubles)
        watched(bus, heard, say.err(), start_ns, troubles, "driving", lambda: supervisor.wait("simulator", 0.0))
        return heard, _stored(bus)


@contextmanager
def _services(config: Config, private: Path, began: float) -> Iterator[tuple["Supervisor", "Bus", "Troubles"]]:
    """The services, up and at work."""
    from omnivert.cli.robot.supervisor import Supervisor
    from omnivert.cli.robot.troubles import START_S, Troubles, await_services
    from omnivert.wire.bus import Bus

    file = private / "demo.json"
    file.write_text(json.dumps(config.model_dump(mode="json")), encoding="utf-8")
    troubles = Troubles()
    with Supervisor(file, troubles) as supervisor:
        for service in SERVICES:
            supervisor.start(service)
        with Bus(config, "demo", "demo", patience_s=START_S) as bus:
            await_services(bus, set(SERVICES[1:]), troubles)
            up_s = time.monotonic() - began
            say.story(f"  [green]✓[/] services   {', '.join(SERVICES)} up in {up_s:.1f} s  (a private socket)")
            yield supervisor, bus, troubles


def _stored(bus: "Bus") -> Extrinsics | None:
    from omnivert.wire.channels import EXTRINSICS

    if bus.stopped:
        raise KeyboardInterrupt
    answer = bus.ask(EXTRINSICS, timeout_s=3.0)
    return answer if isinstance(answer, Extrinsics) else None


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
        raise DataError("OV421", "the storage service holds nothing", heard.why(), "omnivert calibrate corridor")
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
    say.story(f"  Next        what is stored:  omnivert extrinsics show --store {escape(quote(str(store)))}")
    say.story("              your robot:      omnivert config > robot.toml, then omnivert up --config robot.toml")
    say.story("              your recording:  omnivert import frames DIR -o d.mcap && omnivert calibrate d.mcap")


def _last_frame(source: "Recording") -> Frame | None:
    last = None
    for _, message in source.messages(types=(Frame,)):
        last = message
    return last if isinstance(last, Frame) else None


def _draw(picture: Path, last: Frame | None, config: Config, heard: Heard, truth: results.Truth | None) -> None:
    from omnivert.cli.offline.drawn import drawn_frame
    from omnivert.pictures.result import write_result

    drawn = None
    if last is not None and heard.last_bearings is not None and last.stamp_ns == heard.last_bearings.stamp_ns:
        drawn = drawn_frame(last, heard.last_bearings, config)
    if heard.estimates:
        write_result(picture, heard.estimates, config.robot.id, config.robot.wheel_base_m, drawn, truth)


def _short_folder() -> str:
    """Where a socket's path stays below what the system allows, about 100 characters."""
    usual = tempfile.gettempdir()
    return usual if len(usual) < 60 else "/tmp"
