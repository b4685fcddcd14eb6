"""The front end on photographs through real mirrors; their rings were measured by hand on one picture each."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from omnivert.angles import wrap
from omnivert.config import Config
from omnivert.messages import Bearings, Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd

RINGS = {
    "vmr": (1024, 768, (516.7, 384.1), 90.0, 452.5),
    "kaidan": (640, 480, (325.2, 246.6), 70.0, 223.2),
    "static": (640, 480, (328.0, 253.3), 60.0, 208.8),
}


def _seen(shared_data: Path, name: str) -> list[Bearings]:
    width, height, center, r_min, r_max = RINGS[name]
    given = {
        "camera": {"width_px": width, "height_px": height},
        "ring": {"center_px": center, "r_min_px": r_min, "r_max_px": r_max},
    }
    front = FrontEnd(Config.model_validate(given))
    files = sorted((shared_data / "real" / name).glob("*.jpg"))
    if not files:
        pytest.skip(f"needs the photographs real/{name}, which are not here")
    frames = [Frame(0, PixelFormat.JPEG, width, height, np.fromfile(file, dtype=np.uint8)) for file in files]
    return [front.step(frame) for frame in frames]


@pytest.mark.parametrize("name", RINGS)
def test_the_ring_is_found_in_every_photograph(shared_data: Path, name: str) -> None:
    for seen in _seen(shared_data, name):
        assert seen.reasons == ()
        assert seen.ring is not None
        assert np.hypot(*np.subtract((seen.ring.center_u_px, seen.ring.center_v_px), RINGS[name][2])) < 1.5
        assert seen.ring.quality > 0.55


def test_the_strong_edges_of_windows_and_shelf_are_among_the_lines(
    shared_data: Path, strong_edges_deg: tuple[float, ...]
) -> None:
    first = np.rad2deg(_seen(shared_data, "vmr")[0].bearing_rad)
    for by_eye in strong_edges_deg:
        assert np.min(np.abs(first - by_eye)) < 0.5


def test_lines_keep_their_identity_when_the_camera_is_turned_far(shared_data: Path) -> None:
    """The camera was turned by 0, 0, -41.5, -102.25 deg: lines in the picture turn the other way round."""
    seen = _seen(shared_data, "vmr")
    for before, after, turn in zip(seen[:3], seen[1:4], (0.0, 41.5, 60.75), strict=True):
        _, i, j = np.intersect1d(before.track_id, after.track_id, return_indices=True)
        moved = np.rad2deg(wrap(after.bearing_rad[j] - before.bearing_rad[i]))
        assert i.size >= 8
        assert abs(float(np.median(moved)) - turn) < 1.5


def test_a_still_camera_sees_still_lines(shared_data: Path) -> None:
    seen = _seen(shared_data, "static")
    for before, after in itertools.pairwise(seen):
        _, i, j = np.intersect1d(before.track_id, after.track_id, return_indices=True)
        assert i.size >= 4
        assert abs(float(np.median(wrap(after.bearing_rad[j] - before.bearing_rad[i])))) < np.deg2rad(1.0)


def test_where_the_lines_of_a_leaning_mirror_meet_is_found_and_kept(shared_data: Path) -> None:
    seen, off = _seen(shared_data, "static"), []
    for s in seen:
        assert s.ring is not None
        assert s.meeting is not None
        assert s.meeting.used
        assert s.bearing_rad.size >= 30  # measured 40 to 51
        off.append((s.meeting.u_px - s.ring.center_u_px, s.meeting.v_px - s.ring.center_v_px))
    away = np.hypot(*np.transpose(off))
    assert np.min(away) > 40.0  # measured 55
    assert np.max(away) < 60.0
    assert np.max(np.ptp(off, axis=0)) < 3.0  # measured 1.0
