"""`omnivert track REC`: the lines of every frame, as tables, pictures and a video."""

import csv
from collections import Counter
from collections.abc import Iterator
from math import hypot
from pathlib import Path
from shlex import quote
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any

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
    rig_of,
    settings,
    title,
    with_mode,
)
from omnivert.errors import DataError
from omnivert.messages import Bearings, Frame
from omnivert.wire.channels import BEARINGS, FRAME

if TYPE_CHECKING:
    from omnivert.bench.score.score import Score
    from omnivert.cli.offline.drawn import Video
    from omnivert.config import Config
    from omnivert.vision.account import Account
    from omnivert.wire.recording import Recording

LINES_HEADER = (
    *("index", "t_s", "track_id", "bearing_rad", "std_rad", "age_frames", "strength"),
    *("polarity", "inner_px", "outer_px", "quality", "moving"),
)
CENTERS_HEADER = (
    *("index", "cu_px", "cv_px", "radius_px", "quality", "std_px"),
    *("meeting_u_px", "meeting_v_px", "meeting_std_px", "meeting_used"),
)


def track(
    recording: RecordingArgument,
    csv_path: Annotated[Path | None, typer.Option("--csv", help="Table of lines, a row for each sighting.")] = None,
    centers: Annotated[Path | None, typer.Option("--centers", help="Table of the ring's centres.")] = None,
    draw: Annotated[Path | None, typer.Option("--draw", help="Folder for the frames, lines drawn in.")] = None,
    video: Annotated[
        Path | None, typer.Option("--video", help="The same as a video, as fast as it was: .mp4, .webm or .avi.")
    ] = None,
    config: ConfigOption = None,
    mode: ModeOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find and follow the vertical lines of a recording; scores them where it carries their truth."""
    chosen = with_mode(settings(config), mode)
    source = opened(recording)
    frames = count(source, FRAME)
    if not frames:
        because, again = "the lines come from them", ""
        if count(source, BEARINGS):
            because = "it holds the bearings themselves, which are tracked already"
            again = f"omnivert calibrate {quote(recording)}"
        raise DataError("OV101", f"there are no frames in {title(recording)}", because, again)
    inputs = {"recording": source.path, "configuration": config}
    files = {"--csv": csv_path, "--centers": centers, "--video": video}
    check_distinct(inputs, {**files, "--draw": draw})
    if video is not None:
        from omnivert.cli.offline.drawn import check_video

        check_video(video)
    if draw is not None:
        made_folder(draw)
    check_outputs(inputs, files)
    from omnivert.vision.account import Account

    rig = rig_of(source, chosen)
    film = None if video is None else _film(video, source, rig)
    try:
        tracked = list(say.counted(_drawn(source, rig, draw, film), "tracking", frames))
    finally:
        if film is not None:
            film.release()
    if film is not None:
        film.check()
    if csv_path is not None:
        _write(csv_path, LINES_HEADER, _lines(tracked))
    if centers is not None:
        _write(centers, CENTERS_HEADER, _centers(tracked))
    account = Account.of(rig, tracked)
    _report(tracked, account, _scored(source, tracked), as_json)
    for path in (csv_path, centers, draw, video):
        if path is not None:
            say.wrote(path)
    if account.unusable == len(tracked):
        mostly = next(iter(account.reasons), "")
        raise DataError("OV110", f"no frame of {title(recording)} could be used", mostly, "omnivert explain OV110")


def _film(path: Path, source: "Recording", config: "Config") -> "Video":
    """A video still without pictures, at the pace of the recording's frames."""
    from omnivert.cli.offline.drawn import Video, frame_rate_hz

    stamps = [message.stamp_ns for _, message in source.messages(types=(Frame,))]
    return Video(path, frame_rate_hz(stamps, config.camera.frame_rate_hz))


def _drawn(source: "Recording", config: "Config", folder: Path | None, film: "Video | None") -> Iterator[Bearings]:
    """The tracked frames; each is also drawn into the folder and the video, where they are given.

    A frame that cannot be read leaves no picture, and in the video a dark one with the reasons.
    """
    from omnivert.cli.offline.drawn import dark_frame, drawn_frame, write_drawn
    from omnivert.offline import seen

    for index, (frame, bearings) in enumerate(seen(source, config)):
        if folder is not None or film is not None:
            drawn = drawn_frame(frame, bearings, config, index)
            if folder is not None and drawn is not None:
                write_drawn(folder / f"{index:06d}.png", drawn)
            if film is not None:
                film.step(dark_frame(bearings, config, index) if drawn is None else drawn)
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
                *_looks(frame, line),
            )


