"""When a stored mount may be taken up again, and what is said when not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from omnivert import __version__
from omnivert.config import Config, parsed
from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Entry
from omnivert.store_rules import restorable

CONFIG = Config()
MOUNT = Mount(-0.34, 0.23, 0.33, np.diag([1e-4, 1e-6, 1e-4]))
ENCODER = "encoder (id, left_sign, right_sign, swap_sides, ticks_per_rev, wheel_diameter_m)"
GOOD = Extrinsics(5, "demo", "front", MOUNT, State.CALIBRATED, 99, (), f"omnivert {__version__}", CONFIG.rig_digest())


def asked(**changes: Any) -> tuple[bool, str]:
    return restorable(Entry(1, "2026-01-01T00:00:00.000Z", replace(GOOD, **changes)), CONFIG)


def test_a_calibrated_mount_of_this_rig_is_taken_up() -> None:
    assert asked() == (True, "")
    major = __version__.split(".")[0]
    assert asked(software=f"omnivert {major}.99.1")[0]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"robot": "other"}, "other/front"),
        ({"camera": "back"}, "demo/back"),
        ({"rig_digest": "0" * 16}, "another rig"),
        ({"software": "omnivert 99.0.0"}, "omnivert 99.0.0"),
        ({"software": ""}, "stored by"),
        ({"state": State.USABLE}, "as usable"),
        ({"state": State.NOT_YET}, "as not yet"),
        ({"mount": replace(MOUNT, covariance=np.zeros((3, 3)))}, "covariance"),
        ({"mount": replace(MOUNT, covariance=np.diag([1e-4, -1e-6, 1e-4]))}, "covariance"),
        ({"mount": replace(MOUNT, covariance=np.full((3, 3), 1e-4))}, "covariance"),
        ({"mount": replace(MOUNT, covariance=np.diag([1e-4, np.nan, 1e-4]))}, "covariance"),
        ({"mount": replace(MOUNT, covariance=np.diag([1e-4, 1e-6]))}, "covariance"),
        ({"mount": replace(MOUNT, covariance=np.triu(np.full((3, 3), 1e-5)) + 1e-4 * np.eye(3))}, "covariance"),
        ({"mount": replace(MOUNT, phi_rad=float("nan"))}, "not finite"),
        ({"mount": replace(MOUNT, rho_m=-0.1)}, "cannot be"),
    ],
)
def test_anything_else_is_refused_with_the_reason(changes: dict[str, Any], why: str) -> None:
    allowed, said = asked(**changes)
    assert not allowed
    assert why in said


def test_a_covariance_of_very_unlike_units_is_still_one() -> None:
    root = np.array([[1e-2, 0, 0], [5e-8, 1e-7, 0], [-9e-3, 2e-8, 1e-3]])
    assert asked(mount=replace(MOUNT, covariance=root @ root.T)) == (True, "")


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"robot": {"wheel_base_m": 0.41}}, "robot (id, wheel_base_m)"),
        ({"encoder": {"ticks_per_rev": 1000}}, ENCODER),
        ({"encoder": {"swap_sides": True}}, ENCODER),
        ({"camera": {"bearing_sign": -1}}, "camera (bearing_sign, height_px, id, width_px, stamp_delay_s)"),
        ({"camera": {"stamp_delay_s": 0.016}}, "camera (bearing_sign, height_px, id, width_px, stamp_delay_s)"),
        ({"ring": {"r_max_px": 230.0}}, "ring (horizon_px, r_max_px, r_min_px)"),
        ({"calibration": {"mode": "paper"}}, "calibration (mode)"),
    ],
)
def test_a_changed_rig_is_another_rig_and_where_it_differs_is_said(change: dict[str, Any], named: str) -> None:
    allowed, why = restorable(Entry(1, "", GOOD), parsed(change, ""))
    assert not allowed
    assert why == f"stored for another rig: what differs is {named}"


def test_what_does_not_move_the_mount_changes_no_rig() -> None:
    free = parsed({"camera": {"frame_rate_hz": 30.0, "source": "1"}, "ring": {"center_px": [320.0, 240.0]}}, "")
    assert restorable(Entry(1, "", GOOD), free) == (True, "")
