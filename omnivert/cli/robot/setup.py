"""`omnivert setup ring`: the mirror in the picture, measured, drawn for approval, written into the settings."""

import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.outputs import check_outputs
from omnivert.cli.settings import ConfigOption, JsonOption, settings
from omnivert.config import Config, MirrorRing
from omnivert.errors import DataError

if TYPE_CHECKING:
    from omnivert.cli.robot.shots import Shots
    from omnivert.vision.inner import Inner
    from omnivert.vision.survey import Rim

app = typer.Typer(help="Measure what the configuration needs to know.")

DRAWN = Path("ring.png")
FROM = {  # what Rmin rests on
    "both": "a border, and the pictures change beyond it",
    "change": "the pictures change beyond it; no clear border",
    "border": "a clear border",
    "nothing": "not to be told from these pictures: a safe share of Rmax",
}


@app.callback()
def root() -> None:
    """Measure what the configuration needs to know."""


@app.command("ring")
def ring(
    pictures: Annotated[
        list[str] | None,
        typer.Argument(metavar="PICTURES", help="Images, folders, or recordings (.mcap); the camera without any."),
    ] = None,
    config: ConfigOption = None,
    picture: Annotated[Path, typer.Option("--picture", help="PNG to look at before you approve.")] = DRAWN,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Write into the configuration without asking.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Find the mirror's centre, Rmin and Rmax in one or more pictures; those of several places make it surer."""
    from omnivert.cli.robot.config_edit import check_editable, edit

    chosen = settings(config)
    if config is not None:
        check_editable(config)
    sources = pictures or []
    inputs = {f"picture {source}": Path(source) for source in sources}
    check_outputs({**inputs, "configuration": config}, {"--picture": picture})
    from omnivert.cli.robot.shots import shots
    from omnivert.threads import one_thread
    from omnivert.vision.inner import inner_radius
    from omnivert.vision.survey import NoRim, surveyed

    one_thread()
    taken = shots(sources, chosen)
    for text in taken.left_out:
        say.story(f"[yellow]not used[/] {escape(text)}")
    with say.progress("measuring", None):
        rim = surveyed(taken.pictures)
    if isinstance(rim, NoRim):
        help = "light the mirror, fill the picture with it, and keep its rim in sight; then omnivert explain OV120"
        raise DataError("OV120", f"no mirror's ring in {_number(len(taken.pictures))}", rim.reason, help)
    inner = inner_radius(taken.pictures, rim)
    found = _rounded(rim, inner)
    _draw(picture, taken, rim, inner, found)
    changes = _changes(chosen, found, taken)
    if not as_json:
        _report(taken, rim, inner, found, picture)
    written = config is not None and bool(changes) and _approved(config, chosen, changes, yes, as_json)
    if config is not None and written:
        edit(config, changes)
    if as_json:
        say.json_result(_body(taken, rim, inner, found, picture, changes, config if written else None))
    elif config is None:
        say.result("\n".join(["[ring]", *(f"{key} = {value}" for key, value in _values(found).items())]))
        again = " ".join(["omnivert setup ring", *map(quote, sources)])
        say.following(f"{again} --config robot.toml   # writes it there; omnivert config > robot.toml makes one")
    elif not changes or written:
        say.story(f"{escape(str(config))} says so already" if not changes else f"wrote   {escape(str(config))}")
        say.following(f"omnivert up --config {quote(str(config))}   # starts the services")
    else:
        say.story(f"[yellow]not written[/]: --yes writes it into {escape(str(config))}")


def _rounded(rim: "Rim", inner: "Inner") -> MirrorRing:
    """What would be configured, to a tenth of a pixel."""
    center = round(rim.u_px, 1), round(rim.v_px, 1)
    return MirrorRing(center_px=center, r_min_px=round(inner.radius_px, 1), r_max_px=round(rim.radius_px, 1))


def _values(found: MirrorRing) -> dict[str, Any]:
    return {"center_px": list(found.center_px), "r_min_px": found.r_min_px, "r_max_px": found.r_max_px}


def _changes(chosen: Config, found: MirrorRing, taken: "Shots") -> dict[str, dict[str, Any]]:
    """The settings that differ from those of the configuration, table by table."""
    height, width = taken.pictures[0].shape
    measured = {"camera": {"width_px": width, "height_px": height}, "ring": _values(found)}
    differ = {
        table: {key: value for key, value in values.items() if _held(chosen, table, key) != value}
        for table, values in measured.items()
    }
    return {table: values for table, values in differ.items() if values}


def _held(chosen: Config, table: str, key: str) -> Any:
    value = getattr(getattr(chosen, table), key)
    return list(value) if isinstance(value, tuple) else value


def _approved(config: Path, chosen: Config, changes: dict[str, dict[str, Any]], yes: bool, as_json: bool) -> bool:
    """Whether to write: as told by --yes, else as a person at the terminal says; elsewhere nobody is asked."""
    for table, values in changes.items():
        for key, value in values.items():
            say.story(f"{table}.{key}  {escape(f'{_held(chosen, table, key)} -> {value}')}")
    if yes or as_json or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return yes
    return typer.confirm(f"Look at the picture. Write this into {config}?", default=False, err=True)


def _draw(path: Path, taken: "Shots", rim: "Rim", inner: "Inner", found: MirrorRing) -> None:
    from omnivert.cli.offline.drawn import write_drawn
    from omnivert.pictures.ring_drawn import ring_picture

    shown = rim.used[len(rim.used) // 2]
    title = f"{taken.names[shown]}   ·   {len(rim.used)} of {_number(len(taken.pictures))} agree"
    write_drawn(path, ring_picture(taken.pictures[shown], found, title, rmin_is_guessed=not inner.std_px))


def _report(taken: "Shots", rim: "Rim", inner: "Inner", found: MirrorRing, picture: Path) -> None:
    height, width = taken.pictures[0].shape
    say.story(f"[cyan]given[/]   {_number(len(taken.pictures))} of {width} x {height}, {len(rim.used)} agree")
    shakes = f"moves by {rim.spread_px:.1f} px between them" if len(rim.used) > 1 else "from one picture"
    u, v = found.center_px
    around = "bright within dark" if rim.bright else "dark within bright"
    say.result(f"centre  ({u:.1f}, {v:.1f}) ± {rim.center_std_px:.1f} px   {shakes}")
    say.result(
        f"Rmax    {found.r_max_px:.1f} ± {rim.radius_std_px:.1f} px   {around}, an edge along {100 * rim.quality:.0f} %"
    )
    known = f" ± {inner.std_px:.1f}" if inner.std_px else ""
    say.result(f"Rmin    {found.r_min_px:.1f}{known} px   {FROM[inner.told]}")
    say.story(f"[cyan]picture[/] {escape(str(picture))}")


def _body(
    taken: "Shots",
    rim: "Rim",
    inner: "Inner",
    found: MirrorRing,
    picture: Path,
    changes: dict[str, dict[str, Any]],
    written: Path | None,
) -> dict[str, Any]:
    height, width = taken.pictures[0].shape
    return {
        "width_px": width,
        "height_px": height,
        **_values(found),
        "center_std_px": rim.center_std_px,
        "center_spread_px": rim.spread_px,
        "r_max_std_px": rim.radius_std_px,
        "r_min_std_px": inner.std_px or None,
        "r_min_from": str(inner.told),
        "rim_seen": rim.quality,
        "pictures": len(taken.pictures),
        "agree": len(rim.used),
        "left_out": taken.left_out,
        "picture": str(picture),
        "changes": changes,
        "written": None if written is None else str(written),
    }


def _number(pictures: int) -> str:
    return f"{pictures} picture{'' if pictures == 1 else 's'}"
