"""Whatever comes in whatever order: nothing raises, what is said can be believed or has a reason, nothing grows."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.calibration.calibrator import Calibrator
from omnivert.calibration.choice import UNSEEN
from omnivert.calibration.waiting import MOST_HELD
from omnivert.calibration.way import KEPT_NS
from omnivert.config import Calibration, Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Mount, State, Ticks
from omnivert.simulation.recording import Scene, recorded
from omnivert.wire.codec import decode, encode
from tests.calibration.hostile import LINES, MOUNT, SECOND, Odd, Part, Teller, Well, parts

CONFIG = Config()
PHI, RHO, PSI = MOUNT.tolist()
DRIVE: list[Part] = [Well(12, False), Well(12, True)] * 3
STORED = {  # what a file may hold: phi, psi and rho with sigmas from nothing to anything
    "as it is": (RHO, (1e-4, 1e-6, 1e-4)),
    "sure": (RHO, (1e-20, 1e-20, 1e-20)),
    "rho to no digit": (RHO, (1e-4, 1e-300, 1e-4)),
    "unsure": (RHO, (1e6, 1e6, 1e6)),
    "as good as unknown": (RHO, (1e300, 1e300, 1e300)),
    "on the axis": (0.0, (1e-4, 1e-6, 1e-4)),
    "off every robot": (100.0, (1e-4, 1e-4, 1e-4)),
}


def stored(name: str | None) -> Extrinsics | None:
    if name is None:
        return None
    rho, variances = STORED[name]
    mount = Mount(PHI, rho, PSI, np.diag(variances))
    return Extrinsics(0, "demo", "front", mount, State.CALIBRATED, 9, (), "omnivert", "digest")


def told(calibrator: Calibrator, messages: list[Ticks | Bearings]) -> list[Estimate | Extrinsics]:
    """What comes of them, each held to what must be true of everything that is ever said."""
    out = [word for message in messages for word in calibrator.step(message)]
    estimates = [word for word in out if isinstance(word, Estimate)]
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(estimates))
    final = calibrator.close()
    for word in [*out, *final]:
        assert encode(decode(encode(word))) == encode(word)  # it keeps the form of its message
        for mount in (word.mount, word.smoother if isinstance(word, Estimate) else None):
            if mount is not None:
                assert np.isfinite([mount.phi_rad, mount.rho_m, mount.psi_rad]).all()
                assert (mount.covariance == mount.covariance.T).all()
                np.linalg.cholesky(mount.covariance)  # raises where it is no covariance
        if isinstance(word, Estimate):
            for parameter in (word.phi, word.rho, word.psi):
                assert parameter.reason or parameter.state is State.CALIBRATED
    return [*out, *final]


def grows_nothing(calibrator: Calibrator) -> None:
    known = calibrator._way._odometer._known
    assert known[-1][0] - known[0][0] <= KEPT_NS + 600 * SECOND if len(known) > 2 else True
    assert len(calibrator._waiting._held) <= MOST_HELD
    assert calibrator._waiting._choice._name.size <= (UNSEEN + 1) * 3 * LINES


@settings(max_examples=25)
@given(parts, st.integers(0, 9), st.none() | st.sampled_from(sorted(STORED)))
def test_no_stream_makes_it_raise_or_say_what_cannot_be(stream: list[Part], seed: int, known: str | None) -> None:
    messages = Teller(CONFIG, seed).told(stream)
    calibrator = Calibrator(CONFIG, stored(known))
    words = told(calibrator, messages)
    grows_nothing(calibrator)
    refused = calibrator.refused
    frames = sum(isinstance(message, Bearings) for message in messages)
    late = refused.get("bearings: stamp not after the one before", 0) + refused.get("bearings: stamp out of range", 0)
    estimates = [word for word in words if isinstance(word, Estimate)]
    assert len({e.stamp_ns for e in estimates}) == frames - late  # one for each, or it is counted
    assert all(reason and count > 0 for reason, count in refused.items())
    first = stored(known)
    for claim in (word for word in words if isinstance(word, Extrinsics)):
        assert claim.state in (State.MOVED, State.CALIBRATED)
        if claim.state is State.MOVED and first is not None and claim is words[0]:
            assert encode_mount(claim.mount) == encode_mount(first.mount)  # taken back as it was


def encode_mount(mount: Mount) -> tuple[float, float, float, bytes]:
    return mount.phi_rad, mount.rho_m, mount.psi_rad, mount.covariance.tobytes()


@pytest.fixture(scope="module")
def undisturbed() -> list[Estimate | Extrinsics]:
    calibrator = Calibrator(CONFIG, stored("as it is"))
    words = told(calibrator, Teller(CONFIG, 3).told(DRIVE[:4]))
    assert calibrator.refused == {}
    return words


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (Odd(True, -SECOND, None, None, None, None, LINES), "bearings: stamp not after the one before"),
        (Odd(True, 2**62, None, None, None, None, LINES), "bearings: stamp out of range"),
        (Odd(True, -(2**63), None, None, None, None, LINES), "bearings: stamp out of range"),
        (Odd(False, -SECOND, None, None, None, None, 0), "ticks: stamp not after the one before"),
        (Odd(False, 2**62, None, None, None, None, 0), "ticks: stamp out of range"),
        (Odd(False, 1, 2**63 - 1, None, None, None, 0), "ticks: a jump that no wheel can make"),
        (Odd(False, 1, -(2**63), None, None, None, 0), "ticks: a jump that no wheel can make"),
    ],
)
def test_one_wrong_message_is_counted_and_changes_no_byte_of_what_is_said(
    undisturbed: list[Estimate | Extrinsics], wrong: Odd, reason: str
) -> None:
    calibrator = Calibrator(CONFIG, stored("as it is"))
    words = told(calibrator, Teller(CONFIG, 3).told([*DRIVE[:3], wrong, DRIVE[3]]))
    assert calibrator.refused == {reason: 1}
    assert list(map(encode, words)) == list(map(encode, undisturbed))


@pytest.mark.parametrize(
    ("beta", "std", "track"),
    [(np.nan, None, None), (np.inf, None, None), (None, 0.0, None), (None, -1.0, None), (None, None, 2**63 - 1)],
)
def test_a_frame_with_lines_that_are_none_goes_on_with_the_others(
    undisturbed: list[Estimate | Extrinsics], beta: float | None, std: float | None, track: int | None
) -> None:
    calibrator = Calibrator(CONFIG, stored("as it is"))
    words = told(
        calibrator, Teller(CONFIG, 3).told([*DRIVE[:3], Odd(True, 1, None, beta, std, track, LINES), DRIVE[3]])
    )
    assert calibrator.refused == {"bearings: track repeated in a frame, or a value that is no number": 3}
    (more,) = {word.stamp_ns for word in words} - {word.stamp_ns for word in undisturbed}
    assert sum(word.stamp_ns == more for word in words) == 1
    last, expected = words[-1].mount, undisturbed[-1].mount
    assert last is not None
    assert expected is not None
    off = np.array([last.phi_rad, last.rho_m, last.psi_rad]) - [expected.phi_rad, expected.rho_m, expected.psi_rad]
    assert off @ np.linalg.solve(expected.covariance, off) < 1.0


def test_a_filter_that_lost_its_footing_starts_anew_from_the_smoother() -> None:
    """Nobody measures to 1e5 rad, but a file can say so; then one bearing's row of the gain has no digit left."""
    mount = Mount(PHI, RHO, PSI, 1e10 * np.eye(3))
    calibrator = Calibrator(
        CONFIG, Extrinsics(0, "demo", "front", mount, State.CALIBRATED, 9, (), "omnivert", "digest")
    )
    words = told(calibrator, Teller(CONFIG, 1).told(DRIVE))
    estimates = [word for word in words if isinstance(word, Estimate)]
    said = ["the filter lost its footing and starts anew" in e.reasons for e in estimates]
    assert calibrator.refused == {"filter: covariance lost its definiteness": 1}
    assert sum(said) == 1
    assert estimates[said.index(True)].mount is None  # until there is a solution
    last = estimates[-1]
    assert last.lines_used == LINES  # the filter runs again
    assert last.mount is not None
    off = np.array([last.mount.phi_rad, last.mount.rho_m, last.mount.psi_rad]) - MOUNT
    assert off @ np.linalg.solve(last.mount.covariance, off) < 21.1  # chi-square of 3, 1 in 10 000


