"""The comparison and the growth as pictures."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omnivert.bench.calibration import CalibrationTimes
from omnivert.bench.contender import Contender
from omnivert.bench.growth import Growth, Point
from omnivert.bench.score.score import Score
from omnivert.pictures.mount import FAINT, INK

Axes = Any  # matplotlib has no types

OURS, PEER, CHANCE = "#2f6690", "#b9c4cc", "#c06c2b"
GRID = "#e6e9ec"
DPI = 130


def write_comparison(path: Path, contenders: Mapping[str, Contender], scores: Mapping[str, Score | None]) -> None:
    """Time, and where the truth is known how right each is, as bars; the first contender is ours."""
    names = list(contenders)
    known = [score for score in scores.values() if score is not None]
    panels = 6 if len(known) == len(names) else 1
    height = 1.5 + 0.52 * len(names)
    figure = _figure((17.0 if panels > 1 else 7.0, height))
    left = 0.098 if panels > 1 else 0.22
    top, bottom = 1.0 - 0.95 / height, 0.42 / height
    grid = figure.add_gridspec(1, panels, left=left, right=0.985, top=top, bottom=bottom, wspace=0.14)
    axes = [figure.add_subplot(grid[k]) for k in range(panels)]
    _bars(axes[0], names, [c.ratio_to_sobel for c in contenders.values()], "time, in pairs of Sobel filters")
    if panels > 1:
        detections, identities = [s.detection for s in known], [s.identity for s in known]
        _bars(axes[1], names, [d.correct_lines_per_frame for d in detections], "true lines found in a frame")
        _bars(axes[2], names, [100.0 * d.recall for d in detections], "strong lines found, %", most=100.0)
        _bars(axes[3], names, [100.0 * d.precision for d in detections], "found lines that exist, %", most=100.0)
        _chance(axes[3], [100.0 * d.precision_chance for d in detections])
        _bars(axes[4], names, [i.correct_percent for i in identities], "links right, %", "{:.1f}", 100.0)
        false = [i.false_percent for i in identities]
        wrong = [i.false_percent + i.false_new_percent for i in identities]
        _bars(axes[5], names, wrong, "links wrong, %", "{:.1f}")
        axes[5].barh(range(len(names), 0, -1), false, height=0.62, color=CHANCE, zorder=3)
        _note(axes[5], false[0], len(names), "orange: to another line")
        for other in axes[1:]:
            other.tick_params(labelleft=False)
    title = "Vertical lines in the same frames, on one thread"
    figure.text(0.012, 1.0 - 0.34 / height, title, fontsize=15, fontweight="bold", color=INK, va="center")
    _save(figure, path)


def write_growth(path: Path, growth: Growth) -> None:
    """Time over ring pixels and over lines found."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    figure = _figure((12.0, 4.9))
    grid = figure.add_gridspec(1, 2, left=0.06, right=0.98, top=0.82, bottom=0.135, wspace=0.15)
    sizes, lines = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    sizes.set(xscale="log", yscale="log", xlabel="ring, thousand pixels", ylabel="whole step, ms")
    for axis in (sizes.xaxis, sizes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_locator(NullLocator())
    ring = [1e-3 * p.ring_pixels for p in growth.sizes]
    proportion = max(growth.sizes[0].vision_ms / ring[0], growth.sizes[-1].vision_ms / ring[-1])
    sizes.plot(ring, [proportion * r for r in ring], color=CHANCE, lw=1.2, ls=(0, (4, 3)), label="in proportion")
    counts = [p.lines for p in growth.frames]
    words = f"frames scaled ({min(counts):.0f} to {max(counts):.0f} lines)"
    _curve(sizes, ring, growth.frames, PEER, words)
    _curve(sizes, ring, growth.sizes, OURS, f"drawn, {growth.sizes[0].drawn} lines")
    for point in (growth.sizes[0], growth.sizes[2], growth.sizes[-1]):
        sizes.annotate(
            f"{point.width_px} x {point.height_px}", (1e-3 * point.ring_pixels, 0.02), (0, 0),
            xycoords=("data", "axes fraction"), textcoords="offset points", color=FAINT, fontsize=9,
            ha="left" if point is growth.sizes[0] else "right" if point is growth.sizes[-1] else "center",
        )  # fmt: skip
    sizes.set_ylim(bottom=0.6 * min(p.vision_ms for p in (*growth.sizes, *growth.frames)))
    sizes.set_title(f"picture size: time as ring pixels to the {growth.exponent:.2f}", **_TITLE)
    sizes.legend(frameon=False, fontsize=9.5, labelcolor=INK, loc="upper left")
    _curve(lines, [p.lines for p in growth.lines], growth.lines, OURS, "")
    lines.set(xlabel="lines found", ylabel="whole step, ms", xlim=(0, None), ylim=(0, None))
    lines.set_title(f"lines: {growth.us_per_line:.0f} µs each", **_TITLE)
    figure.text(0.012, 0.945, "What the vision's time grows with", fontsize=15, fontweight="bold", color=INK)
    _save(figure, path)


def write_calibration_growth(path: Path, times: CalibrationTimes) -> None:
    """Time of a filter step over lines, and of the global start over the drive's length."""
    figure = _figure((12.0, 4.9))
    grid = figure.add_gridspec(1, 2, left=0.065, right=0.98, top=0.82, bottom=0.135, wspace=0.17)
    lines, drives = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    count = [p.lines for p in times.filter]
    _log(lines, count, "lines seen in each frame", "a step of the filter, ms")
    _points(lines, count, [p.step.median_ms for p in times.filter], OURS, "predict and update, median")
    _points(lines, count, [p.step.p99_ms for p in times.filter], PEER, "99th percentile")
    _points(lines, count, [p.watchdog.median_ms for p in times.filter], CHANCE, "watchdog, median")
    yard = times.sobel_pair.median_ms
    lines.axhline(yard, color=FAINT, lw=1.0, ls=(0, (4, 3)), zorder=1, label="a pair of Sobel filters")
    lines.set_title(f"lines: from the last but one to the last as lines to the {times.filter_exponent:.1f}", **_TITLE)
    lines.legend(frameon=False, fontsize=9.5, labelcolor=INK, loc="upper left")
    length = [p.drive_s for p in times.start]
    _log(drives, length, "drive, s", "global start over all of it, s")
    drives.set(yscale="linear", ylim=(0.0, 1.15 * max(p.seconds for p in times.start)))
    _points(drives, length, [p.seconds for p in times.start], OURS, "")
    drives.set_title(f"length: as seconds of the drive to the {times.start_exponent:.1f}", **_TITLE)
    figure.text(0.012, 0.945, "What the calibration's time grows with", fontsize=15, fontweight="bold", color=INK)
    _save(figure, path)


_TITLE = {"loc": "left", "fontsize": 11, "color": INK, "pad": 9}


def _figure(size: tuple[float, float]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def _bars(
    axes: Axes, names: Sequence[str], values: Sequence[float], title: str, form: str = "{:.0f}", most: float = 0.0
) -> None:
    """A bar for each name, the first on top and in our colour.

    most  end of the axis; 0: by the longest bar
    """
    place = range(len(names), 0, -1)
    axes.barh(place, values, height=0.62, color=[OURS, *[PEER] * (len(names) - 1)], zorder=2)
    limit = most or max((v for v in values if math.isfinite(v)), default=1.0)
    for rank, (y, value) in enumerate(zip(place, values, strict=True)):
        known = math.isfinite(value)
        inside = known and value > 0.55 * limit
        axes.annotate(
            form.format(value) if known else "-", (value if known else 0.0, y), (-5 if inside else 5, 0),
            textcoords="offset points", ha="right" if inside else "left", va="center", zorder=4, fontsize=9.5,
            color="white" if inside and rank == 0 else INK, fontweight="bold" if rank == 0 else "normal",
        )  # fmt: skip
    axes.set_yticks(list(place), list(names))
    axes.set_xlim(0.0, most or 1.06 * limit)
    axes.set_ylim(0.45, len(names) + 0.55)
    axes.set_title(title, **_TITLE)
    axes.grid(axis="x", color=GRID, lw=0.9, zorder=0)
    axes.tick_params(length=0, colors=FAINT, labelsize=9)
    for tick in axes.get_yticklabels():
        tick.set(color=INK, fontsize=11)
    _bare(axes)


def _chance(axes: Axes, values: Sequence[float]) -> None:
    """A mark across each bar, and what it means."""
    place = range(len(values), 0, -1)
    for y, value in zip(place, values, strict=True):
        axes.plot([value, value], [y - 0.31, y + 0.31], color=CHANCE, lw=2.2, zorder=5)
    _note(axes, values[0], len(values), "by chance")


def _note(axes: Axes, value: float, names: int, text: str) -> None:
    """A word on what stands in the first bar, between it and the next."""
    axes.annotate(
        text, (value, names - 0.5), (5, 0), textcoords="offset points", color=CHANCE, fontsize=8.5, va="center"
    )


def _log(axes: Axes, x: Sequence[float], across: str, up: str) -> None:
    """Both axes logarithmic, with a mark at each x."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set(xscale="log", yscale="log", xlabel=across, ylabel=up)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xticks(list(x))


def _points(axes: Axes, x: Sequence[float], y: Sequence[float], colour: str, label: str) -> None:
    axes.plot(x, y, color=colour, lw=2.0, marker="o", ms=5.5, zorder=3, label=label)
    axes.grid(color=GRID, lw=0.9, zorder=0)
    axes.tick_params(colors=FAINT, labelsize=9, which="both", length=0)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    _bare(axes)


def _curve(axes: Axes, x: Sequence[float], points: Sequence[Point], colour: str, label: str) -> None:
    _points(axes, x, [p.vision_ms for p in points], colour, label)


def _bare(axes: Axes) -> None:
    for side in axes.spines.values():
        side.set_visible(False)


def _save(figure: Any, path: Path) -> None:
    figure.savefig(path, format="png", metadata={"Software": "omnivert"})
