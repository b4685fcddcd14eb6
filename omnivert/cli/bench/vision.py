"""`omnivert bench vision`: how right and how fast the lines are, beside what a user could take instead."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.given import count
from omnivert.cli.offline import results
from omnivert.cli.settings import PACKAGED, ConfigOption, JsonOption, ModeOption, opened, settings, title, with_mode
from omnivert.errors import DataError
from omnivert.wire.channels import FRAME

if TYPE_CHECKING:
    from omnivert.bench.contender import Contender
    from omnivert.bench.growth import Growth
    from omnivert.bench.score.score import Score
    from omnivert.config import Config
    from omnivert.wire.recording import Recording

OURS = "omnivert"


def vision(
    recording: Annotated[str, typer.Argument(metavar="[REC]", help="An .mcap file, or the word corridor.")] = PACKAGED,
    config: ConfigOption = None,
    mode: ModeOption = None,
    peers: Annotated[bool, typer.Option("--peers/--no-peers", help="Run EDLines, LSD, ORB and SIFT, too.")] = True,
    peers_python: Annotated[
        Path | None, typer.Option("--peers-python", help="A python that has opencv-contrib; else one is made.")
    ] = None,
    growth: Annotated[
        bool, typer.Option("--growth", help="Time against picture size and number of lines, too.")
    ] = False,
    plots: Annotated[Path | None, typer.Option("--plots", help="Folder for charts.")] = None,
    frames: Annotated[int, typer.Option(min=5, max=100_000, help="Frames at most.")] = 1000,
    as_json: JsonOption = False,
) -> None:
    """Speed and score of the vision beside its peers: same frames, same truth, one thread."""
    from omnivert.bench.score.truth import truth_of
    from omnivert.threads import one_thread

    one_thread()
    source = opened(recording)
    frames = min(frames, count(source, FRAME))
    if not frames:
        raise DataError("OV101", f"there are no frames in {title(recording)}", help="omnivert bench vision corridor")
    chosen = source.config(with_mode(settings(config), mode))
    truths = truth_of(source)
    if plots is not None:
        make(plots)
    contenders = _contenders(source, chosen, frames, peers, peers_python)
    grown = _growth(source, chosen) if growth else None
    scores = {name: contender.score(truths) for name, contender in contenders.items()}
    if plots is not None:
        _plot(plots, contenders, scores, grown)
    if as_json:
        ours, *others = (contender.json(truths) for contender in contenders.values())
        body = {"recording": title(recording), "frames": frames, **ours}
        body["peers"] = dict(zip(list(contenders)[1:], others, strict=True))
        body["growth"] = None if grown is None else grown.json()
        say.json_result(body)
    else:
        _tell(contenders, scores, grown)


def _contenders(
    source: "Recording", config: "Config", frames: int, peers: bool, given: Path | None
) -> "dict[str, Contender]":
    """Ours first, then the peers by their short names."""
    from omnivert.bench.vision import vision_run

    if not peers:
        with say.progress(OURS, frames) as bar:
            return {OURS: vision_run(source, config, frames, None, bar.step)}
    from omnivert.bench.peers.contest import NAMES, peer_run
    from omnivert.bench.peers.environment import peers_python

    python = peers_python(given, say.story)
    with tempfile.TemporaryDirectory(prefix="omnivert-") as folder:
        with say.progress(OURS, frames) as bar:
            found = {OURS: vision_run(source, config, frames, Path(folder), bar.step)}
        for name, words in NAMES.items():
            with say.progress(words, frames) as bar:
                found[name] = peer_run(name, python, Path(folder), bar.step)
    return found


def _growth(source: "Recording", config: "Config") -> "Growth":
    from omnivert.bench.growth import POINTS, growth

    with say.progress("growth", POINTS) as bar:
        return growth(source, config, bar.step)


def make(folder: Path) -> None:
    """The folder for charts."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError("OV322", f"cannot write {folder}", error.strerror or str(error)) from error


def _plot(
    folder: Path,
    contenders: "Mapping[str, Contender]",
    scores: "Mapping[str, Score | None]",
    grown: "Growth | None",
) -> None:
    from omnivert.bench.charts import write_comparison, write_growth

    words = _words()
    comparison = folder / "vision-comparison.png"
    write_comparison(
        comparison,
        {words.get(name, name): contender for name, contender in contenders.items()},
        {words.get(name, name): score for name, score in scores.items()},
    )
    say.story(f"wrote   {comparison}")
    if grown is not None:
        write_growth(folder / "vision-growth.png", grown)
        say.story(f"wrote   {folder / 'vision-growth.png'}")


def _words() -> dict[str, str]:
    from omnivert.bench.peers.contest import NAMES

    return NAMES


def _tell(contenders: "Mapping[str, Contender]", scores: "Mapping[str, Score | None]", grown: "Growth | None") -> None:
    ours = contenders[OURS]
    table: list[tuple[str, ...]] = [("stage", "median ms", "p99 ms", "in Sobel pairs", "")]
    for stage, spread in (*ours.stages.items(), ("whole step", ours.step), ("sobel pair", ours.sobel_pair)):
        ratio = f"{spread.median_ms / ours.sobel_pair.median_ms:.1f}"
        table.append((stage, f"{spread.median_ms:.2f}", f"{spread.p99_ms:.2f}", ratio, ""))
    for row in results.aligned(table):
        say.result(row)
    say.result("")
    head = ("", "ms", "x Sobel", "lines", "true", "recall", "precision", "right", "false", "falsely new", "mrad", "")
    compared: list[tuple[str, ...]] = [head]
    for name, contender in contenders.items():
        times = (f"{contender.step.median_ms:.1f}", f"{contender.ratio_to_sobel:.0f}")
        compared.append((_words().get(name, name), *times, f"{contender.lines_per_frame:.1f}", *_figures(scores[name])))
    for row in results.aligned(compared):
        say.result(row)
    score = scores[OURS]
    if score is not None:
        chance = f"{100 * score.detection.precision_chance:.0f} %"
        say.result(f"lines a frame, links in %; lines strewn at random have a precision of {chance}")
    if grown is not None:
        say.result("")
        _tell_growth(grown)


def _figures(score: "Score | None") -> tuple[str, ...]:
    if score is None:
        return ("-",) * 7 + ("",)
    d, i, s = score.detection, score.identity, score.sharpness
    return (
        f"{d.correct_lines_per_frame:.1f}",
        f"{d.recall:.3f}",
        f"{d.precision:.3f}",
        f"{i.correct_percent:.2f}",
        f"{i.false_percent:.2f}",
        f"{i.false_new_percent:.2f}",
        f"{s.sigma_mrad:.2f}",
        "",
    )


def _tell_growth(grown: "Growth") -> None:
    table: list[tuple[str, ...]] = [("picture", "ring pixels", "lines", "ms", "")]
    for point in (*grown.sizes, *grown.frames, *grown.lines):
        what = "scaled" if point.drawn is None else f"{point.drawn} drawn"
        size = f"{point.width_px} x {point.height_px}, {what}"
        table.append((size, str(point.ring_pixels), f"{point.lines:.0f}", f"{point.vision_ms:.2f}", ""))
    for row in results.aligned(table):
        say.result(row)
    say.result(f"with the picture the time grows as (ring pixels)^{grown.exponent:.2f}")
    say.result(f"each line more takes {grown.us_per_line:.0f} us")
