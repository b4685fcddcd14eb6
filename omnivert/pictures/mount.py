"""The robot seen from above, with its camera, how sure that is, and what phi, rho and psi mean (Fig. 19)."""

import math
from typing import Any

import numpy as np

from omnivert.messages import Mount
from omnivert.pictures.words import Quantity, quantities

Axes = Any  # matplotlib has no types

INK = "#22303c"
FAINT = "#9aa7b1"
CAMERA = "#d1495b"
TRUTH = "#111111"


def draw_mount(axes: Axes, mount: Mount, wheel_base_m: float, truth: tuple[float, float, float] | None = None) -> None:
    """Robot from above, x ahead is up, y to the left; camera with its 1-sigma ellipse and heading wedge.

    axes   a matplotlib axes, cleared
    truth  phi, rho, psi in rad, m, rad, where known
    """
    span = max(1.5 * mount.rho_m, 0.72 * wheel_base_m)
    _frame(axes, mount, wheel_base_m, span)
    _robot(axes, wheel_base_m, span)
    phi, rho, psi = quantities(mount)
    enlarged = _camera(axes, mount, span, psi)
    _angles(axes, mount, span)
    if truth is not None:
        u, v = _direction(truth[0], truth[1])
        axes.plot(u, v, marker="+", markersize=15, color=TRUTH, markeredgewidth=1.6, zorder=9)
    _legend(axes, (phi, rho, psi), enlarged)


def _frame(axes: Axes, mount: Mount, base: float, span: float) -> None:
    """Limits that hold robot, camera and its heading, in the shape of the axes, with room at the left for numbers."""
    heading = mount.phi_rad + mount.psi_rad
    camera = np.array(_direction(mount.phi_rad, mount.rho_m))
    points = np.array(
        [
            (-0.62 * base, -0.56 * base),
            (0.62 * base, 0.56 * base),
            _direction(0.0, 0.9 * span),
            camera + _direction(heading, 0.66 * span),
            camera + _direction(mount.phi_rad, 0.5 * span),
        ]
    )
    low, high = points.min(axis=0) - 0.06 * span, points.max(axis=0) + 0.06 * span
    box = axes.get_window_extent()
    scale = max((high[0] - low[0]) / (0.72 * box.width), (high[1] - low[1]) / (0.92 * box.height))  # m a pixel
    middle = 0.5 * (low + high)
    axes.set_aspect("equal")
    axes.set_xlim(middle[0] - 0.60 * scale * box.width, middle[0] + 0.40 * scale * box.width)
    axes.set_ylim(middle[1] - 0.48 * scale * box.height, middle[1] + 0.52 * scale * box.height)
    axes.axis("off")


def _screen(x: float, y: float) -> tuple[float, float]:
    """Where the robot's (x ahead, y left) is on paper (right, up)."""
    return -y, x


def _direction(angle: float, length: float = 1.0) -> tuple[float, float]:
    return _screen(length * math.cos(angle), length * math.sin(angle))


def _robot(axes: Axes, base: float, span: float) -> None:
    from matplotlib.patches import FancyBboxPatch

    half, wheel = 0.5 * base, 0.19 * base
    body = FancyBboxPatch(
        (-0.42 * base, -0.5 * base),
        0.84 * base,
        1.0 * base,
        boxstyle=f"round,pad=0,rounding_size={0.2 * base}",
        facecolor="#eef2f5",
        edgecolor="#c3ccd3",
        linewidth=1.2,
        zorder=1,
    )
    axes.add_patch(body)
    for side in (-1, 1):
        axes.add_patch(
            FancyBboxPatch(
                (side * half - 0.045 * base, -wheel),
                0.09 * base,
                2 * wheel,
                boxstyle=f"round,pad=0,rounding_size={0.03 * base}",
                facecolor="#4a5862",
                edgecolor="none",
                zorder=2,
            )
        )
    axes.plot([-half, half], [0, 0], color="#c3ccd3", linewidth=1.4, zorder=2)
    for angle, name, offset in ((0.0, "x", (0.05, 0.0)), (math.pi / 2, "y", (0.0, 0.05))):
        tip = _direction(angle, 0.86 * span)
        axes.annotate(
            "",
            tip,
            (0, 0),
            arrowprops={"arrowstyle": "-|>,head_width=0.22,head_length=0.45", "color": FAINT, "linewidth": 1.1},
            zorder=3,
        )
        axes.text(tip[0] + offset[0] * span, tip[1] + offset[1] * span, name, color=FAINT, fontsize=11, style="italic")
    axes.plot(0, 0, "o", color=INK, markersize=4.5, zorder=6)


