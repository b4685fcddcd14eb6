"""The paper's model: how a line's place relative to the robot changes, and the bearing that the camera sees.

Frames (Figs. 18, 19): D is the distance robot origin - line, theta the robot's heading relative to the direction
line -> robot; the camera sits at (rho cos phi, rho sin phi) on the robot and heads to phi + psi. So the line stands at
D (-cos theta, sin theta) in the robot frame. `w` is 1/D.
"""

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.compiled import compiled

Array = NDArray[np.float64]


@compiled
def _short_way(angle: float) -> float:
    """`angles.wrap` for one number in a loop."""
    turned = angle - TURN * np.rint(angle / TURN)
    return np.pi if turned <= -np.pi else min(turned, np.pi)


@compiled
def wrapped(angle: Array) -> Array:
    """`angles.wrap` of many (N,), for a tenth of the time."""
    turned = np.empty(angle.size)
    for i in range(angle.size):
        turned[i] = _short_way(angle[i])
    return turned


def bearing(distance: Array, heading: Array, phi: float, rho: float, psi: float) -> Array:
    """Bearing of vertical lines in the camera frame (eqs. 23, 27).

    distance  (N,)  m    D
    heading   (N,)  rad  theta
    phi, rho, psi        rad, m, rad
    returns   (N,)  rad, (-pi, pi], counter-clockwise from the camera's x axis
    """
    a = heading + phi
    # The four-quadrant arctangent: the printed one knows only half of the circle.
    return wrap(np.arctan2(-rho * np.sin(a), -distance - rho * np.cos(a)) - heading - phi - psi)


def bearing_slopes(distance: Array, heading: Array, phi: float, rho: float) -> Array:
    """Slope of the bearing by D, theta, phi, rho, psi (appendix); (N, 5)."""
    a = heading + phi
    q = distance**2 + rho**2 + 2.0 * distance * rho * np.cos(a)
    g = (rho**2 + distance * rho * np.cos(a)) / q
    return np.stack([-rho * np.sin(a) / q, g - 1.0, g - 1.0, distance * np.sin(a) / q, -np.ones_like(a)], axis=-1)


@compiled
def bearing_inverse(w: Array, heading: Array, phi: float, rho: float, psi: float) -> Array:
    """`bearing` with 1/D in place of D; a line at infinity (w = 0) is the limit of eq. 25."""
    beta = np.empty(w.size)
    for i in range(w.size):
        a, near = heading[i] + phi, w[i] * rho
        beta[i] = _short_way(np.arctan2(-near * np.sin(a), -1.0 - near * np.cos(a)) - a - psi)
    return beta


@compiled
def bearing_inverse_slopes(w: Array, heading: Array, phi: float, rho: float) -> Array:
    """Slope of the bearing by 1/D, theta, phi, rho, psi; (N, 5)."""
    slopes = np.empty((w.size, 5))
    for i in range(w.size):
        a, near = heading[i] + phi, w[i] * rho
        cos_a, sin_a = np.cos(a), np.sin(a)
        q = 1.0 + near * near + 2.0 * near * cos_a
        by_heading = (near * near + near * cos_a) / q - 1.0
        slopes[i, 0] = rho * sin_a / q
        slopes[i, 1] = by_heading
        slopes[i, 2] = by_heading
        slopes[i, 3] = w[i] * sin_a / q
        slopes[i, 4] = -1.0
    return slopes


def moved_first_order(
    distance: Array, heading: Array, right: float, left: float, base: float
) -> tuple[Array, Array, Array, Array]:
    """Lines after one step of the robot, first order in the way (eq. 26), with slopes (appendix).

    distance, heading  (N,)  m, rad
    right, left              m        wheel displacements
    base                     m
    returns  distance (N,), heading (N,), slope by (D, theta) (N, 2, 2), slope by (right, left) (N, 2, 2)
    """
    way, turn = 0.5 * (right + left), (right - left) / base
    cos_t, sin_t = np.cos(heading), np.sin(heading)
    by_state = np.empty((distance.size, 2, 2))
    by_state[:, 0, 0] = 1.0
    by_state[:, 0, 1] = -way * sin_t
    by_state[:, 1, 0] = way * sin_t / distance**2
    by_state[:, 1, 1] = 1.0 - way / distance * cos_t
    by_wheel = np.empty((distance.size, 2, 2))
    by_wheel[:, 0, :] = 0.5 * cos_t[:, None]
    by_wheel[:, 1, 0] = 1.0 / base - 0.5 * sin_t / distance
    by_wheel[:, 1, 1] = -1.0 / base - 0.5 * sin_t / distance
    return distance + way * cos_t, wrap(heading + turn - way / distance * sin_t), by_state, by_wheel


