"""`omnivert extrinsics`: what the store holds, its history, and the forms that other software reads."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.offline import results
from omnivert.cli.outputs import check_outputs
from omnivert.cli.settings import ConfigOption, JsonOption, RobotOption, settings, with_camera
from omnivert.errors import DataError, UseError
from omnivert.formats.extrinsics_export import Form, body, exported, robot_from_camera
from omnivert.messages import State
from omnivert.pictures.words import quantities, word

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.store import Entry, Store

app = typer.Typer(help="What the store holds.")
HEADINGS = ("entry", "phi, deg", "rho, m", "psi, deg", "verdict", "saved, UTC")
StoreOption = Annotated[Path | None, typer.Option("--store", help="The SQLite file; else the configuration's.")]
CameraOption = Annotated[str | None, typer.Option("--camera", help="Camera to look at; else the configuration's.")]
EntryOption = Annotated[int | None, typer.Option("--entry", min=1, help="Number of the entry; else the latest.")]


@app.callback()
def root() -> None:
    """What the store holds: list, show, history, export."""


@app.command("list")
def list_all(config: ConfigOption = None, store: StoreOption = None, as_json: JsonOption = False) -> None:
    """The latest extrinsics of every robot and camera."""
    with _opened(config, store) as opened:
        entries = opened.newest()
    _table(entries, as_json)


@app.command("history")
def history(
    config: ConfigOption = None,
    robot: RobotOption = None,
    camera: CameraOption = None,
    store: StoreOption = None,
    as_json: JsonOption = False,
) -> None:
    """Every value that was stored for a camera, newest first."""
    with _opened(config, store) as opened:
        chosen = _whose(opened, config, robot, camera)
        entries = opened.history(chosen.robot.id, chosen.camera.id)
        if not entries:
            raise _nothing_for(f"robot {chosen.robot.id}, camera {chosen.camera.id}", opened)
    _table(entries, as_json)


@app.command("show")
def show(
    config: ConfigOption = None,
    robot: RobotOption = None,
    camera: CameraOption = None,
    entry: EntryOption = None,
    store: StoreOption = None,
    as_json: JsonOption = False,
) -> None:
    """One stored mount with all that belongs to it."""
    found = _found(config, robot, camera, entry, store)
    if as_json:
        say.json_result(body(found))
        return
    extrinsics = found.extrinsics
    x, y, yaw = robot_from_camera(extrinsics.mount)
    say.result(f"#{found.entry}  robot {extrinsics.robot}, camera {extrinsics.camera}  {word(extrinsics.state)}")
    for part in quantities(extrinsics.mount):
        say.result(f"  {part.name:<5} {part}")
    if text := results.together(extrinsics.mount):
        say.result(f"  phi + psi = {text}")
    say.result(f"  camera at x {x:.4f} m, y {y:.4f} m, heading {math.degrees(yaw):.3f} deg in the robot's frame")
    playback = " of a playback" if found.replayed else ""
    say.result(f"  from {extrinsics.frames} frames{playback}, saved {found.saved_at} by {extrinsics.software}")
    say.result(f"  for the rig {extrinsics.rig_digest}")
    for reason in extrinsics.reasons:
        for line in say.folded(f"  {reason}", 4):
            say.result(line)


@app.command("export")
def export(
    form: Annotated[Form, typer.Option("--format", "-f", help="json, yaml, urdf joint, or ros2 command line.")],
    config: ConfigOption = None,
    robot: RobotOption = None,
    camera: CameraOption = None,
    entry: EntryOption = None,
    store: StoreOption = None,
    parent: Annotated[str, typer.Option("--parent", help="Name of the robot's frame (urdf, ros2).")] = "base_link",
    z_m: Annotated[float, typer.Option("--z-m", help="Height of the camera; it is not estimated.")] = 0.0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File to write; else stdout.")] = None,
) -> None:
    """A stored mount as JSON, YAML, a URDF joint or a ROS 2 static transform."""
    if not math.isfinite(z_m):
        what = f"omnivert extrinsics export: --z-m {z_m}"
        raise UseError("OV205", what, "it is a height in metres", "--z-m 0.9")
    path = _path(config, store)
    files = {suffix: path.with_name(f"{path.name}{suffix}") for suffix in ("-wal", "-shm")}  # SQLite's own
    inputs = {"configuration": config, "store": path} | {f"store's {name}": file for name, file in files.items()}
    check_outputs(inputs, {"--output": output})
    found = _found(config, robot, camera, entry, store)
    if entry is None and found.extrinsics.state is State.MOVED:
        because = found.extrinsics.reasons[0] if found.extrinsics.reasons else "it was knocked"
        help = f"drive until it is calibrated anew, or --entry {found.entry} for the old place"
        raise DataError("OV608", f"the camera no longer sits where #{found.entry} says", because, help)
    text = exported(found, form, parent, z_m)
    if output is None:
        say.result(text)
        return
    try:
        output.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise DataError("OV322", f"cannot write {output}", str(error.strerror or error)) from error
    say.wrote(output)


@contextmanager
def _opened(config: Path | None, store: Path | None) -> Iterator["Store"]:
    from omnivert.store import Store

    path = _path(config, store)
    if path.is_dir():
        help = f"--store {path / 'extrinsics.db'}"
        raise UseError("OV602", f"the store {path} cannot be opened", "it is a folder", help)
    with Store(path, writable=False) as opened:
        yield opened


def _path(config: Path | None, store: Path | None) -> Path:
    return store or settings(config).storage.path


def _found(
    config: Path | None, robot: str | None, camera: str | None, number: int | None, store: Path | None
) -> "Entry":
    """The entry of that number, or the latest of the camera.

    raises  DataError when there is none
    """
    with _opened(config, store) as opened:
        chosen = _whose(opened, config, robot, camera)
        if number is not None:
            found = next((entry for entry in opened.entries() if entry.entry == number), None)
        else:
            found = opened.latest(chosen.robot.id, chosen.camera.id)
        if found is None:
            who = f"robot {chosen.robot.id}, camera {chosen.camera.id}"
            raise _nothing_for(who if number is None else f"entry {number}", opened)
    if config is not None and (changes := chosen.rig_changes(found.extrinsics.rig_digest)):
        text = f"#{found.entry} was stored for another rig than that of {config}: what differs is "
        say.story(f"[yellow]![/] {escape(text + '; '.join(changes))}")
    return found


def _whose(opened: "Store", config: Path | None, robot: str | None, camera: str | None) -> "Config":
    """The configuration with the robot and camera asked for; where nothing names them, the only ones in the store."""
    newest = opened.newest()
    if config is None and robot is None and camera is None and len(newest) == 1:
        only = newest[0].extrinsics
        robot, camera = only.robot, only.camera
    chosen = settings(config, robot)
    return chosen if camera is None else with_camera(chosen, camera)


def _nothing_for(wanted: str, opened: "Store") -> DataError:
    whom = [entry.extrinsics for entry in opened.newest()]
    because = f"it holds {', '.join(f'{e.robot}/{e.camera}' for e in whom)}" if whom else "it is empty"
    help = f"--robot {whom[0].robot} --camera {whom[0].camera}" if whom else "omnivert monitor"
    return DataError("OV607", f"nothing is stored for {wanted} in {opened.path}", because, help)


def _table(entries: list["Entry"], as_json: bool) -> None:
    if as_json:
        say.json_result({"entries": [body(entry) for entry in entries]})
        return
    if not entries:
        say.story("nothing is stored")
        return
    heading, *rows = results.aligned([HEADINGS, *map(_cells, entries)], apart=2)
    say.result(heading)
    whose = ""
    for entry, row in zip(entries, rows, strict=True):
        name = f"robot {entry.extrinsics.robot}, camera {entry.extrinsics.camera}"
        if name != whose:
            say.result(name)
        whose = name
        say.result(row)
    if played := [f"#{entry.entry}" for entry in entries if entry.replayed]:
        for line in say.folded(f"from playbacks, behind what the robot itself gave: {', '.join(played)}", 2):
            say.result(line)


def _cells(entry: "Entry") -> tuple[str, ...]:
    extrinsics = entry.extrinsics
    phi, rho, psi = (f"{part.value_text} ± {part.sigma_text}" for part in quantities(extrinsics.mount))
    saved = entry.saved_at[:16].replace("T", " ")
    return (f"#{entry.entry}", phi, rho, psi, word(extrinsics.state), saved)
