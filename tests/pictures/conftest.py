"""Messages made up for pictures: a mount that becomes known while a robot drives."""

from collections.abc import Callable

import numpy as np
import pytest

from omnivert.messages import Estimate, Mount, ParameterVerdict, State

TRUTH = (-0.34, 0.23, 0.33)


def estimate(frame: int, state: State = State.USABLE, known: bool = True, **more: object) -> Estimate:
    """After so many frames, sigma having fallen as it does on a drive; one sigma off in every parameter."""
    shrink = 1.0 / (1.0 + (frame / 25.0) ** 2)
    sigma = np.array([np.radians(18 * shrink + 0.4), 0.08 * shrink + 0.0011, np.radians(18 * shrink + 0.5)])
    mount = Mount(TRUTH[0] + sigma[0], TRUTH[1] + sigma[1], TRUTH[2] + sigma[2], np.diag(sigma**2))
    verdict = ParameterVerdict(state, "" if state is State.CALIBRATED else "not apart from psi")
    fields = {
        "stamp_ns": frame * 333_333_333,
        "frame": frame,
        "mount": mount if known else None,
        "state": state,
        "phi": verdict,
        "rho": verdict,
        "psi": verdict,
        "next_manoeuvre": "" if state is State.CALIBRATED else "Turn 90 deg on the spot",
        "driven_m": 0.03 * frame,
        "turned_rad": 0.02 * frame,
        "lines_used": 12,
        "lines_new": 2,
        "lines_rejected": 1,
    }
    return Estimate(**{**fields, **more})  # type: ignore[arg-type]


@pytest.fixture
def estimate_of() -> Callable[..., Estimate]:
    return estimate


@pytest.fixture
def drive() -> list[Estimate]:
    """A whole drive: nothing known, then not yet, usable, calibrated."""
    states = [State.NOT_YET] * 60 + [State.USABLE] * 40 + [State.CALIBRATED] * 58
    return [estimate(frame + 1, state, known=frame > 12) for frame, state in enumerate(states)]
