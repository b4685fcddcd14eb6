"""Options that several commands share, and the settings that they lead to."""

import difflib
from importlib import resources
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.config import Config, load, parsed
from omnivert.errors import DataError, UseError

if TYPE_CHECKING:
    from omnivert.wire.recording import Recording

PACKAGED = "corridor"  # the recording that comes with omnivert
PATIENCE_S = 3.0  # how long a command looks for the router
LARGE_BYTES = 200_000_000  # of a recording: to look into every part of it takes longer than a moment
CORRIDOR = ("omnivert", "data", "corridor.mcap")

ConfigOption = Annotated[Path | None, typer.Option("--config", "-c", help="TOML file; defaults without it.")]
JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]
RecordingArgument = Annotated[str, typer.Argument(metavar="REC", help="An .mcap file, or the word corridor.")]
ModeOption = Annotated[
    str | None, typer.Option("--mode", help="default, or paper: extraction and filter as the paper prints them.")
]
RobotOption = Annotated[str | None, typer.Option("--robot", help="Robot to look at; else the configuration's.")]
ConnectOption = Annotated[
    str | None, typer.Option("--connect", help="End point of the router, such as tcp/192.168.1.5:7447.")
]


def settings(path: Path | None, robot: str | None = None, connect: str | None = None) -> Config:
    """The configuration of a file, or the defaults; with robot and end point of the command line in it."""
    config = with_robot(Config() if path is None else load(path), robot)
    return config if connect is None else _with(config, "bus", "--connect", endpoint=connect)


def with_robot(config: Config, robot: str | None) -> Config:
    """The configuration for the robot named on the command line, where one is."""
    return config if robot is None else _with(config, "robot", "--robot", id=robot)


def with_recorder(config: Config, split_mb: float | None, split_s: float | None) -> Config:
    """The configuration with the limits of a recording's parts that were given on the command line."""
    given = {"split_mb": split_mb, "split_s": split_s}
    chosen = {name: value for name, value in given.items() if value is not None}
    return _with(config, "recorder", "omnivert record", **chosen) if chosen else config


def with_camera(config: Config, camera: str) -> Config:
    """The configuration for the camera of this id."""
    return _with(config, "camera", "the bus", id=camera)


def _with(config: Config, table: str, option: str, **values: str | float) -> Config:
    """The configuration with values of one table replaced, held to their form; what was set stays what was set."""
    given = {name: dict(fields) for name, fields in config.model_dump(exclude_unset=True).items()}
    given[table] = {**given.get(table, {}), **values}
    return parsed(given, option)


def with_mode(config: Config, mode: str | None) -> Config:
    """The configuration with vision and calibration in the mode that was asked for."""
    if mode is None:
        return config
    if mode not in ("default", "paper"):
        near = difflib.get_close_matches(mode, ("default", "paper"), n=1, cutoff=0.3)
        raise UseError("OV206", f"--mode {mode} is not known", help=f"--mode {near[0] if near else 'paper'}")
    # Only what was set by hand is kept, so that the mode's own values come in.
    return _with(_with(config, "vision", "--mode", mode=mode), "calibration", "--mode", mode=mode)


def rig_of(source: "Recording", chosen: Config) -> Config:
    """The configuration with the rig that the recording carries; says which tables of the one chosen are not used."""
    rig = source.config(chosen)
    told = {table: keys.keys() for table, keys in chosen.model_dump(exclude_unset=True).items()}
    other = [
        f"{table}.{key}"
        for table, keys in rig.rig().items()
        for key in sorted(keys.keys() & told.get(table, {}.keys()))
        if getattr(getattr(chosen, table), key) != getattr(getattr(rig, table), key)
    ]
    if other:
        say.story(f"[yellow]not used[/] of the configuration: {', '.join(other)}; a recording carries its own")
    return rig


def opened(name: str, quick: bool = False) -> "Recording":
    """The recording of that name: a file, or the packaged one.

    quick   to be played: what is damaged in a whole file is found where it is read
    raises  UseError when there is no such file
    """
    from omnivert.wire.recording import Recording

    path = recording_path(name)
    if path.stat().st_size < LARGE_BYTES:
        return Recording(path, quick=quick)
    with say.progress("opening", None) as bar:
        return Recording(path, bar.reach, quick)


def recording_path(name: str) -> Path:
    """The file behind the name of a recording."""
    path = Path(name)
    if name == PACKAGED and not path.is_file():
        package, *rest = CORRIDOR
        packaged = Path(str(resources.files(package).joinpath(*rest)))
        if not packaged.is_file():
            raise DataError(
                "OV320", "the packaged recording is missing", f"{packaged} is not there", "pip install omnivert"
            )
        return packaged
    if path.is_dir():
        marks = {"bearings.csv": "bearings", "metadata.yaml": "rosbag"}  # files that only such a folder has
        kind = next((kind for name, kind in marks.items() if (path / name).exists()), "frames")
        help = f"omnivert import {kind} {quote(name)} -o drive.mcap   # makes a recording of a folder"
        raise UseError("OV321", f"{name} is a folder", "a recording is one file", help)
    if path.exists() and not path.is_file():
        because = "it is a device or a pipe, and a recording is read more than once"
        raise UseError("OV321", f"{name} is no file", because, "omnivert calibrate corridor")
    if not path.is_file():
        folder = path.parent if path.parent.is_dir() else Path()
        names = [PACKAGED, *sorted(str(file) for file in folder.glob("*.mcap"))]
        near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
        hint = (
            f"did you mean {' or '.join(near)}?" if near else "omnivert calibrate corridor   # the packaged recording"
        )
        raise UseError("OV321", f"no recording {name}", "there is no such file", hint)
    return path


def title(name: str) -> str:
    """How a recording is called in what people read."""
    return name if name == PACKAGED else Path(name).name
