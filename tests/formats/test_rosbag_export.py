"""Estimates in a bag: where the camera sits, how sure that is, at the times of the bag that the drive came from."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.errors import DataError, UseError
from omnivert.formats.rosbag.export import covariance, export_rosbag
from omnivert.formats.rosbag.file import Bag, Received
from omnivert.messages import Estimate, Message, Mount, ParameterVerdict, State, Ticks
from tests.formats.bags import ORIGIN_NS

SPREAD = np.array([[4e-4, 1e-5, -3e-4], [1e-5, 1e-6, 2e-6], [-3e-4, 2e-6, 5e-4]])


def estimate(stamp_ns: int, state: State, mount: Mount | None) -> Estimate:
    word = ParameterVerdict(state)
    return Estimate(stamp_ns, 1, mount, state, word, word, word, "", 1.0, 2.0, 3, 4, 5)


ESTIMATES: list[Message] = [
    estimate(100, State.WAITING, None),
    Ticks(150, 1, 2),
    estimate(200, State.NOT_YET, Mount(2.0, 0.3, 1.5, SPREAD)),
    estimate(1_300_000_000, State.USABLE, Mount(-0.3, 0.2, 0.4, SPREAD)),
    estimate(2_400_000_000, State.CALIBRATED, Mount(-0.34, 0.23, 0.33, SPREAD)),
    estimate(2_500_000_000, State.MOVED, Mount(-0.34, 0.23, 0.33, SPREAD)),
]


def read(path: Path, name: str) -> list[Received]:
    bag = Bag(path)
    return list(bag.messages(bag.topics[name]))


@pytest.mark.parametrize("name", ["result", "result.bag"])
def test_every_mount_is_a_pose_and_only_trusted_ones_are_transforms(tmp_path: Path, name: str) -> None:
    written = export_rosbag(ESTIMATES, "front", tmp_path / name, ORIGIN_NS)
    assert written == {"/omnivert/front/mount": 4, "/tf": 2}
    poses, links = read(tmp_path / name, "/omnivert/front/mount"), read(tmp_path / name, "/tf")
    assert [p.header_ns - ORIGIN_NS for p in poses] == [200, 1_300_000_000, 2_400_000_000, 2_500_000_000]
    assert [p.bag_ns for p in poses] == [p.header_ns for p in poses]
    (link,) = links[1].content.transforms
    assert (link.header.frame_id, link.child_frame_id) == ("base_link", "front")
    assert [place.name for place in (tmp_path).iterdir()] == [name]
    x, y, yaw = 0.23 * np.cos(-0.34), 0.23 * np.sin(-0.34), -0.01
    for shift, turn in (
        (link.transform.translation, link.transform.rotation),
        (poses[2].content.pose.pose.position, poses[2].content.pose.pose.orientation),
    ):
        assert (shift.x, shift.y, shift.z) == pytest.approx((x, y, 0.0))
        assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)))


def test_without_a_mount_no_bag_is_left(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no mount"):
        export_rosbag(ESTIMATES[:2], "front", tmp_path / "result", ORIGIN_NS)
    assert list(tmp_path.iterdir()) == []


@settings(max_examples=25)
@given(phi=st.floats(-3.1, 3.1), rho=st.floats(0.05, 2.0), psi=st.floats(-3.1, 3.1))
def test_the_covariance_is_that_of_places_drawn_by_it(phi: float, rho: float, psi: float) -> None:
    drawn = np.random.default_rng(1).multivariate_normal((phi, rho, psi), 1e-4 * SPREAD, size=4000)
    x, y = drawn[:, 1] * np.cos(drawn[:, 0]), drawn[:, 1] * np.sin(drawn[:, 0])
    scattered = np.cov(np.stack([x, y, drawn[:, 0] + drawn[:, 2]]))
    told = covariance(Mount(phi, rho, psi, 1e-4 * SPREAD)).reshape(6, 6)
    sigma = np.sqrt(np.diag(told)[[0, 1, 5]])
    assert told[np.ix_([0, 1, 5], [0, 1, 5])] == pytest.approx(scattered, abs=0.1 * float(sigma.max()) ** 2)
    assert np.diag(told)[2:5].tolist() == [1e6, 1e6, 1e6]


def test_nothing_is_overwritten_and_nothing_half_written_is_left(tmp_path: Path) -> None:
    export_rosbag(ESTIMATES, "front", tmp_path / "result")
    with pytest.raises(UseError, match="exists already"):
        export_rosbag(ESTIMATES, "front", tmp_path / "result")

    def broken() -> Any:
        yield from ESTIMATES
        raise DataError("OV306", "the recording ends here")

    with pytest.raises(DataError, match="ends here"):
        export_rosbag(broken(), "front", tmp_path / "other")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]
    with pytest.raises(DataError, match="cannot write"):
        export_rosbag(ESTIMATES, "front", tmp_path / "nowhere" / "result")


def test_the_transforms_of_ros_1_carry_the_digest_that_ros_knows(tmp_path: Path) -> None:
    export_rosbag(ESTIMATES, "front", tmp_path / "result.bag")
    assert b"94810edda583a504dfda3829e70d7eec" in (tmp_path / "result.bag").read_bytes()
