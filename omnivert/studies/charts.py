"""A study as pictures: errors over the bound, sigmas against errors, NEES against chi-square, verdicts."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from omnivert.messages import State
from omnivert.pictures.mount import FAINT, INK
from omnivert.pictures.words import colour, word
from omnivert.studies.presets import Case
from omnivert.studies.run import Run, Solution
from omnivert.studies.summary import bootstrap, efficiency

Array = NDArray[np.float64]
Axes = Any  # matplotlib has no types
Parts = list[tuple[Run, Solution]]

FILTER, SMOOTHER, LIMIT = "#2f6690", "#8fb3c9", "#c06c2b"
GRID = "#e6e9ec"
DPI = 130
PARAMETERS = (("φ", "deg", 180.0 / np.pi), ("ρ", "mm", 1e3), ("ψ", "deg", 180.0 / np.pi))


def write_charts(folder: Path, cases: Sequence[Case], runs: Sequence[Run], seed: int) -> list[Path]:
    """The pictures that these runs allow, in this folder.

    seed     of the bootstrap
    returns  the files written
    """
    made: list[Path] = []
    estimated = any(run.filter is not None or run.smoother is not None for run in runs)
    for name, draw, needs in (
        ("montecarlo-efficiency.png", write_efficiency, estimated),
        ("montecarlo-nees.png", write_nees, estimated),
        ("montecarlo-sigma.png", write_sigma, estimated),
        ("montecarlo-verdicts.png", write_verdicts, True),
    ):
        if needs:
            draw(folder / name, cases, runs, seed)
            made.append(folder / name)
    return made


def write_efficiency(path: Path, cases: Sequence[Case], runs: Sequence[Run], seed: int) -> None:
    """rms of error / bound by parameter, with 95 % bands of the bootstrap."""
    shown = [case for case in cases if _of(runs, _filter, case) or _of(runs, _smoother, case)]
    height = 1.75 + 0.62 * len(shown)
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(
        1, 3, left=0.165, right=0.985, top=1.0 - 1.15 / height, bottom=0.42 / height, wspace=0.07
    )
    most = 1.5
    axes = [figure.add_subplot(grid[k]) for k in range(3)]
    for row, case in enumerate(reversed(shown)):
        for take, offset, tone in ((_smoother, -0.15, SMOOTHER), (_filter, 0.15, FILTER)):
            parts = _of(runs, take, case)
            values, bands = efficiency(parts), bootstrap(parts, seed)
            if values is None or bands is None:
                continue
            for k in range(3):
                low, high = bands[k]
                axes[k].plot([low, high], [row + offset] * 2, color=tone, lw=6.0, alpha=0.45, solid_capstyle="butt")
                axes[k].plot(values[k], row + offset, "o", color=tone, ms=7.0, zorder=4)
                most = max(most, 1.06 * high)
    most = min(most, 3.0)  # what lies beyond is far enough
    for k, one in enumerate(axes):
        one.axvline(1.0, color=LIMIT, lw=1.3, ls=(0, (4, 3)), zorder=1)
        one.set(xlim=(0.0, most), ylim=(-0.6, len(shown) - 0.4))
        one.set_yticks(range(len(shown)), [case.name for case in reversed(shown)])
        one.set_title(PARAMETERS[k][0], loc="left", fontsize=13, color=INK, pad=7)
        plain(one, "x")
        one.tick_params(labelleft=k == 0)
        for label in one.get_yticklabels():
            label.set(color=INK, fontsize=11)
    titled(figure, height, "Errors over the Cramér-Rao bound", "rms of error / own bound, with 95 % bands")
    keyed(figure, height, (("filter", FILTER), ("smoother", SMOOTHER), ("bound", LIMIT)))
    saved(figure, path)


def write_nees(path: Path, cases: Sequence[Case], runs: Sequence[Run], seed: int) -> None:
    """How NEES is spread, against chi-square of 3."""
    height = 4.6
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(1, 2, left=0.05, right=0.985, top=1.0 - 1.15 / height, bottom=0.13, wspace=0.1)
    edges = np.linspace(0.0, 16.0, 33)
    x = np.linspace(0.0, 16.0, 400)
    tallest = 0.0
    axes = []
    for place, (name, take, tone) in enumerate((("filter", _filter, FILTER), ("smoother", _smoother, SMOOTHER))):
        one = figure.add_subplot(grid[place])
        axes.append(one)
        values = np.array([part.nees for _, part in _of(runs, take)])
        beyond = int((values > edges[-1]).sum())
        if values.size:
            weight = np.full(values.size, 1.0 / values.size / (edges[1] - edges[0]))
            tall, *_ = one.hist(np.minimum(values, edges[-1]), edges, weights=weight, color=tone, zorder=2, rwidth=0.92)
            tallest = max(tallest, float(tall.max()))
        one.plot(x, chi2.pdf(x, 3), color=LIMIT, lw=2.0, zorder=3)
        mean = f"mean / 3 = {values.mean() / 3.0:.2f}, " if values.size else ""
        tail = f", {beyond} beyond {edges[-1]:.0f} (in the last bar)" if beyond else ""
        one.set_title(f"{name}: {mean}{values.size} runs{tail}", loc="left", fontsize=11, color=INK, pad=7)
        one.set(xlim=(0.0, edges[-1]), xlabel="NEES of φ, ρ and ψ")
        plain(one, "y")
    for one in axes:
        one.set_ylim(0.0, 1.08 * max(tallest, 0.25))
    titled(figure, height, "Are the claimed covariances true?", "share of runs per unit of NEES")
    keyed(figure, height, (("chi-square of 3", LIMIT),))
    saved(figure, path)


def write_sigma(path: Path, cases: Sequence[Case], runs: Sequence[Run], seed: int) -> None:
    """Each error against the sigma that was claimed with it."""
    height = 4.9
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(1, 3, left=0.06, right=0.985, top=1.0 - 1.15 / height, bottom=0.13, wspace=0.2)
    filters, smoothers = _of(runs, _filter), _of(runs, _smoother)
    for k, (name, unit, scale) in enumerate(PARAMETERS):
        one = figure.add_subplot(grid[k])
        for parts, tone, size in ((smoothers, SMOOTHER, 30.0), (filters, FILTER, 13.0)):
            sigma = np.array([scale * part.sigma[k] for _, part in parts])
            error = np.array([scale * abs(part.error[k]) for _, part in parts])
            one.scatter(sigma, np.maximum(error, 1e-12), s=size, color=tone, alpha=0.75, linewidths=0, zorder=3)
        sigmas = [scale * part.sigma[k] for _, part in (*filters, *smoothers)]
        errors = np.array([scale * abs(part.error[k]) for _, part in (*filters, *smoothers)])
        low, high = 0.8 * min(sigmas), 1.25 * max(sigmas)
        ends = np.array([low, high])
        for times, style in ((1.0, (0, (1, 2))), (3.0, (0, (4, 3)))):
            one.plot(ends, times * ends, color=LIMIT, lw=1.3, ls=style, zorder=2)
            one.annotate(f"{times:.0f} σ", (low, times * low), (4, 9), textcoords="offset points", color=LIMIT,
                         fontsize=9)  # fmt: skip
        floor = low / 50.0  # what is nearer to the truth than this stands at the edge
        one.set(xscale="log", yscale="log", xlim=(low, high))
        one.set_ylim(floor, max(4.5 * high, 1.3 * float(errors.max())))
        one.set(xlabel=f"sigma, {unit}", ylabel=f"|error|, {unit}")
        one.set_title(name, loc="left", fontsize=13, color=INK, pad=7)
        plain(one, "both")
        _plain_numbers(one)
    titled(figure, height, "Errors against claimed sigmas", "each dot a run; honest sigmas leave 68 % below 1 σ")
    keyed(figure, height, (("filter", FILTER), ("smoother", SMOOTHER)))
    saved(figure, path)


def write_verdicts(path: Path, cases: Sequence[Case], runs: Sequence[Run], seed: int) -> None:
    """Share of runs that end in each state, by case; false claims stand beside."""
    height = 1.75 + 0.5 * len(cases)
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(1, 1, left=0.165, right=0.86, top=1.0 - 1.15 / height, bottom=0.42 / height)
    one = figure.add_subplot(grid[0])
    for row, case in enumerate(reversed(cases)):
        own = [run for run in runs if run.case == case.name]
        left = 0.0
        for state in State:
            share = 100.0 * sum(run.state is state for run in own) / max(1, len(own))
            if share == 0.0:
                continue
            one.barh(row, share, left=left, height=0.62, color=colour(state), zorder=2)
            if share >= 6.0:
                one.annotate(f"{share:.0f}", (left + 0.5 * share, row), ha="center", va="center", color="white",
                             fontsize=10)  # fmt: skip
            left += share
        false = sum(bool(run.false_claims) for run in own)
        words = f"{len(own)} runs, " + (f"{false} false" if false else "none false")
        one.annotate(words, (100.0, row), (9, 0), textcoords="offset points", va="center", fontsize=10.5,
                     color=LIMIT if false else INK, annotation_clip=False)  # fmt: skip
    one.set(xlim=(0.0, 100.0), ylim=(-0.55, len(cases) - 0.45))
    one.set_yticks(range(len(cases)), [case.name for case in reversed(cases)])
    plain(one, "x")
    for label in one.get_yticklabels():
        label.set(color=INK, fontsize=11)
    titled(figure, height, "How the drives ended", "% of runs, by the state at the end")
    present = [state for state in State if any(run.state is state for run in runs)]
    keyed(figure, height, tuple((word(state), colour(state)) for state in present))
    saved(figure, path)


def _filter(run: Run) -> Solution | None:
    return run.filter


def _smoother(run: Run) -> Solution | None:
    return run.smoother


def _of(runs: Sequence[Run], take: Callable[[Run], Solution | None], case: Case | None = None) -> Parts:
    chosen = (run for run in runs if case is None or run.case == case.name)
    return [(run, part) for run in chosen if (part := take(run)) is not None]


def figure_of(size: tuple[float, float]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def titled(figure: Any, height: float, title: str, below: str) -> None:
    figure.text(0.012, 1.0 - 0.32 / height, title, fontsize=15, fontweight="bold", color=INK, va="center")
    figure.text(0.012, 1.0 - 0.64 / height, below, fontsize=10.5, color=FAINT, va="center")


def keyed(figure: Any, height: float, entries: Sequence[tuple[str, str]]) -> None:
    """What the colours mean, from the right edge of the title's line."""
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], marker="s", ls="", ms=9, color=tone) for _, tone in entries]
    figure.legend(
        marks, [name for name, _ in entries], ncols=len(entries), loc="center right", frameon=False, fontsize=10.5,
        bbox_to_anchor=(0.99, 1.0 - 0.34 / height), handletextpad=0.3, columnspacing=1.4, labelcolor=INK,
    )  # fmt: skip


def plain(axes: Axes, grid: str) -> None:
    axes.grid(axis=grid, color=GRID, lw=0.9, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(length=0, colors=FAINT, labelsize=9, which="both")
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)
    for side in axes.spines.values():
        side.set_visible(False)


def _plain_numbers(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for axis, steps in ((axes.xaxis, (1.0, 2.0, 5.0)), (axes.yaxis, (1.0,))):
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def saved(figure: Any, path: Path) -> None:
    figure.savefig(path, format="png", metadata={"Software": "omnivert"})
