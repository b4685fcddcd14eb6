"""`omnivert simulate`: a drive through a room that does not exist, as a recording or a folder, with the truth."""

import time
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.outputs import check_new_recording
from omnivert.cli.settings import ConfigOption, JsonOption, settings
from omnivert.errors import UseError
from omnivert.pictures.words import amounts

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.simulation.stage import Stage

WORLD, PATH = "office", "paper"  # unless something else is asked for

WorldOption = Annotated[str, typer.Option("--world", help="office, hall, or your own file, my.toml.")]
PathOption = Annotated[
    str,
    typer.Option(
        "--path", help="paper, alternate, straight, turn, arc-0.3, arc-0.5, arc-1.9, still, or your own file, my.toml."
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, max=2**31, help="The same seed gives the same drive.")]
PeopleOption = Annotated[int | None, typer.Option("--people", min=0, max=50, help="Who walk about; else the world's.")]
NoiseOption = Annotated[
    float | None, typer.Option("--noise-k", min=0.0, max=0.1, help="True K of the wheels, m; else as configured.")
]
TiltOption = Annotated[
    float | None, typer.Option("--tilt-deg", min=0.0, max=15.0, help="Of the mirror's axis; else the world's.")
]


def simulate(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT", help="OUT.mcap: a recording; else a folder.")
    ] = None,
    world: WorldOption = WORLD,
    path: PathOption = PATH,
    seed: SeedOption = 1,
    people: PeopleOption = None,
    noise_k: NoiseOption = None,
    tilt_deg: TiltOption = None,
    config: ConfigOption = None,
    show: Annotated[
        bool, typer.Option("--show", help="Print the files of world and path, to begin your own from; drive nothing.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Drive a simulated robot along a path: pictures through a hyperbolic mirror, encoders, scans, and the exact truth.

    Wheels, ring, picture size and rate are those of --config.

    Mirror, mount, height, vibration, exposure, walls and people stand in the world's file.
    """
    if show:
        _show(world, path)
        return
    if output is None:
        raise UseError("OV205", "omnivert simulate: --output is missing", help="omnivert simulate -o drive.mcap")
    from omnivert.formats.written import write_recording
    from omnivert.simulation.route import Route
    from omnivert.simulation.toml_file import loaded
    from omnivert.simulation.trip import Trip
    from omnivert.simulation.trip_folder import write_folder
    from omnivert.threads import one_thread

    one_thread()
    as_recording = output.suffix == ".mcap"
    check_new_recording(output)
    chosen = settings(config)
    stage = staged(chosen, world, seed, people, tilt_deg)
    route = loaded(path, "paths", Route)
    with say.progress("planning", None):
        trip = Trip(stage, route, chosen.encoder.noise_k_m if noise_k is None else noise_k)
    began, worked = time.monotonic(), time.process_time()
    with say.progress(f"driving {path} in {world}", sum(trip.counts.values())) as bar:
        (write_recording if as_recording else write_folder)(trip, output, bar.reach)
    seconds, of_processor = time.monotonic() - began, time.process_time() - worked
    phi, rho, psi = stage.mount
    if as_json:
        say.json_result(
            {
                "output": str(output),
                "world": world,
                "path": path,
                "seed": seed,
                "seconds": trip.seconds,
                "messages": trip.counts,
                "truth": {"phi_rad": phi, "rho_m": rho, "psi_rad": psi},
                "lines_in_the_world": len(stage.edges),
                "frames_per_second": trip.frames / seconds,
                "frames_per_cpu_second": trip.frames / of_processor,
            }
        )
        return
    say.result(f"{output}  {trip.seconds:.1f} s · {amounts(trip.counts)}")
    degrees = 57.29577951308232
    say.result(f"truth   phi {phi * degrees:.2f} deg   rho {rho:.4f} m   psi {psi * degrees:.2f} deg")
    say.story(f"took    {seconds:.1f} s, {trip.frames / of_processor:.0f} frames for each second of one core")
    then = output if as_recording else "drive.mcap"
    first = "" if as_recording else f"omnivert import frames {quote(str(output))} -o {quote(str(then))} && "
    say.following(f"{first}omnivert calibrate {quote(str(then))}")


def staged(config: "Config", world: str, seed: int, people: int | None, tilt_deg: float | None) -> "Stage":
    """The world of this name or file, with what the options say of it.

    raises  UseError naming file and key
    """
    from omnivert.simulation.place import Place
    from omnivert.simulation.stage import Stage, with_camera
    from omnivert.simulation.toml_file import loaded

    return Stage(config, with_camera(loaded(world, "worlds", Place), tilt_deg=tilt_deg), seed, people)


def check_names(world: str, path: str | None) -> None:
    """raises UseError when there is no such world or path"""
    from omnivert.simulation.place import Place
    from omnivert.simulation.route import Route
    from omnivert.simulation.toml_file import loaded

    loaded(world, "worlds", Place)
    if path is not None:
        loaded(path, "paths", Route)


def _show(world: str, path: str) -> None:
    from omnivert.simulation.toml_file import text_of

    files = [
        (kind, name.removesuffix(".toml"), text_of(name, kind)) for name, kind in ((world, "worlds"), (path, "paths"))
    ]
    for kind, name, text in files:
        say.result(f"# {kind}/{name}.toml\n{text}")