def _camera(axes: Axes, mount: Mount, span: float, psi: Quantity) -> float:
    """Place, ellipse and heading; returns by how much the ellipse is enlarged."""
    from matplotlib.patches import Ellipse, Wedge

    u, v = _direction(mount.phi_rad, mount.rho_m)
    heading = mount.phi_rad + mount.psi_rad
    towards = math.degrees(heading) + 90.0  # on paper, from right
    sigma = min(max(psi.sigma, 0.0), 180.0)
    axes.add_patch(Wedge((u, v), 0.62 * span, towards - sigma, towards + sigma, facecolor=CAMERA, alpha=0.28, zorder=4))
    tip = _direction(heading, 0.62 * span)
    axes.annotate(
        "",
        (u + tip[0], v + tip[1]),
        (u, v),
        arrowprops={"arrowstyle": "-|>,head_width=0.3,head_length=0.6", "color": CAMERA, "linewidth": 1.8},
        zorder=7,
    )
    width, height, angle = _ellipse(mount)
    enlarged = 5.0 if max(width, height) < 0.06 * span else 1.0
    axes.add_patch(
        Ellipse(
            (u, v),
            enlarged * width,
            enlarged * height,
            angle=angle,
            facecolor=CAMERA,
            edgecolor=CAMERA,
            alpha=0.35,
            linewidth=1.2,
            zorder=5,
        )
    )
    axes.plot(u, v, "o", color=CAMERA, markersize=5.5, markeredgecolor="white", markeredgewidth=0.8, zorder=8)
    return enlarged


def _ellipse(mount: Mount) -> tuple[float, float, float]:
    """1-sigma ellipse of the camera's place on paper: two full axes in m, the first one's angle in deg."""
    c, s = math.cos(mount.phi_rad), math.sin(mount.phi_rad)
    polar = np.array([[-mount.rho_m * s, c], [mount.rho_m * c, s]])  # d(x, y) / d(phi, rho)
    to_paper = np.array([[0.0, -1.0], [1.0, 0.0]])
    covariance = to_paper @ polar @ mount.covariance[:2, :2] @ polar.T @ to_paper.T
    values, vectors = np.linalg.eigh(covariance)
    big, small = math.sqrt(max(values[1], 0.0)), math.sqrt(max(values[0], 0.0))
    return 2 * big, 2 * small, math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))


def _angles(axes: Axes, mount: Mount, span: float) -> None:
    """rho as the line from origin to camera, phi and psi as arcs, each with its letter."""
    u, v = _direction(mount.phi_rad, mount.rho_m)
    axes.plot([0, u], [0, v], color=INK, linewidth=1.6, zorder=6)
    beyond = _direction(mount.phi_rad, 0.45 * span)
    axes.plot([u, u + beyond[0]], [v, v + beyond[1]], color=INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=5)
    _arc(axes, (0.0, 0.0), 0.42 * mount.rho_m + 0.12 * span, 0.0, mount.phi_rad)
    _arc(axes, (u, v), 0.34 * span, mount.phi_rad, mount.psi_rad)
    middle = mount.phi_rad / 2
    place = _direction(middle, 0.42 * mount.rho_m + 0.23 * span)
    axes.text(*place, "φ", color=INK, fontsize=14, ha="center", va="center", zorder=9)
    middle = mount.phi_rad + mount.psi_rad / 2
    place = _direction(middle, 0.44 * span)
    axes.text(u + place[0], v + place[1], "ψ", color=INK, fontsize=14, ha="center", va="center", zorder=9)
    aside = _direction(mount.phi_rad + math.copysign(math.pi / 2, mount.phi_rad or 1.0), 0.09 * span)
    axes.text(0.55 * u + aside[0], 0.55 * v + aside[1], "ρ", color=INK, fontsize=14, ha="center", va="center", zorder=9)


def _arc(axes: Axes, centre: tuple[float, float], radius: float, start: float, sweep: float) -> None:
    angles = np.linspace(start, start + sweep, 60)
    points = np.array([_direction(float(angle), radius) for angle in angles]) + centre
    axes.plot(points[:, 0], points[:, 1], color=INK, linewidth=1.2, zorder=6)
    if abs(sweep) * radius > 0:
        axes.annotate(
            "",
            points[-1],
            points[-6],
            arrowprops={"arrowstyle": "-|>,head_width=0.15,head_length=0.3", "color": INK, "linewidth": 0.9},
            zorder=6,
        )


def _legend(axes: Axes, parts: tuple[Quantity, Quantity, Quantity], enlarged: float) -> None:
    """The numbers behind the letters, and a scale, where the frame left room for them."""
    for row, (letter, part) in enumerate(zip("φρψ", parts, strict=True)):
        axes.text(
            0.0, 0.95 - 0.085 * row, f"{letter}  {part}", transform=axes.transAxes, color=INK, fontsize=12, va="center"
        )
    if enlarged > 1.0:
        note = f"ellipse of 1 sigma drawn {enlarged:g} times its size"
        axes.text(0.0, 0.02, note, transform=axes.transAxes, color=FAINT, fontsize=9)
    left, right = axes.get_xlim()
    length = next(s for s in (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.0) if s < 0.25 * (right - left))
    low, high = axes.get_ylim()
    floor = low + 0.02 * (high - low)
    axes.plot([right - length, right], [floor, floor], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes.text(right - length / 2, floor + 0.02 * (high - low), f"{length:g} m", color=INK, fontsize=9, ha="center")
