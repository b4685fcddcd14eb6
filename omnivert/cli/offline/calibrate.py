"""`omnivert calibrate REC`: a recording in, the mount out, with every reason when it is not good enough."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.given import Given
from omnivert.cli.offline import results
from omnivert.cli.offline.drawn import drawn_frame
from omnivert.cli.outputs import check_outputs
from omnivert.cli.settings import (
    ConfigOption,
    JsonOption,
    ModeOption,
    RecordingArgument,
    opened,
    rig_of,
    settings,
    title,
)
from omnivert.cli.settings import with_mode as in_mode
from omnivert.errors import DataError, UseError
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, State
from omnivert.pictures.words import bounds, cause, corrected, heading, quantities, reasons_of, word

if TYPE_CHECKING:
    from omnivert.config import Config
    from omnivert.wire.recording import Recording

PictureOption = Annotated[Path | None, typer.Option("--picture", help="Write the result picture, a PNG.")]


@dataclass(slots=True)
class Outcome:
    """All that an offline calibration has said."""

    estimates: list[Estimate] = field(default_factory=list)
    bearings: list[Bearings] = field(default_factory=list)
    extrinsics: Extrinsics | None = None  # the last that was claimed

    @property
    def last(self) -> Estimate:
        return self.estimates[-1]


def calibrate(
    recording: RecordingArgument,
    config: ConfigOption = None,
    mode: ModeOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate from a recording: where does the camera sit?"""
    chosen = in_mode(settings(config), mode)
    source = opened(recording)
    check_outputs({"recording": source.path, "configuration": config}, {"--picture": picture})
    check_format(picture)
    given = Given.of(source)
    say.story(f"[cyan]given[/]   {escape(title(recording))}  {given}")
    rig = rig_of(source, chosen)
    outcome = calibration(source, rig, given)
    truth = results.truth_of(source)
    say.story(f"[cyan]drive[/]   {drive(outcome)}")
    if given.cut:
        say.note(f"the recording is not whole: {given.fault}")
    if picture is not None:
        write_picture(picture, outcome, source, rig, truth)
        say.story(f"[cyan]picture[/] {escape(str(picture))}")
    body = result_json(outcome, given, truth, rig)
    if outcome.last.state not in (State.CALIBRATED, State.USABLE):
        error = refusal(outcome)
        if as_json:
            say.json_result({**body, "error": say.refusal_json(error)})
        trusted = rig.calibration.mode != "paper"  # the filter as printed claims sigmas that do not hold
        say.refuse(error, known=known(outcome.last) if trusted else "", also=f"omnivert explain {error.code}")
        raise typer.Exit(error.exit_code)
    if as_json:
        say.json_result(body)
    else:
        tell(outcome, truth)


def check_format(picture: Path | None) -> None:
    """raises UseError when the name asks for another format than the one that is written"""
    if picture is not None and picture.suffix.lower() not in ("", ".png"):
        help = f"--picture {picture.with_suffix('.png')}"
        raise UseError("OV205", f"omnivert calibrate: --picture {picture}", "the picture is a PNG", help)


def calibration(source: "Recording", config: "Config", given: Given) -> Outcome:
    """Run the steppers over the recording.

    raises  DataError when it holds no frames or no ticks
    """
    from omnivert.offline import calibrated

    again = "omnivert record drive.mcap"
    if not given.frames:
        what = "there are neither frames nor bearings in this recording"
        raise DataError("OV101", what, "the lines come from them", again)
    if not given.ticks:
        raise DataError("OV102", "there are no ticks in this recording", "the way of the wheels comes from them", again)
    outcome = Outcome()
    with say.progress("calibrating", given.frames) as bar:
        for message in calibrated(source, config):
            match message:
                case Bearings():
                    outcome.bearings.append(message)
                    bar.step()
                case Estimate():
                    outcome.estimates.append(message)
                case Extrinsics():
                    outcome.extrinsics = message
    if not outcome.estimates:
        because = "the stamps of frames and ticks do not overlap"
        raise DataError("OV103", "frames and ticks of this recording never meet", because, again)
    return outcome


