"""The packaged drive with an encoder that starts anew on the way: what one part leaves open, no claim may close."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from omnivert.calibration.calibrator import Calibrator
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Frame, Mount, Ticks
from omnivert.timeline import Timeline
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.recording import Recording

TRUTH = np.array([-0.34, 0.23, 0.33])
CORRIDOR = Path(__file__).resolve().parents[2] / "omnivert" / "data" / "corridor.mcap"


@pytest.fixture(scope="module")
def drive() -> tuple[Config, list[Ticks | Bearings]]:
    recording = Recording(CORRIDOR)
    config = recording.config(Config())
    front_end = FrontEnd(config)
    timeline = Timeline((Ticks, Bearings), config.timeline)
    ordered = []
    for _, message in recording.messages(types=(Frame, Ticks)):
        ordered += timeline.push(front_end.step(message) if isinstance(message, Frame) else message, replay=True)
    return config, [m for m in (*ordered, *timeline.drain()) if isinstance(m, Ticks | Bearings)]


def final_mount(config: Config, messages: list[Ticks | Bearings]) -> Mount:
    calibrator = Calibrator(config)
    out = [told for message in messages for told in calibrator.step(message)] + list(calibrator.close())
    mount = [told.mount for told in out if isinstance(told, Estimate)][-1]
    assert mount is not None
    return mount


@pytest.mark.parametrize("after_s", [20.0, 25.0])  # on the straight; 27 deg into the turn
def test_a_restarted_encoder_makes_no_claim_untrue(
    drive: tuple[Config, list[Ticks | Bearings]], after_s: float
) -> None:
    config, messages = drive
    broken_ns = messages[0].stamp_ns + round(after_s * 1e9)
    mount = final_mount(
        config,
        [
            replace(m, left=m.left + 2**40, right=m.right + 2**40)
            if isinstance(m, Ticks) and m.stamp_ns > broken_ns
            else m
            for m in messages
        ],
    )
    off = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]) - TRUTH
    assert off @ np.linalg.solve(mount.covariance, off) < 16.3  # chi-square of 3, 1 in 1000
    assert abs(off[1]) < 0.01
