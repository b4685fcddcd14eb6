"""`omnivert doctor`: what stands in the way of a calibration, the cause first, with a fix for each."""

import difflib
import re
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from omnivert.cli import say
from omnivert.cli.outputs import check_outputs
from omnivert.cli.settings import ConfigOption, ConnectOption, JsonOption, RobotOption, opened, rig_of, settings
from omnivert.cli.whom import meant
from omnivert.errors import DataError, UseError

if TYPE_CHECKING:
    from omnivert.doctor.evidence import Evidence
    from omnivert.doctor.report import Line, Report

LISTEN_S = 3.0
PUSH_S = 120.0
COLUMNS = 100
STYLES = {"fine": "green", "worse": "yellow", "stops": "bold red", "unchecked": "dim"}
PUSH_STEPS = {
    "straight": "push the robot about a metre straight forward, then let it stand for two seconds",
    "turn": "now turn it to the left, counter-clockwise, by about 90 deg, and let it stand",
    "done": "done",
}


def doctor(
    recording: Annotated[
        str | None, typer.Argument(metavar="[REC]", help="A recording, or the word corridor; else the robot.")
    ] = None,
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Show this check or group alone; may be repeated.")
    ] = None,
    push: Annotated[bool, typer.Option("--push", help="Wait until you have pushed and turned the robot.")] = False,
    seconds: Annotated[float, typer.Option(min=0.5, max=600.0, help="How long to listen to the robot.")] = LISTEN_S,
    bundle: Annotated[Path | None, typer.Option("--bundle", help="Write it all into a .zip file to mail.")] = None,
    as_json: JsonOption = False,
) -> None:
    """What is wrong, and what to do about it? Of the robot, or of a recording. Changes nothing.

    The checks stand in the order in which the data flow: begin with the first that is marked.
    """
    from omnivert.doctor.bundle import write_bundle
    from omnivert.doctor.report import Report
    from omnivert.doctor.table import NAMES, checked

    chosen = _known(only or [], NAMES)
    if recording is not None:
        _refuse_with_recording(recording, robot, connect, push)
        evidence = _of_recording(recording, config, bundle)
    else:
        check_outputs({"configuration": config}, {"--bundle": bundle})
        evidence = _of_robot(config, robot, connect, push, seconds)
    report = Report.of(evidence, checked(evidence, chosen))
    if bundle is not None:
        text = "\n".join(map(str, report.lines(COLUMNS)))
        try:
            write_bundle(bundle, evidence, report.json(), f"{text}\n")
        except OSError as error:
            because = error.strerror or str(error)
            raise DataError("OV322", f"cannot write {bundle}", because, "choose another place") from error
        say.story(f"[cyan]bundle[/]  {bundle}")
    if as_json:
        say.json_result(report.json())
    else:
        _print(report, _again(recording, config), mailed=bundle is not None)
    if report.stops:
        raise typer.Exit(1)


def _known(names: list[str], known: tuple[str, ...]) -> list[str]:
    """raises UseError for a name of no check"""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=2, cutoff=0.5)
            help = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(known)}"
            raise UseError("OV205", f"omnivert doctor: no check named {name}", help=help)
    return names


def _refuse_with_recording(recording: str, robot: str | None, connect: str | None, push: bool) -> None:
    for option, given in (("--robot", robot is not None), ("--connect", connect is not None), ("--push", push)):
        if given:
            because = "a recording is looked at as it is, without a robot"
            raise UseError("OV205", f"omnivert doctor: {option} beside {recording}", because, "leave one of them out")


def _of_recording(name: str, config: Path | None, bundle: Path | None) -> "Evidence":
    from omnivert.cli.given import count
    from omnivert.doctor.recorded import recorded
    from omnivert.wire.channels import FRAME

    chosen = settings(config)
    source = opened(name)
    check_outputs({"recording": source.path, "configuration": config}, {"--bundle": bundle})
    rig = rig_of(source, chosen)
    with say.progress("looking", count(source, FRAME) or None) as bar:
        return recorded(source, rig, name, bar.step)


def _of_robot(config: Path | None, robot: str | None, connect: str | None, push: bool, seconds: float) -> "Evidence":
    """raises UseError when more than one robot is there and none was named, KeyboardInterrupt with ctrl-c"""
    from omnivert.doctor.live import Interrupted, Robot, live
    from omnivert.doctor.pushed import Push, Stage
    from services.router import is_local

    refusal = None
    try:
        chosen = meant(config, robot, connect, "doctor")
    except DataError as error:  # no router: the report says so
        chosen, refusal = settings(config, robot, connect), error
    said: list[Stage] = []
    whole = max(seconds, PUSH_S) if push else seconds
    with say.progress("listening", round(10 * whole)) as bar:

        def moved(stage: Stage | None, gone_s: float) -> None:
            bar.reach(round(10 * min(gone_s, whole)), round(10 * whole))
            if stage is not None and stage not in said:
                said.append(stage)
                say.story(f"  [cyan]▶[/] {PUSH_STEPS[stage.value]}")

        try:
            watched = Push(chosen) if push else None
            source = "" if config is None else str(config)
            return live(Robot(chosen, source, is_local(chosen.bus.endpoint), refusal), whole, watched, moved)
        except Interrupted:
            raise KeyboardInterrupt from None


def _print(report: "Report", again: str, mailed: bool) -> None:
    console = say.out()
    for line in report.lines(min(COLUMNS, console.width) if console.is_terminal else COLUMNS):
        console.print(_coloured(line))
    first = report.first
    if first is None:
        return
    command = re.search(r"(?:sudo|omnivert|pip|mkdir) .*", first.finding.help)
    if command and not command.start():
        console.print(f"next: {first.finding.help.partition('   #')[0]}", markup=False)
    if not mailed:
        console.print(f"mail this: {again} --bundle doctor.zip", markup=False)


def _coloured(line: "Line") -> Text:
    text = Text(str(line))
    if line.group:
        text.stylize("cyan", 0, len(line.group))
    if line.status is not None:
        at = str(line).index(line.mark, len(line.group))
        text.stylize(STYLES[line.status.value], at, at + len(line.mark))
        if line.status.value == "unchecked":
            text.stylize("dim", at)
    return text


def _again(recording: str | None, config: Path | None) -> str:
    return " ".join(
        [
            "omnivert doctor",
            *([quote(recording)] if recording else []),
            *(["--config", quote(str(config))] if config else []),
        ]
    )
