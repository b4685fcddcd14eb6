"""`omnivert track REC`: the lines of every frame, as tables and pictures."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.given import count
from omnivert.cli.outputs import check_distinct, check_outputs, made_folder
from omnivert.cli.settings import (
    ConfigOption,
    JsonOption,
    ModeOption,
    RecordingArgument,
    opened,
    settings,
    title,
    with_mode,
)
from omnivert.errors import DataError
from omnivert.messages import Bearings
from omnivert.wire.channels import FRAME

if TYPE_CHECKING:
    from omnivert.bench.score.score import Score
    from omnivert.config import Config
    from omnivert.wire.recording import Recording

LINES_HEADER = ("index", "t_s", "track_id", "bearing_rad", "std_rad", "age_frames", "strength")
CENTERS_HEADER = ("index", "cu_px", "cv_px", "radius_px", "quality")


def track(
    recording: RecordingArgument,
    csv_path: Annotated[Path | None, typer.Option("--csv", help="Table of lines, a row for each sighting.")] = None,
    centers: Annotated[Path | None, typer.Option("--centers", help="Table of the ring's centres.")] = None,
    draw: Annotated[Path | None, typer.Option("--draw", help="Folder for the frames, lines drawn in.")] = None,
    config: ConfigOption = None,
    mode: ModeOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find and follow the vertical lines of a recording; scores them where it carries their truth."""
    chosen = with_mode(settings(config), mode)
    source = opened(recording)
    frames = count(source, FRAME)
    if not frames:
        raise DataError("OV101", f"there are no frames in {title(recording)}", "the lines come from them")
    inputs, tables = {"recording": source.path, "configuration": config}, {"--csv": csv_path, "--centers": centers}
    check_distinct(inputs, {**tables, "--draw": draw})
    if draw is not None:
        made_folder(draw)
    check_outputs(inputs, tables)
    rig = source.config(chosen)
    tracked = list(say.counted(_drawn(source, rig, draw), "tracking", frames))
    if csv_path is not None:
        _write(csv_path, LINES_HEADER, _lines(tracked))
    if centers is not None:
        _write(centers, CENTERS_HEADER, _centers(tracked))
    _report(tracked, _scored(source, tracked), as_json)
    for path in (csv_path, centers, draw):
        if path is not None:
            say.story(f"wrote   {path}")


def _drawn(source: "Recording", config: "Config", folder: Path | None) -> Iterator[Bearings]:
    """The tracked frames; each is also drawn into the folder, where one is given."""
    from omnivert.cli.drawn import write_drawn
    from omnivert.offline import seen

    for index, (frame, bearings) in enumerate(seen(source, config)):
        if folder is not None:
            write_drawn(folder / f"{index:06d}.png", frame, bearings, config)
        yield bearings


def _lines(tracked: list[Bearings]) -> Iterator[tuple[str, ...]]:
    for index, frame in enumerate(tracked):
        seconds = f"{1e-9 * frame.stamp_ns:.6f}"
        for line in range(len(frame.track_id)):
            yield (
                str(index),
                seconds,
                str(int(frame.track_id[line])),
                f"{float(frame.bearing_rad[line]):.9f}",
                f"{float(frame.std_rad[line]):.6g}",
                str(int(frame.age_frames[line])),
                f"{float(frame.strength[line]):.4f}",
            )


def _centers(tracked: list[Bearings]) -> Iterator[tuple[str, ...]]:
    for index, frame in enumerate(tracked):
        ring = frame.ring
        if ring is not None:
            yield (
                str(index),
                f"{ring.center_u_px:.4f}",
                f"{ring.center_v_px:.4f}",
                f"{ring.radius_px:.3f}",
                f"{ring.quality:.4f}",
            )


def _write(path: Path, header: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> None:
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as error:
        raise DataError("OV322", f"cannot write {path}", str(error.strerror or error)) from error


def _scored(source: "Recording", tracked: list[Bearings]) -> "Score | None":
    """How right the lines are, where the recording carries a truth that can be read."""
    from omnivert.bench.score.score import score
    from omnivert.bench.score.truth import Sighting, truth_of

    try:
        truths = truth_of(source)
    except DataError as error:
        say.story(f"[yellow]not scored[/]: {escape(str(error))}")
        return None
    return None if truths is None else score(map(Sighting.of, tracked), truths)


def _report(tracked: list[Bearings], score: "Score | None", as_json: bool) -> None:
    counts = [len(frame.track_id) for frame in tracked]
    ids = {int(i) for frame in tracked for i in frame.track_id}
    bad = [frame for frame in tracked if frame.reasons]
    reasons = sorted({reason for frame in bad for reason in frame.reasons})
    if as_json:
        say.json_result(
            {
                "frames": len(tracked),
                "frames_unusable": len(bad),
                "reasons": reasons,
                "tracks": len(ids),
                "sightings": sum(counts),
                "lines_per_frame": sum(counts) / len(counts),
                "ring_found": sum(frame.ring is not None for frame in tracked),
                "score": None if score is None else score.json(),
            }
        )
        return
    say.result(f"{len(tracked)} frames · {sum(counts) / len(counts):.1f} lines a frame · {len(ids)} tracks")
    if bad:
        say.result(f"{len(bad)} frames could not be used: {'; '.join(reasons)}")
    for row in [] if score is None else score.words():
        say.result(row)