def test_the_filter_as_printed_starts_anew_from_measurement_when_its_camera_leaves_the_robot() -> None:
    config = Config(calibration=Calibration(mode="paper", start_rho_m=5.0, start_phi_rad=3.0))
    calibrator = Calibrator(config)
    running = calibrator._pulse.filter
    assert running is not None
    running.x[1] = 99.99999999  # as it may diverge to in a long drive
    words = told(calibrator, Teller(config, 1).told([Well(30, False), Well(30, True)]))
    assert calibrator.refused.get("filter: covariance lost its definiteness", 0) > 0
    assert all(isinstance(word, Estimate) and word.mount is not None for word in words[-5:])


def test_equations_that_are_not_positive_definite_are_counted_and_said() -> None:
    """Bearings of a millionth of a radian, as fine as a message can say, in a turn that shows no distance."""
    config = Config(calibration=Calibration(bearing_floor_deg=1e-6))
    drive = recorded(Scene(path="turn", bearing_std_rad=1e-6, outliers=0.0, visible=60), config, 0)
    calibrator = Calibrator(config)
    words = told(calibrator, [message for message in drive.messages if message.stamp_ns < 8 * SECOND])
    said = "the smoother lost its footing: its last solution is none"
    assert calibrator.refused["smoother: equations not positive definite"] > 0
    assert any(said in word.reasons for word in words)
    assert all(word.mount is None for word in words)
