"""The result in one picture: how the estimates came about, the last frame with its lines, and the robot from above."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnivert.messages import Estimate, State
from omnivert.pictures.mount import FAINT, INK, draw_mount
from omnivert.pictures.words import Quantity, colour, quantities, word

Axes = Any  # matplotlib has no types
Truth = tuple[float, float, float]  # phi, rho, psi; rad, m, rad

SIZE_IN = (16.0, 9.25)
DPI = 120
LEFT, TOP = 0.055, 0.885  # of the curves, as shares of the picture
LINES = ("#2f6690", "#c06c2b", "#6a4c93")  # phi, rho, psi
LABELS = ("φ, deg", "ρ, m", "ψ, deg")


def write_result(
    path: Path,
    estimates: Sequence[Estimate],
    robot: str,
    wheel_base_m: float,
    frame_bgr: NDArray[np.uint8] | None = None,
    truth: Truth | None = None,
) -> None:
    """Write the result picture as PNG.

    estimates  one per frame, in order; at least one
    frame_bgr  (H, W, 3) the last frame, lines already drawn into it
    """
    if not estimates:
        raise ValueError("a result picture needs at least one estimate")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_IN, dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3, 2, width_ratios=(1.62, 1.0), left=LEFT, right=0.985, top=TOP, bottom=0.06, wspace=0.07, hspace=0.14
    )
    _title(figure, estimates[-1], robot)
    _states_legend(figure, estimates)
    curves = [figure.add_subplot(grid[row, 0]) for row in range(3)]
    for index, axes in enumerate(curves):
        _curve(axes, estimates, index, truth)
        axes.tick_params(labelbottom=index == 2)
    curves[2].set_xlabel("frame", color=INK)
    right = grid[:, 1].subgridspec(2, 1, height_ratios=(1.0, 1.0), hspace=0.06)
    _photograph(figure.add_subplot(right[0]), frame_bgr)
    below = figure.add_subplot(right[1])
    mount = estimates[-1].mount
    if mount is None:
        _empty(below, "no single solution yet")
    else:
        draw_mount(below, mount, wheel_base_m, truth)
    figure.savefig(path, format="png", metadata={"Software": "omnivert"})


def _title(figure: Any, last: Estimate, robot: str) -> None:
    figure.text(0.055, 0.945, "omnivert", fontsize=19, fontweight="bold", color=INK, va="center")
    figure.text(0.148, 0.943, f"robot {robot}", fontsize=14, color=FAINT, va="center")
    figure.text(
        0.52,
        0.944,
        f" {word(last.state)} ",
        ha="center",
        fontsize=14,
        fontweight="bold",
        color="white",
        va="center",
        bbox={"boxstyle": "round,pad=0.35", "facecolor": colour(last.state), "edgecolor": "none"},
    )
    drive = f"{last.frame} frames   {last.driven_m:.1f} m driven   {math.degrees(last.turned_rad):.0f}° turned"
    figure.text(0.985, 0.943, drive, fontsize=12, color=FAINT, va="center", ha="right")


def _states_legend(figure: Any, estimates: Sequence[Estimate]) -> None:
    """Above the strips: which state each of their colours means, in the order in which they came."""
    from matplotlib.lines import Line2D

    words: dict[str, list[str]] = {}  # by colour, which some states share
    for state in dict.fromkeys(estimate.state for estimate in estimates):
        words.setdefault(colour(state), []).append(word(state))
    figure.legend(
        [Line2D([], [], color=ink, linewidth=4.0, solid_capstyle="butt") for ink in words],
        [" or ".join(names) for names in words.values()],
        loc="lower left",
        bbox_to_anchor=(LEFT, TOP),
        ncols=len(words),
        frameon=False,
        fontsize=10,
        labelcolor=INK,
        borderaxespad=0.3,
        borderpad=0.1,
        handlelength=2.2,
    )


def _series(estimates: Sequence[Estimate], index: int) -> NDArray[np.float64]:
    """(N, 3) frame, value, sigma in the unit people read; NaN where there was no solution.

    Angles are carried on without a jump at half a turn, ending at the last one's own value.
    """
    rows = []
    for estimate in estimates:
        part = quantities(estimate.mount)[index] if estimate.mount is not None else None
        rows.append((estimate.frame, math.nan, math.nan) if part is None else (estimate.frame, part.value, part.sigma))
    series = np.array(rows, dtype=np.float64)
    known = np.isfinite(series[:, 1])
    if index != 1 and known.any():
        last = series[known, 1][-1]
        series[known, 1] = last + np.mod(series[known, 1] - last + 180.0, 360.0) - 180.0
    return series


def _curve(axes: Axes, estimates: Sequence[Estimate], index: int, truth: Truth | None) -> None:
    series = _series(estimates, index)
    frame, value, sigma = series.T
    ink = LINES[index]
    _state_strip(axes, estimates)
    axes.fill_between(frame, value - sigma, value + sigma, color=ink, alpha=0.22, linewidth=0, label="± 1 sigma")
    axes.plot(frame, value, color=ink, linewidth=1.8, label="estimate")
    known = np.isfinite(value)
    target = _truth_of(truth, index, value[known][-1] if known.any() else 0.0)
    if target is not None:
        axes.axhline(target, color="#111111", linewidth=1.2, linestyle=(0, (6, 4)), label="truth")
    axes.set_ylim(*_limits(value, sigma, target))
    axes.set_xlim(frame[0], max(frame[-1], frame[0] + 1))
    axes.set_ylabel(LABELS[index], color=INK, fontsize=12)
    axes.grid(axis="y", color="#e6ebef", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#c3ccd3")
    axes.tick_params(colors="#6b7a86", labelsize=10)
    last = estimates[-1].mount
    if last is not None:
        _caption(axes, quantities(last)[index], target)
    if index == 0:
        axes.legend(loc="lower right", ncols=3, frameon=False, fontsize=10, labelcolor=INK)


def _caption(axes: Axes, part: Quantity, target: float | None) -> None:
    """The number itself, and how far it is from the truth in its own sigmas."""
    text = str(part)
    if target is not None and part.sigma > 0.0:
        text += f"     truth {target:.{part.decimals}f}, off by {abs(part.value - target) / part.sigma:.1f} sigma"
    axes.text(
        0.995,
        0.93,
        text,
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=12,
        color=INK,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2.5},
    )


def _state_strip(axes: Axes, estimates: Sequence[Estimate]) -> None:
    """A thin strip along the top in the state's colour; what comes before the first solution is shaded."""
    from matplotlib.transforms import blended_transform_factory

    across = blended_transform_factory(axes.transData, axes.transAxes)
    start = 0
    for end in range(1, len(estimates) + 1):
        if end == len(estimates) or estimates[end].state != estimates[start].state:
            left, right = estimates[start].frame, estimates[min(end, len(estimates) - 1)].frame
            state: State = estimates[start].state
            axes.fill_between([left, right], 0.985, 1.0, transform=across, color=colour(state), linewidth=0)
            start = end
    first = next((e.frame for e in estimates if e.mount is not None), estimates[-1].frame)
    if first > estimates[0].frame:
        axes.axvspan(estimates[0].frame, first, color="#f3f5f7", zorder=0)
        axes.text(
            (estimates[0].frame + first) / 2,
            0.88,
            "no single solution yet" if first - estimates[0].frame > 0.25 * len(estimates) else "",
            transform=across,
            ha="center",
            va="center",
            fontsize=9,
            color=FAINT,
        )