def drive(outcome: Outcome) -> str:
    """How far was driven and what was seen on the way."""
    counts = sorted(len(bearings.track_id) for bearings in outcome.bearings)
    low, high = (counts[len(counts) // 10], counts[-1 - len(counts) // 10]) if counts else (0, 0)
    last = outcome.last
    bad = _unusable(outcome)
    text = f"{last.driven_m:.1f} m driven, {math.degrees(last.turned_rad):.0f} deg turned · {low}-{high} lines a frame"
    return f"{text} · {bad} frames unusable" if bad else text


def _unusable(outcome: Outcome) -> int:
    """Frames that gave a reason and no line."""
    from omnivert.vision.account import is_unusable

    return sum(map(is_unusable, outcome.bearings))


def refusal(outcome: Outcome) -> DataError:
    """Why this drive does not allow a result, as the verdict saw it, and what to drive instead."""
    last = outcome.last
    because = cause(reasons_of(last)[:3])
    turned = math.degrees(last.turned_rad)
    again = f"{last.next_manoeuvre.rstrip('.')}, then run this again" if last.next_manoeuvre else ""
    if last.state is State.INVALID:
        return DataError("OV106", "the data contradict the model", because, again or "omnivert explain OV106")
    if last.state is State.MOVED:
        return DataError("OV107", "the camera has moved during this drive", because, again)
    if last.driven_m < 0.2 and turned < 10.0:
        return DataError("OV108", "the robot hardly moved in this recording", because, again)
    if turned < 45.0:
        because = because or f"you turned by {turned:.0f} deg in all; below about 45 deg only their sum is seen"
        return DataError("OV104", "phi and psi can not be told apart in this drive", because, again)
    if last.driven_m < 0.3:
        because = because or f"you drove {last.driven_m:.1f} m in all; turning on the spot does not show the distance"
        return DataError("OV105", "rho can not be seen in this drive", because, again)
    return DataError("OV109", "this drive does not show the mount well enough", because, again)


def known(last: Estimate) -> str:
    """What can be said all the same."""
    if last.mount is None:
        return ""
    _, rho, _ = quantities(last.mount)
    total = heading(last.mount)
    return f"{total.name} = {total}     rho = {rho}"


def tell(outcome: Outcome, truth: results.Truth | None) -> None:
    """The result as text."""
    last = outcome.last
    if last.mount is None:
        raise ValueError("a usable estimate has a mount")
    say.result(f"verdict {word(last.state)}, from {last.frame} frames")
    for row in results.rows(last.mount, results.state_words(last), truth):
        say.result(f"  {row}")
    if text := results.together(last.mount):
        say.result(f"  together  phi + psi = {text}")
    if last.bound_std is not None:
        phi, rho, psi = bounds(last)
        say.result(f"  best possible sigmas of this drive   {phi} deg   {rho} m   {psi} deg")
    for correction in last.corrections:
        say.result(f"  {corrected(correction)}")
    if last.next_manoeuvre:
        say.result(f"next    {last.next_manoeuvre}")


def result_json(outcome: Outcome, given: Given, truth: results.Truth | None, config: "Config") -> dict[str, Any]:
    """The result as one object."""
    last = outcome.last
    parts = {"phi": last.phi, "rho": last.rho, "psi": last.psi}
    return {
        **results.mount_json(last.mount),
        "verdict": last.state.value,
        "verdicts": {name: {"state": part.state.value, "reason": part.reason} for name, part in parts.items()},
        "frames": last.frame,
        "next_manoeuvre": last.next_manoeuvre,
        "bound_sigma": None if last.bound_std is None else last.bound_std.tolist(),
        "smoother": None if last.smoother is None else results.mount_json(last.smoother),
        "disagreement_sigmas": last.disagreement,
        "corrections": {
            part.name: {"value": part.value, "std": part.std, "freed": part.freed, "reason": part.reason}
            for part in last.corrections
        },
        "reasons": list(last.reasons),
        "driven_m": last.driven_m,
        "turned_rad": last.turned_rad,
        "lines": {"used": last.lines_used, "new": last.lines_new, "rejected": last.lines_rejected},
        "frames_unusable": _unusable(outcome),
        "claimed_at_s": None if outcome.extrinsics is None else 1e-9 * outcome.extrinsics.stamp_ns,
        "given": given.json(),
        "robot": config.robot.id,
        "camera": config.camera.id,
        "mode": config.calibration.mode,
        "rig_digest": config.rig_digest(),
        **results.truth_json(last.mount, truth),
    }


def write_picture(
    path: Path, outcome: Outcome, source: "Recording", config: "Config", truth: results.Truth | None
) -> None:
    """The result picture, with the last frame of the recording in it."""
    from omnivert.pictures.result import write_result

    last: Frame | None = None
    for _, message in source.messages(types=(Frame,)):
        if isinstance(message, Frame):
            last = message
    drawn = None if last is None else drawn_frame(last, outcome.bearings[-1], config)
    write_result(path, outcome.estimates, config.robot.id, config.robot.wheel_base_m, drawn, truth)
