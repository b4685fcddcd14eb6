"""The monitor's screen says what was heard, how old it is, and what is missing."""

from collections.abc import Callable

import numpy as np
import pytest
from rich.console import Console

from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Health, ParameterVerdict, Playback, Receipt, State
from omnivert.pictures.monitor_view import View

ALL = frozenset((name, "front") for name in ("bridge", "vision", "calibration", "storage"))
Estimates = Callable[..., Estimate]


@pytest.fixture
def view() -> View:
    return View(Config(), "tcp/127.0.0.1:7447")


def text(view: View, now_s: float) -> str:
    console = Console(width=100, height=40, record=True, file=None, color_system=None, force_terminal=False)
    with console.capture() as captured:
        console.print(view.screen(now_s))
    return captured.get()


def health(service: str, second: int, published: int, **more: object) -> Health:
    key = {"vision": "v1/vision/front/bearings"}.get(service, f"v1/{service}/front/x")
    return Health(second * 10**9, service, "front", float(second), published={key: published}, **more)  # type: ignore[arg-type]


def bearings(frame: int) -> Bearings:
    angles = np.linspace(-3.0, 3.0, 20)
    return Bearings(frame, np.arange(20), angles, np.full(20, 0.003), np.ones(20, np.int32), np.ones(20, np.float32))


def test_before_anything_is_heard_it_says_what_to_start(view: View) -> None:
    assert "omnivert up" in text(view, 0.0)
    assert "WAITING" in text(view, 0.0)
    view.present(frozenset({("bridge", "front"), ("vision", "front")}))
    assert "calibration not running" in text(view, 0.0)


def test_the_screen_shows_numbers_with_sigma_verdict_and_next_manoeuvre(view: View, estimate_of: Estimates) -> None:
    view.step(estimate_of(100), 10.0)
    shown = text(view, 10.05)
    assert "USABLE" in shown
    assert "Turn 90 deg on the spot" in shown
    assert "usable: not apart from psi" in shown
    assert "-18.0 deg" in shown
    assert "12 used   2 new   1 rejected" in shown
    assert "live  0.05 s old" in shown


def test_a_reason_too_long_for_its_row_stands_in_full_under_the_next_step(view: View, estimate_of: Estimates) -> None:
    reason = "because you drove straight for 3.3 m, phi and psi are seen only as a sum"
    part = ParameterVerdict(State.NOT_YET, reason)
    view.step(estimate_of(100, State.NOT_YET, known=False, phi=part, rho=part, psi=part), 10.0)
    assert text(view, 10.05).count("Because you drove straight for 3.3 m, phi and psi are seen only as a sum") == 1


def test_a_stream_that_stops_is_called_late_then_silent(view: View, estimate_of: Estimates) -> None:
    view.step(estimate_of(100), 10.0)
    assert "late  1.5 s old" in text(view, 11.5)
    assert "SILENT  last frame 20 s ago" in text(view, 30.0)


def test_a_late_joiner_sees_what_is_stored(view: View, estimate_of: Estimates) -> None:
    mount = estimate_of(100).mount
    assert mount is not None
    stored = Extrinsics(1, "demo", "front", mount, State.CALIBRATED, 100, (), "omnivert 0.1.0", "abc")
    view.step(stored, 0.0)
    assert "stored: phi" in text(view, 0.1)
    assert "stored phi" in view.line(0.1)


def test_services_show_rate_losses_and_their_first_trouble(view: View) -> None:
    view.present(ALL)
    for second in (1, 2, 3):
        view.step(health("vision", second, 15 * second, latency_p50_ms=4.1, latency_p99_ms=9.0), float(second))
        view.step(health("calibration", second, 15 * second, gaps={"k": 2}, refused={"late": 3}), float(second))
    lines = text(view, 3.1).splitlines()
    vision = next(line for line in lines if " vision" in line)
    calibration = next(line for line in lines if "calibration" in line)
    assert "✓ vision" in vision
    assert "15.0 Hz" in vision
    assert "4.1 ms" in vision
    assert "! calibration" in calibration
    assert " 2 " in calibration
    assert "3 refused: late" in calibration
    assert any("bridge" in line and "no health message yet" in line for line in lines)


def test_a_service_that_is_gone_is_shown_as_gone_not_as_live(view: View) -> None:
    view.present(ALL)
    view.step(health("vision", 1, 15), 1.0)
    view.present(ALL - {("vision", "front")})
    assert "– vision" in text(view, 9.0)
    assert "not running" in text(view, 9.0)


def test_storage_says_what_it_saved_and_the_player_how_far_it_is(view: View) -> None:
    view.present(ALL)
    view.step(health("storage", 1, 1), 1.0)
    view.step(health("player", 1, 1), 1.0)
    view.step(Receipt(1, "demo", "front", 41), 1.0)
    view.step(Playback(1, 30, 60, False), 1.0)
    shown = text(view, 2.0)
    assert "saved 1 s ago (#41)" in shown
    assert "50 % played" in shown


def test_the_screen_fits_100_columns_and_27_lines(view: View, estimate_of: Estimates) -> None:
    view.present(ALL)
    for second in range(1, 60):
        view.step(estimate_of(second, reasons=("a reason that is " + "long " * 30,)), float(second))
        view.step(bearings(second), float(second))
        for service, _ in ALL:
            view.step(health(service, second, second, notes=("a note that is " + "long " * 30,)), float(second))
    lines = text(view, 59.1).splitlines()
    assert len(lines) <= 27
    assert max(len(line) for line in lines) <= 100


def test_in_a_pipe_one_line_holds_state_numbers_and_next_step(view: View, estimate_of: Estimates) -> None:
    assert view.line(1.0).startswith("1.0s waiting")
    view.step(estimate_of(90), 2.0)
    line = view.line(2.1)
    assert "\n" not in line
    assert line.startswith("30.0s usable phi -17.8±1.7deg  rho")
    assert line.endswith('next="Turn 90 deg on the spot"')
    assert "stale=" in view.line(60.0)


def test_a_restarted_service_does_not_show_a_negative_rate(view: View) -> None:
    view.present(ALL)
    view.step(health("vision", 9, 900), 1.0)
    view.step(health("vision", 1, 3), 2.0)
    assert "-" not in next(line for line in text(view, 2.1).splitlines() if " vision" in line).split("vision")[1]