def _looks(frame: Bearings, line: int) -> tuple[str, ...]:
    looks = frame.looks
    if looks is None:
        return ("",) * 5
    return (
        str(int(looks.polarity[line])),
        f"{float(looks.inner_px[line]):.2f}",
        f"{float(looks.outer_px[line]):.2f}",
        f"{float(looks.quality[line]):.4f}",
        str(int(looks.moving[line])),
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
                f"{ring.std_px:.4f}" if ring.std_px > 0.0 else "",
                *_meeting(frame),
            )


def _meeting(frame: Bearings) -> tuple[str, ...]:
    point = frame.meeting
    if point is None:
        return ("",) * 4
    return f"{point.u_px:.4f}", f"{point.v_px:.4f}", f"{point.std_px:.4f}", str(int(point.used))


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


def _report(tracked: list[Bearings], account: "Account", score: "Score | None", as_json: bool) -> None:
    counts = [len(frame.track_id) for frame in tracked]
    ids = {int(i) for frame in tracked for i in frame.track_id}
    notes = {about: text for about, text in account.notes().items() if about != "frames"}  # all are counted here
    if as_json:
        say.json_result(
            {
                "frames": len(tracked),
                "frames_unusable": account.unusable,
                "reasons": account.reasons,
                "notes": notes,
                "tracks": len(ids),
                **_tracks(tracked),
                "sightings": sum(counts),
                "lines_per_frame": sum(counts) / len(counts),
                "ring_found": sum(frame.ring is not None for frame in tracked),
                "ring": _ring_summary(tracked),
                "meeting": _meeting_summary(tracked),
                "score": None if score is None else score.json(),
            }
        )
        return
    moving = _tracks(tracked)["moving_tracks"]
    say.result(
        f"{len(tracked)} frames · {sum(counts) / len(counts):.1f} lines a frame · {len(ids)} tracks"
        + (f", {moving} of them moving" if moving else "")
    )
    if account.unusable:
        say.result(f"{account.unusable} frames could not be used")
    for reason, times in account.reasons.items():
        _tell(f"  {times:>6}  {reason}", 10)
    for text in notes.values():
        _tell(text)
    for row in [] if score is None else score.words():
        say.result(row)


def _tell(text: str, indent: int = 0) -> None:
    for line in say.folded(text, indent):
        say.result(line)


def _tracks(tracked: list[Bearings]) -> dict[str, Any]:
    """How long tracks are, and how many were ever seen to move; null where that is not known."""
    sightings = Counter(int(track) for frame in tracked for track in frame.track_id)
    looks = [(frame.track_id, frame.looks) for frame in tracked if frame.looks is not None]
    moving = {int(track) for tracks, look in looks for track in tracks[look.moving > 0]}
    return {
        "moving_tracks": len(moving) if looks else None,
        "median_track_frames": median(sightings.values()) if sightings else None,
    }


def _ring_summary(tracked: list[Bearings]) -> dict[str, Any] | None:
    rings = [frame.ring for frame in tracked if frame.ring is not None]
    told = [ring.std_px for ring in rings if ring.std_px > 0.0]
    if not rings:
        return None
    return {
        "median_quality": median(ring.quality for ring in rings),
        "median_radius_px": median(ring.radius_px for ring in rings),
        "median_std_px": median(told) if told else None,
    }


def _meeting_summary(tracked: list[Bearings]) -> dict[str, Any] | None:
    """Where lines meet, against the ring's centre, over the frames that know it."""
    known = [(frame.meeting, frame.ring) for frame in tracked if frame.meeting is not None and frame.ring is not None]
    if not known:
        return None
    used = sum(point.used for point, _ in known)
    return {
        "frames": len(known),
        "frames_used": used,
        "used": used > 0,
        "median_offset_px": median(hypot(at.u_px - ring.center_u_px, at.v_px - ring.center_v_px) for at, ring in known),
    }