def _truth_of(truth: Truth | None, index: int, near: float) -> float | None:
    if truth is None:
        return None
    if index == 1:
        return truth[1]
    target = math.degrees(truth[index])
    return target - 360.0 * round((target - near) / 360.0)


def _limits(value: NDArray[np.float64], sigma: NDArray[np.float64], target: float | None) -> tuple[float, float]:
    """A range that shows the end well: the first sigmas may leave it."""
    known = np.isfinite(value)
    if not known.any():
        return (-1.0, 1.0) if target is None else (target - 1.0, target + 1.0)
    value, sigma = value[known], sigma[known]
    low, high = np.min(value - 1.3 * sigma), np.max(value + 1.3 * sigma)
    most = max(14.0 * sigma[-1], 1e-9)
    centre = value[-1]
    low, high = max(low, centre - most), min(high, centre + most)
    if target is not None:
        low, high = min(low, target - sigma[-1]), max(high, target + sigma[-1])
    margin = 0.12 * max(high - low, 1e-9)
    return float(low - margin), float(high + 2.6 * margin)  # the number stands above the curve


def _photograph(axes: Axes, frame_bgr: NDArray[np.uint8] | None) -> None:
    if frame_bgr is None:
        _empty(axes, "no picture in this recording")
        return
    axes.imshow(frame_bgr[:, :, ::-1], interpolation="lanczos")
    axes.axis("off")


def _empty(axes: Axes, text: str) -> None:
    axes.axis("off")
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", fontsize=12, color=FAINT)
