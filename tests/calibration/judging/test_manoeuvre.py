"""The next manoeuvre: what it is foreseen to bring, against the bound of a drive that really does it; and the choice.

The bound here is a dense information matrix whose unknowns are the wheels' own displacements at every encoder sample,
the mount and the lines' places; its slopes are differences. It shares nothing with the code under test.
"""

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.judging.manoeuvre import (
    TURN_AND_DRIVE,
    TURNS_DEG,
    WAYS_M,
    Leg,
    Lines,
    Manoeuvre,
    Outlook,
    best_manoeuvre,
    foreseen,
    in_words,
)
from omnivert.simulation.world import seen_lines

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BASE, K, STD = 0.4, 2e-4, 0.003
LIMIT = np.array([np.deg2rad(2.0), 0.010, np.deg2rad(2.0)])
OUTLOOK = Outlook(BASE, K, STD)
LASTING = Outlook(BASE, K, STD, life_frames=np.inf)
SAMPLES = 4  # encoder samples in a frame
NONE = np.zeros((3, 3))
MOUNT = np.array([-0.34, 0.23, 0.33])


def wheels_of(*parts: tuple[float, float]) -> Array:
    """Displacements (frames * SAMPLES, 2) of ways in m and turns in rad together: arcs, in frames of 5 cm or 3 deg."""
    steps = []
    for way, turn in parts:
        frames = max(round(abs(way) / 0.05), round(abs(turn) / np.deg2rad(3.0)), 1)
        one = np.array([way + 0.5 * BASE * turn, way - 0.5 * BASE * turn]) / frames / SAMPLES
        steps.append(np.tile(one, (frames * SAMPLES, 1)))
    return np.concatenate(steps)


def poses_of(wheels: Array) -> Array:
    """(..., S, 2) -> poses at the frames (..., F, 3), from the origin on; chords of the arcs."""
    turn = (wheels[..., 0] - wheels[..., 1]) / BASE
    heading = np.cumsum(turn, axis=-1)
    middle = heading - 0.5 * turn
    chord = 0.5 * (wheels[..., 0] + wheels[..., 1]) * np.sinc(0.5 * turn / np.pi)
    pose = np.stack([np.cumsum(chord * np.cos(middle), -1), np.cumsum(chord * np.sin(middle), -1), heading], -1)
    start = np.zeros((*pose.shape[:-2], 1, 3))
    return np.concatenate([start, pose[..., SAMPLES - 1 :: SAMPLES, :]], axis=-2)


def bearings_of(pose: Array, mount: Array, lines: Array, frame: Index, line: Index) -> Array:
    """Camera-frame bearings; pose (..., F, 3), mount (..., 3) eta, cx, cy, lines (..., L, 2)."""
    at = pose[..., frame, :]
    c, s = np.cos(at[..., 2]), np.sin(at[..., 2])
    x = lines[..., line, 0] - at[..., 0] - c * mount[..., 1, None] + s * mount[..., 2, None]
    y = lines[..., line, 1] - at[..., 1] - s * mount[..., 1, None] - c * mount[..., 2, None]
    return np.asarray(np.arctan2(y, x) - at[..., 2] - mount[..., 0, None])


