"""When a stored mount may be taken up again, and what is said when not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from omnivert import __version__
from omnivert.config import Config, parsed
from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Entry, restorable

CONFIG = Config()
MOUNT = Mount(-0.34, 0.23, 0.33, np.diag([1e-4, 1e-6, 1e-4]))
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
    "change",
    [
        {"robot": {"wheel_base_m": 0.41}},
        {"encoder": {"ticks_per_rev": 1000}},
        {"camera": {"bearing_sign": -1}},
        {"ring": {"r_max_px": 230.0}},
    ],
)
def test_a_changed_rig_is_another_rig(change: dict[str, Any]) -> None:
    allowed, why = restorable(Entry(1, "", GOOD), parsed(change, ""))
    assert not allowed
    assert "another rig" in why