@compiled
def moved_exactly(w: Array, heading: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """Lines after any motion of the robot, exactly, with slopes.

    w, heading  (N,)  1/m, rad
    step        (3,)  m, m, rad   the robot's motion in its own frame, e.g. arcs of eq. 14 joined
    returns     w (N,), heading (N,), slope by (w, theta) (N, 2, 2), slope by step (N, 2, 3)

    Paper: first order in way / distance (eq. 26). Here: exact, because it costs no more and lines stand close.
    """
    dx, dy, turn = step[0], step[1], step[2]
    new_w, new_heading = np.empty(w.size), np.empty(w.size)
    by_state, by_step = np.empty((w.size, 2, 2)), np.zeros((w.size, 2, 3))
    for i in range(w.size):
        cos_t, sin_t = np.cos(heading[i]), np.sin(heading[i])
        x, y = -cos_t - w[i] * dx, sin_t - w[i] * dy  # the line in the new place, in units of the old distance
        r2 = x * x + y * y
        r = np.sqrt(r2)
        # w' = w / r, theta' = pi - (atan2(y, x) - turn)
        new_w[i], new_heading[i] = w[i] / r, _short_way(np.pi - np.arctan2(y, x) + turn)
        by_state[i, 0, 0] = 1.0 / r + w[i] * (x * dx + y * dy) / (r2 * r)  # 1 / r - w dr/dw / r^2
        by_state[i, 0, 1] = -w[i] * (x * sin_t + y * cos_t) / (r2 * r)
        by_state[i, 1, 0] = (x * dy - y * dx) / r2
        by_state[i, 1, 1] = (y * sin_t - x * cos_t) / r2
        by_step[i, 0, 0] = w[i] * w[i] * x / (r2 * r)
        by_step[i, 0, 1] = w[i] * w[i] * y / (r2 * r)
        by_step[i, 1, 0] = -w[i] * y / r2
        by_step[i, 1, 1] = w[i] * x / r2
        by_step[i, 1, 2] = 1.0
    return new_w, new_heading, by_state, by_step


def heading_from_bearing(beta: Array, w: Array, phi: float, rho: float, psi: float) -> Array:
    """theta of lines seen at a bearing and at an assumed 1/D; the inverse of `bearing_inverse`; (N,) rad.

    beta  (N,)  rad
    w     (N,)  1/m  the line is farther from the origin than the camera: w rho < 1
    """
    ray = beta + phi + psi  # direction of the sight, robot frame
    offset = w * rho
    across = np.clip(offset * np.sin(ray - phi), -1.0, 1.0)
    return wrap(np.pi - ray + np.arcsin(across))


def polar_from_cartesian(mount: Array) -> tuple[Array, Array]:
    """(eta, cx, cy) -> (phi, rho, psi) and its slope (3, 3); eta = phi + psi, c the camera's place on the robot."""
    eta, cx, cy = mount
    rho = float(np.hypot(cx, cy))
    phi = float(np.arctan2(cy, cx))
    r = max(rho, 1e-9)
    slope = np.array([[0.0, -cy / r**2, cx / r**2], [0.0, cx / r, cy / r], [1.0, cy / r**2, -cx / r**2]])
    return np.array([phi, rho, wrap(eta - phi)]), slope


def cartesian_from_polar(mount: Array) -> tuple[Array, Array]:
    """(phi, rho, psi) -> (eta, cx, cy) and its slope (3, 3)."""
    phi, rho, psi = mount
    c, s = np.cos(phi), np.sin(phi)
    slope = np.array([[1.0, 0.0, 1.0], [-rho * s, c, 0.0], [rho * c, s, 0.0]])
    return np.array([wrap(phi + psi), rho * c, rho * s]), slope


def polar_by_cartesian(mount: Array) -> Array:
    """Slope of (phi, rho, psi) by (eta, cx, cy) at (phi, rho, psi), also where rho is negative; (3, 3)."""
    phi, rho, _ = mount.tolist()
    r = rho if abs(rho) > 1e-6 else 1e-6
    c, s = np.cos(phi), np.sin(phi)
    return np.array([[0.0, -s / r, c / r], [0.0, c, s], [1.0, s / r, -c / r]])


def mount_difference(mount: Array, other: Array) -> Array:
    """phi, rho, psi of one mount - those of another (3,), angles the short way round."""
    off = mount - other
    off[[0, 2]] = wrap(off[[0, 2]])
    return off