def bound(
    mount: Array, information: Array, lines: Array, w_std: Array, wheels: Array, seen: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Covariance of phi, rho, psi and information on eta, cx, cy after a drive exactly as told.

    mount   (3,)    phi, rho, psi
    lines   (L, 2)  m, of the robot's first place
    w_std   (L,)    1/m, of the inverse distance from there, known before
    wheels  (S, 2)  m
    seen    (F, L)
    """
    phi, rho, psi = mount
    truth = np.concatenate([wheels.ravel(), [phi + psi, rho * np.cos(phi), rho * np.sin(phi)], lines.ravel()])
    frame, line = np.nonzero(seen)
    s, n = wheels.size, truth.size

    def split(x: Array) -> tuple[Array, Array, Array]:
        return (
            x[..., :s].reshape(*x.shape[:-1], -1, 2),
            x[..., s : s + 3],
            x[..., s + 3 :].reshape(*x.shape[:-1], -1, 2),
        )

    def measured(x: Array) -> Array:
        moved, cartesian, places = split(x)
        return bearings_of(poses_of(moved), cartesian, places, frame, line)

    small = 1e-6
    slope = np.empty((frame.size, n))
    for at in range(0, n, 64):  # a few at once, for numpy's sake
        step = small * np.eye(min(64, n - at), n, at)
        off = measured(truth + step) - measured(truth - step)
        slope[:, at : at + 64] = ((np.mod(off + np.pi, 2.0 * np.pi) - np.pi) / (2.0 * small)).T
    by_wheels, by_rest = slope[:, :s], slope[:, s:]
    # What the wheels' noise does to the bearings is noise of the bearings, of one covariance for all of them.
    noise = (by_wheels * (K * np.abs(wheels.ravel()) + 1e-15)) @ by_wheels.T + STD**2 * np.eye(frame.size)
    matrix = by_rest.T @ np.linalg.solve(noise, by_rest)
    matrix[:3, :3] += information + 1e-4 * np.eye(3)
    for i, (x, y) in enumerate(lines.tolist()):
        d = np.hypot(x, y)
        at_line = slice(3 + 2 * i, 5 + 2 * i)
        by_w, by_u = np.array([-x, -y]) / d**3, np.array([-y, x]) / d**2
        matrix[at_line, at_line] += np.outer(by_w, by_w) / min(w_std[i], 3.0) ** 2 + np.outer(by_u, by_u) / 3.0**2
    gained = matrix[:3, :3] - matrix[:3, 3:] @ np.linalg.solve(matrix[3:, 3:], matrix[3:, :3])
    slope = slopes_of(mount)
    return slope @ np.linalg.inv(gained) @ slope.T, gained - 1e-4 * np.eye(3)


def slopes_of(mount: Array) -> Array:
    """Of phi, rho, psi by eta, cx, cy."""
    phi, rho, _ = mount
    c, s = np.cos(phi), np.sin(phi)
    return np.array([[0.0, -s / rho, c / rho], [0.0, c, s], [1.0, s / rho, -c / rho]])


def room(seed: int, count: int = 6) -> Array:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(-np.pi, np.pi, count))
    return np.asarray(rng.uniform(1.9, 3.4, count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def lines_of(places: Array, w_std: float | Array = np.inf) -> Lines:
    """As the filter holds them: theta is the robot's heading relative to the direction line -> robot."""
    return Lines(
        1.0 / np.hypot(*places.T),
        np.pi - np.arctan2(places[:, 1], places[:, 0]),
        np.broadcast_to(np.asarray(w_std, dtype=np.float64), places.shape[0]).copy(),
    )


def after(mount: Array, places: Array, *parts: tuple[float, float]) -> Array:
    """Information (3, 3) that a drive among lasting lines leaves."""
    wheels = wheels_of(*parts)
    seen = np.ones((wheels.shape[0] // SAMPLES + 1, places.shape[0]), dtype=np.bool_)
    return bound(mount, NONE, places, np.full(places.shape[0], np.inf), wheels, seen)[1]


def turns(chosen: Manoeuvre) -> bool:
    return any(turn for _, turn in chosen.legs)


def drives(chosen: Manoeuvre) -> bool:
    return any(way for way, _ in chosen.legs)


def sigmas(covariance: Array | None) -> Array:
    assert covariance is not None
    return np.asarray(np.sqrt(np.diag(covariance)))


LEGS: list[tuple[Leg, ...]] = [
    ((0.7, 0.0),),
    ((0.0, np.pi / 2),),
    ((0.0, np.pi / 2), (0.7, 0.0)),
    ((0.3, 0.0), (0.0, np.pi / 4)),
    ((0.0, np.pi / 4), (1.5, 0.0)),
]


@pytest.mark.parametrize("legs", LEGS, ids=in_words)
@pytest.mark.parametrize("known", [False, True])
def test_what_is_foreseen_is_the_bound_of_that_drive(legs: tuple[Leg, ...], known: bool) -> None:
    places = room(3)
    w_std = np.full(6, 0.02 if known else 3.0)
    information = np.diag([1.0 / 0.02**2, 1.0 / 0.1**2, 1.0 / 0.2**2]) if known else NONE
    told = {m.legs: m for m in foreseen(MOUNT, information, lines_of(places, w_std), LASTING)}
    wheels = wheels_of(*legs)
    seen = np.ones((wheels.shape[0] // SAMPLES + 1, 6), dtype=np.bool_)
    truth, _ = bound(MOUNT, information, places, w_std, wheels, seen)
    np.testing.assert_allclose(sigmas(told[legs].covariance), sigmas(truth), rtol=2e-3)


def test_with_lines_that_come_and_go_it_is_the_bound_within_a_third() -> None:
    legs = ((0.0, np.pi / 2), (0.7, 0.0))
    wheels = wheels_of(*legs)
    way = poses_of(wheels)[:, :2]
    ratio = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        places = room(seed, 16)
        seen = seen_lines(places, way, 8.0, rng)
        columns, where = [], []
        for line in range(16):  # a line that comes back is another one
            begins = np.flatnonzero(np.diff(np.concatenate([[0], seen[:, line].astype(np.int8)])) == 1)
            for begin in begins.tolist():
                run = np.zeros(seen.shape[0], dtype=np.bool_)
                end = begin
                while end < run.size and seen[end, line]:
                    run[end] = True
                    end += 1
                columns.append(run)
                where.append(places[line])
        truth, _ = bound(MOUNT, NONE, np.array(where), np.full(len(where), np.inf), wheels, np.stack(columns, axis=1))
        told = {m.legs: m for m in foreseen(MOUNT, NONE, lines_of(places[seen[0]], 3.0), OUTLOOK)}[legs]
        ratio.append(sigmas(told.covariance) / sigmas(truth))
    assert np.all(np.abs(np.log(np.median(ratio, axis=0))) < np.log(4.0 / 3.0)), np.median(ratio, axis=0)


@pytest.mark.parametrize("way", [1.0, 6.0])
@pytest.mark.parametrize("seed", range(4))
def test_after_driving_straight_one_has_to_turn(way: float, seed: int) -> None:
    mount = np.array([seed - 1.5, 0.1 + 0.1 * seed, 0.4])
    places = room(seed) + np.array([way, 0.0])
    information = after(mount, places, (way, 0.0))
    for w_std in (np.inf, 0.02):
        chosen = best_manoeuvre(mount, information, lines_of(places - np.array([way, 0.0]), w_std), OUTLOOK, LIMIT)
        assert turns(chosen), chosen.text


@pytest.mark.parametrize("seed", range(4))
def test_after_turning_on_the_spot_one_has_to_drive(seed: int) -> None:
    mount = np.array([seed - 1.5, 0.1 + 0.1 * seed, 0.4])
    places = room(seed)
    information = after(mount, places, (0.0, 2.0 * np.pi))
    for w_std in (np.inf, 0.2):
        chosen = best_manoeuvre(mount, information, lines_of(places, w_std), OUTLOOK, LIMIT)
        assert drives(chosen), chosen.text


@pytest.mark.parametrize("radius", [0.3, 0.5, 1.9])
@pytest.mark.parametrize("seed", range(3))
def test_after_one_circle_the_choice_leaves_it(radius: float, seed: int) -> None:
    mount = np.array([seed - 1.5, 0.1 + 0.1 * seed, 0.4])
    places = room(seed)
    information = after(mount, places, (2.0 * np.pi * radius, 2.0 * np.pi) if radius < 1.0 else (6.0, 6.0 / radius))
    chosen = best_manoeuvre(mount, information, lines_of(places), OUTLOOK, LIMIT)
    assert drives(chosen), chosen.text
    before = sigmas(np.asarray(np.linalg.inv(information + 1e-4 * np.eye(3)), dtype=np.float64))
    assert sigmas(chosen.covariance)[1] < 0.2 * before[1:].max()


def test_after_the_papers_path_there_is_still_something_to_gain() -> None:
    places = room(5)
    information = after(MOUNT, places, (3.3, 0.0), (0.0, np.pi))
    slope = slopes_of(MOUNT)
    before = sigmas(slope @ np.linalg.inv(information) @ slope.T)
    for limit in (LIMIT, before / 2.0):  # reached already; not reached
        chosen = best_manoeuvre(MOUNT, information, lines_of(places, 0.01), OUTLOOK, limit)
        assert (sigmas(chosen.covariance) / limit).max() < 0.99 * (before / limit).max()


def test_no_manoeuvre_of_the_set_gains_more_per_second_by_a_tenth() -> None:
    lines = lines_of(room(7))
    chosen = best_manoeuvre(MOUNT, NONE, lines, OUTLOOK, LIMIT / 50.0)  # out of reach of any one manoeuvre
    every = foreseen(MOUNT, NONE, lines, OUTLOOK)

    def rate(m: Manoeuvre) -> float:
        return float((LIMIT / sigmas(m.covariance)).min() ** 2 / m.seconds)

    best = max(rate(m) for m in every)
    assert rate(chosen) >= 0.9 * best
    assert all((len(m.legs), m.seconds) >= (len(chosen.legs), chosen.seconds) for m in every if rate(m) >= 0.9 * best)


def test_what_reaches_the_limits_is_chosen_and_nothing_much_quicker_does() -> None:
    lines = lines_of(room(7))
    chosen = best_manoeuvre(MOUNT, NONE, lines, OUTLOOK, 3.0 * LIMIT)
    assert (sigmas(chosen.covariance) <= 3.0 * LIMIT).all()
    quick = [m for m in foreseen(MOUNT, NONE, lines, OUTLOOK) if m.seconds < 0.9 * chosen.seconds]
    assert quick
    assert all((sigmas(m.covariance) > 3.0 * LIMIT).any() for m in quick)


def test_backward_shows_as_much_as_forward() -> None:
    seen = np.ones((2 * 15 + 1, 6), dtype=np.bool_)
    unknown = np.full(6, np.inf)
    ahead, back = (
        sigmas(bound(MOUNT, NONE, room(3), unknown, wheels_of((0.0, np.pi / 4), (way, 0.0)), seen[:30])[0])
        for way in (0.7, -0.7)
    )
    np.testing.assert_allclose(ahead, back, rtol=0.5)


def test_it_says_what_to_drive_and_what_that_will_bring() -> None:
    information = after(MOUNT, room(3), (1.0, 0.0), (0.0, np.pi / 6))
    slope = slopes_of(MOUNT)
    before = sigmas(slope @ np.linalg.inv(information + 1e-4 * np.eye(3)) @ slope.T)
    chosen = best_manoeuvre(MOUNT, information, lines_of(room(3), 0.05), OUTLOOK, LIMIT)
    worst = int(np.argmax(before / LIMIT))
    name, unit, scale = (("phi", "deg", 180.0 / np.pi), ("rho", "mm", 1e3), ("psi", "deg", 180.0 / np.pi))[worst]
    assert (
        chosen.brings == f"{name} {scale * before[worst]:.2g} -> {scale * sigmas(chosen.covariance)[worst]:.2g} {unit}"
    )
    assert TURN_AND_DRIVE.text == "turn about 90 deg on the spot, then drive 0.7 m straight"
    assert " unknown -> " in best_manoeuvre(MOUNT, NONE, lines_of(room(3)), OUTLOOK, LIMIT).brings


def test_without_lines_there_is_a_default_that_promises_nothing() -> None:
    nothing = Lines(np.zeros(0), np.zeros(0), np.zeros(0))
    assert best_manoeuvre(MOUNT, NONE, nothing, OUTLOOK, LIMIT) is TURN_AND_DRIVE
    assert best_manoeuvre(np.full(3, np.nan), NONE, lines_of(room(1)), OUTLOOK, LIMIT) is TURN_AND_DRIVE
    assert TURN_AND_DRIVE.covariance is None
    assert TURN_AND_DRIVE.brings == ""


@pytest.mark.parametrize(("longest_m", "longest_deg"), [(0.2, 30.0), (1.0, 90.0), (1.5, 180.0), (4.0, 360.0)])
def test_no_leg_is_longer_than_room_and_cable_allow(longest_m: float, longest_deg: float) -> None:
    narrow = replace(OUTLOOK, longest_m=longest_m, longest_turn_deg=longest_deg)
    legs = {leg for m in foreseen(MOUNT, NONE, lines_of(room(3)), narrow) for leg in m.legs}
    assert max(way for way, _ in legs) == longest_m
    assert max(turn for _, turn in legs) == pytest.approx(np.deg2rad(longest_deg))
    usual = {leg for m in foreseen(MOUNT, NONE, lines_of(room(3)), OUTLOOK) for leg in m.legs}
    assert {leg for leg in usual if leg[0] < longest_m and leg[1] < np.deg2rad(longest_deg)} <= legs
    nothing = Lines(np.zeros(0), np.zeros(0), np.zeros(0))
    for way, turn in best_manoeuvre(MOUNT, NONE, nothing, narrow, LIMIT).legs:
        assert way <= longest_m
        assert turn <= np.deg2rad(longest_deg)


def test_many_lines_are_stood_for_by_a_few() -> None:
    """48 lines, four of a kind each: a dozen of them, seen twice as well, tell the same."""
    kinds = room(9, 12)
    many = np.repeat(kinds, 4, axis=0)
    few = Outlook(BASE, K, STD / 2.0)
    for crowd, dozen in zip(
        foreseen(MOUNT, NONE, lines_of(many), OUTLOOK), foreseen(MOUNT, NONE, lines_of(kinds), few), strict=True
    ):
        np.testing.assert_allclose(sigmas(crowd.covariance), sigmas(dozen.covariance), rtol=0.35)


@settings(deadline=None, max_examples=60)
@given(
    count=st.integers(1, 30),
    seed=st.integers(0, 10_000),
    rho=st.floats(0.0, 1.0),
    scale=st.sampled_from([0.0, 1e-2, 1.0, 100.0]),
)
def test_more_driving_never_shows_less_and_covariances_are_sound(
    count: int, seed: int, rho: float, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    lines = Lines(
        scale * rng.uniform(0.0, 1.0, count), rng.uniform(-np.pi, np.pi, count), rng.choice([0.01, 1.0, np.inf], count)
    )
    mount = np.array([rng.uniform(-np.pi, np.pi), rho, rng.uniform(-np.pi, np.pi)])
    every = {m.legs: m for m in foreseen(mount, NONE, lines, LASTING)}
    assert len(every) == len(WAYS_M) * len(TURNS_DEG) * 2 + len(WAYS_M) + len(TURNS_DEG)
    for legs, m in every.items():
        assert m.covariance is not None
        assert np.isfinite(m.covariance).all()
        assert np.linalg.eigvalsh(m.covariance).min() > -1e-6 * np.trace(m.covariance)
        if len(legs) == 2:
            assert (np.diag(m.covariance) <= 1.01 * np.diag(every[legs[:1]].covariance) + 1e-9).all()  # type: ignore[arg-type]


def test_it_takes_less_than_20_ms() -> None:
    lines = lines_of(room(1, 100))
    best_manoeuvre(MOUNT, NONE, lines, OUTLOOK, LIMIT)  # compiles
    taken = []
    for _ in range(5):
        begun = time.perf_counter()
        best_manoeuvre(MOUNT, NONE, lines, OUTLOOK, LIMIT)
        taken.append(time.perf_counter() - begun)
    assert min(taken) < 0.020
