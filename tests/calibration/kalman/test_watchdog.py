"""The watchdog: a knock is noticed, told rightly and not forgotten; wrong bearings and time alone raise nothing."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.calibration.kalman import model
from omnivert.calibration.kalman.ekf import Evidence, Filter, Rules
from omnivert.calibration.kalman.watchdog import Alarm, Kind, Watchdog
from omnivert.config import Encoder
from omnivert.odometry import Motion, Odometer, Samples, after

Array = NDArray[np.float64]

BASE, K, FRAME_NS = 0.4, 2e-4, 333_000_000
STILL = np.zeros(3)


def motion_from_wheels(right: Array, left: Array) -> Motion:
    """Steps of the wheels (N,), one after the other."""
    right, left = (np.concatenate([[0.0], np.cumsum(way)]) for way in (right, left))
    samples = Samples(0.02 * np.arange(right.size, dtype=np.float64), right, left)
    return Odometer(Encoder(noise_k_m=K, ticks_per_rev=10_000_000), BASE).motion(samples)


@dataclass
class World:
    """A robot that drives 0.75 m and turns by 90 deg again and again among lines that die and are born."""

    seed: int
    std: float
    knock: Array  # (3,) yaw, forward, left
    at: int  # frame
    outliers: float = 0.05
    standing: bool = False  # from 20 frames before the knock on

    def watched(self, frames: int, reseed: int = 0) -> tuple[Alarm | None, Watchdog, list[float]]:
        """Until an alarm; the watchdog, and of each frame the chi-square of a jump just then.

        reseed  frames after which the filter is made anew from its own state, as from a smoother
        """
        rng = np.random.default_rng(self.seed)
        true = np.array([rng.uniform(-np.pi, np.pi), *rng.uniform(-0.25, 0.25, 2)])
        std = np.array([0.003, 0.002, 0.002])
        told, slope = model.polar_from_cartesian(true + std * rng.standard_normal(3))
        covariance = slope @ np.diag(std**2) @ slope.T
        known, dog = Filter(told, covariance, Rules()), Watchdog(told, covariance)
        pose, fresh, chi = np.zeros(3), 12, []
        lines = self.born(pose, 12, rng)
        names = np.arange(12)
        for frame in range(frames):
            rest = self.standing and frame >= self.at - 20
            wheels = np.full((17, 2), 0.05 / 17) if frame % 45 < 15 else np.tile([0.0206 / 34, -0.0206 / 34], (17, 1))
            wheels = 0.0 * wheels if rest else wheels
            real = wheels + np.sqrt(K * np.abs(wheels)) * rng.standard_normal(wheels.shape)
            pose = after(pose, motion_from_wheels(real[:, 0], real[:, 1]).pose)
            known.predict(motion_from_wheels(wheels[:, 0], wheels[:, 1]))
            gone = (rng.random(names.size) < (0.0 if rest else 1.0 / 40.0)) | (np.hypot(*(lines - pose[:2]).T) > 3.5)
            lines[gone] = self.born(pose, int(gone.sum()), rng)
            names = np.where(gone, fresh + np.cumsum(gone), names)
            fresh = int(names.max()) + 1
            yaw, x, y = true + (self.knock if frame >= self.at else 0.0)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            sight = lines - pose[:2] - [c * x - s * y, s * x + c * y]
            beta = np.arctan2(sight[:, 1], sight[:, 0]) - pose[2] - yaw + self.std * rng.standard_normal(names.size)
            wrong = rng.random(names.size) < self.outliers
            beta = wrap(np.where(wrong, rng.uniform(-np.pi, np.pi, names.size), beta))
            sigma = np.full(names.size, self.std)
            stamp = frame * FRAME_NS
            alarm = dog.stand(stamp, rest, names, beta, sigma, known)
            if not rest:
                alarm = dog.step(stamp, known, known.update(names, beta, sigma).evidence)
                chi.append(float(dog.chi[-1]) if dog.chi.size and frame > 40 else 0.0)
            if alarm is not None:
                return alarm, dog, chi
            if reseed and frame % reseed == reseed - 1:
                n = 2 * len(known.tracks)
                known.seed(known.x[n:], known.x[:n].reshape(-1, 2), known.P, known.tracks)
        return None, dog, chi

    def born(self, pose: Array, count: int, rng: np.random.Generator) -> Array:
        far, way = rng.uniform(1.3, 2.6, count), rng.uniform(-np.pi, np.pi, count)
        return pose[:2] + np.stack([far * np.cos(way), far * np.sin(way)], axis=1)


KNOCKS = [np.array([np.deg2rad(2.0), 0.0, 0.0]), np.array([0.0, 0.02, 0.0]), np.array([0.0, 0.0, -0.02])]
AT = 70


@pytest.mark.parametrize("knock", KNOCKS)
@pytest.mark.parametrize("reseed", [0, 6])
def test_a_knock_is_noticed_within_three_seconds_of_driving(knock: Array, reseed: int) -> None:
    off, soon = [], 0
    for seed in range(6):
        at = AT + 7 * seed
        alarm, _, seen = World(seed, 0.001, knock, at).watched(at + 60, reseed)
        assert alarm is not None
        assert alarm.kind is Kind.DRIVING
        assert -2 <= alarm.stamp_ns // FRAME_NS - at <= 8
        soon += len(seen) - 1 <= at + 9
        off.append(np.linalg.solve(np.linalg.cholesky(alarm.covariance), alarm.moved - knock))
    assert soon >= 5  # a knock along the way of a robot that turns its head shows only with the next turn
    # 1 but for linearisation and the choice of the frame; one that was long in doubt is told less well.
    assert np.median(np.square(off)) < 2.0


@pytest.mark.parametrize("knock", KNOCKS)
def test_a_knock_in_bearings_of_3_mrad_is_noticed_within_a_minute(knock: Array) -> None:
    found = [World(seed, 0.003, knock, AT).watched(AT + 180)[0] for seed in range(4)]
    assert all(alarm is not None and alarm.stamp_ns >= (AT - 4) * FRAME_NS for alarm in found)


@pytest.mark.parametrize("std", [0.001, 0.003])
def test_nothing_is_said_of_a_camera_that_stays_and_its_odds_are_those_of_chi_square(std: float) -> None:
    chi: list[float] = []
    for seed in range(4):
        alarm, _, more = World(100 + seed, std, STILL, 0).watched(300)
        assert alarm is None
        chi += more[41:]
    beyond = (np.array(chi) > 11.345).mean()  # chance 0.01
    assert 0.001 < beyond < 0.01 + 4.0 * np.sqrt(0.01 / len(chi))


def test_many_wrong_bearings_raise_nothing() -> None:
    for seed in range(3):
        assert World(200 + seed, 0.001, STILL, 0, outliers=0.2).watched(250)[0] is None


@pytest.mark.parametrize("knock", KNOCKS)
def test_a_knock_at_rest_is_sure_within_two_frames_and_of_few_lines_soon_after(knock: Array) -> None:
    first = []
    for seed in range(6):
        alarm, _, _ = World(300 + seed, 0.003, knock, AT, standing=True).watched(AT + 6)
        assert alarm is not None
        assert alarm.kind is Kind.STANDING
        first.append(alarm.stamp_ns // FRAME_NS - AT)
    assert first.count(0) >= 5
    assert 0 <= min(first) <= max(first) <= 4


def test_standing_for_long_among_wrong_bearings_raises_nothing() -> None:
    for seed in range(6):
        assert World(320 + seed, 0.003, STILL, AT, standing=True).watched(AT + 150)[0] is None


def test_a_line_foretold_much_worse_than_the_others_says_nothing() -> None:
    """One so near that a shift of a few cm would explain it, and wrong again and again: it is bent, nothing moved."""
    rng = np.random.default_rng(4)
    slopes = np.column_stack([-np.ones(11), rng.uniform(-0.7, 0.7, (11, 2))])
    slopes[0, 1] = 20.0
    own = np.full(11, 0.003)
    own[0] = 0.06
    spread = np.diag(own**2) + 0.005**2
    mount, sure = np.array([0.3, 0.2, 0.1]), 1e-6 * np.eye(3)
    known, dog = Filter(mount, sure, Rules()), Watchdog(mount, sure)
    age, precision = np.full(11, 30), np.asarray(np.linalg.inv(spread), dtype=np.float64)
    for frame in range(12):
        off = np.asarray(rng.multivariate_normal(np.zeros(11), spread), dtype=np.float64)
        off[0] = 5.0 * own[0]
        followed = np.tile(slopes, dog.chi.size + 1)  # nothing is swallowed of any jump
        known.followed = np.zeros((3, followed.shape[1]))
        assert dog.step(frame, known, Evidence(age, off, precision, followed)) is None
    assert dog.frames == 11
    assert dog.chi.max() < 21.1  # 1 in 10 000


def test_an_alarm_stands_until_a_new_mount_is_trusted() -> None:
    alarm, dog, _ = World(1, 0.001, KNOCKS[0], AT).watched(AT + 10)
    assert alarm is not None
    assert dog.alarm is alarm
    known = Filter(np.array([0.3, 0.2, 0.1]), np.diag([1e-4, 1e-6, 1e-4]), Rules())
    assert dog.step(10**12, known, None) is None
    assert dog.compare(10**12, np.array([0.3, 0.2, 0.1]), np.eye(3)) is None
    assert dog.alarm is alarm
    dog.trust(np.array([0.3, 0.2, 0.1]), np.diag([1e-4, 1e-6, 1e-4]))
    assert dog.alarm is None


def test_a_late_part_of_the_drive_is_held_against_the_mount_that_was_trusted() -> None:
    mount, spread = np.array([0.3, 0.2, 0.1]), np.diag([0.005**2, 0.001**2, 0.005**2])
    dog = Watchdog(mount, spread)
    near = mount + np.array([0.005, -0.001, -0.005])
    for _ in range(5):
        assert dog.compare(7, near, spread) is None
    far = mount + np.array([0.0, 0.01, 0.0])
    assert dog.compare(7, far, spread) is None
    assert dog.compare(7, near, spread) is None  # once is not enough
    assert dog.compare(7, far, spread) is None
    alarm = dog.compare(8, far, spread)
    assert alarm is not None
    assert (alarm.kind, alarm.stamp_ns) == (Kind.SLOW, 7 + 1)
    np.testing.assert_allclose(alarm.moved, [0.0, 0.01 * np.cos(0.3), 0.01 * np.sin(0.3)], atol=1e-9)
    np.testing.assert_allclose(np.sqrt(alarm.covariance[0, 0]), 0.01, rtol=1e-6)  # of phi + psi, both times


def test_an_alarm_says_what_moved_and_only_what_is_seen() -> None:
    covariance = np.diag([np.deg2rad(0.3) ** 2, 0.02**2, 0.001**2])
    alarm = Alarm(0, Kind.DRIVING, np.array([np.deg2rad(-2.1), 0.01, 0.015]), covariance)
    assert alarm.text == "the camera moved by 2.1 +- 0.3 deg clockwise, 1.5 +- 0.1 cm to the left"
    assert Alarm(0, Kind.STANDING, STILL, covariance).text.startswith("the camera, or the robot under it, moved")


def test_a_better_mount_is_held_only_when_it_is_ripe_and_does_not_hide_what_came_before() -> None:
    mount, spread = np.array([0.3, 0.2, 0.1]), np.diag([0.005**2, 0.001**2, 0.005**2])
    far = mount + np.array([0.0, 0.01, 0.0])
    dog = Watchdog(mount, spread, stamp_ns=100)
    assert [dog.compare(99, far, spread) for _ in range(3)] == [None] * 3  # a part that has made the mount itself
    for second in range(1, 60):
        dog.renew(second * 10**9, far, spread)  # has swallowed the knock
    assert dog.compare(200, far, spread) is None
    alarm = dog.compare(300, far, spread)
    assert alarm is not None
    assert alarm.stamp_ns == 300
    dog.trust(mount, spread)
    dog.renew(0, far, spread)
    dog.renew(60 * 10**9, far, spread)
    assert [dog.compare(10**9, far, spread) for _ in range(3)] == [None] * 3


def test_what_was_asked_of_the_last_frames_goes_on_when_the_mount_is_known_better() -> None:
    _, dog, chi = World(7, 0.001, STILL, 0).watched(60)
    assert len(chi) == 60
    asked = dog.chi.size
    dog.renew(10**12, np.array([0.3, 0.2, 0.1]), np.eye(3))
    dog.renew(10**13, np.array([0.3, 0.2, 0.1]), np.eye(3))
    assert dog.chi.size == asked > 5
