"""The monitor's screen says what was heard, how old it is, and what is missing."""

from collections.abc import Callable

import numpy as np
import pytest
from rich.console import Console

from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Health, Mount, ParameterVerdict, Playback, Receipt, State
from omnivert.pictures.monitor_view import View

ALL = frozenset((name, "front") for name in ("bridge", "vision", "calibration", "storage"))
Estimates = Callable[..., Estimate]
FRAME, TICKS = "v1/camera/front/frame", "v1/encoder/base/ticks"


@pytest.fixture
def view() -> View:
    return View(Config(), "tcp/127.0.0.1:7447")


def text(view: View, now_s: float) -> str:
    console = Console(width=100, height=40, record=True, file=None, color_system=None, force_terminal=False)
    with console.capture() as captured:
        console.print(view.screen(now_s))
    return captured.get()


def health(service: str, second: int, published: int, **more: object) -> Health:
    keys = {"vision": "v1/vision/front/bearings", "calibration": "v1/calibration/front/estimate", "bridge": FRAME}
    key = keys.get(service, f"v1/{service}/front/x")
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
    view.acknowledge(Receipt(1, "demo", "front", 4), 0.0)
    assert "stored: phi" in text(view, 0.1)
    assert "saved" not in text(view, 0.1)
    assert "stored phi" in view.line(0.1)


def test_what_is_only_claimed_is_not_called_stored(view: View, estimate_of: Estimates) -> None:
    mount = estimate_of(100).mount
    assert mount is not None
    claim = Extrinsics(5, "demo", "front", mount, State.CALIBRATED, 100, (), "omnivert 0.1.0", "abc")
    view.step(claim, 0.0)
    view.step(Receipt(4, "demo", "front", 1), 0.1)
    assert "nothing stored yet" in text(view, 0.2)
    assert view.json()["stored"] is None
    view.step(Receipt(5, "demo", "front", 2), 0.3)
    assert "stored: phi" in text(view, 0.4)
    assert view.json()["stored"]["stamp_ns"] == 5


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
    for sensor in ("camera", "encoder"):
        assert any(f"– {sensor}" in line and "no health message yet" in line for line in lines)


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
    assert line.startswith("30.0s usable phi -17.8 ± 1.7 deg  rho")
    assert line.endswith('next="Turn 90 deg on the spot"')
    assert "stale=" in view.line(60.0)


def bridge(second: float, notes: tuple[str, ...] = (), frames: int = 15, ticks: int = 50) -> Health:
    published = {FRAME: round(frames * second), TICKS: round(ticks * second)}
    return Health(round(second * 1e9), "bridge", "front", second, published=published, notes=notes)


def row(view: View, name: str, now_s: float) -> str:
    return next(line for line in text(view, now_s).splitlines() if line[3:].startswith(f"{name} "))


def test_camera_and_encoder_have_a_row_and_a_rate_each(view: View) -> None:
    view.present(ALL)
    for second in (1.0, 2.0, 3.0):
        view.step(bridge(second), second)
    assert "✓ camera" in row(view, "camera", 3.0)
    assert row(view, "camera", 3.0).split()[2:5] == ["15.0", "Hz", "15.0"]
    assert row(view, "encoder", 3.0).split()[2:] == ["50.0", "Hz"]


def test_no_rate_is_made_of_less_than_half_a_second(view: View) -> None:
    view.present(ALL)
    view.step(bridge(1.0), 1.0)
    view.step(bridge(1.1, frames=90), 1.1)
    assert "Hz" not in row(view, "camera", 1.2)


def test_without_the_robots_configuration_no_rate_is_expected() -> None:
    view = View(Config(), "here", rate_known=False)
    view.present(ALL)
    for second in (1.0, 2.0):
        view.step(bridge(second), second)
    assert row(view, "camera", 2.0).split()[2:] == ["15.0", "Hz", "–"]


@pytest.mark.parametrize(
    ("note", "name", "next_step"),
    [
        ("encoder: /dev/ttyUSB0 does not open", "encoder", "connect the encoder: /dev/ttyUSB0 does not open"),
        ("camera: 0 is open and has given nothing usable for 5 s", "camera", "look at the camera: 0 is open"),
        ("camera: frames have 640 x 480 pixels, the configuration says 800 x 480", "camera", "camera.width_px = 640:"),
        (
            "camera: frames have 1 x 2 pixels, the configuration says 3 x 4",
            "camera",
            "set camera.width_px = 1 and camera.height_px = 2:",
        ),
    ],
)
def test_a_device_in_trouble_is_marked_and_comes_next(
    view: View, estimate_of: Estimates, note: str, name: str, next_step: str
) -> None:
    view.present(ALL)
    view.step(estimate_of(100), 1.0)
    view.step(bridge(1.0, (note,)), 1.0)
    assert f"! {name}" in row(view, name, 1.1)
    assert next(line for line in text(view, 1.1).splitlines() if "NEXT" in line).find(next_step) > 0
    assert next_step in view.line(1.1)


def test_who_stamps_the_frames_is_told_as_no_trouble_and_hides_none(view: View) -> None:
    facts = "camera: stamped by the kernel; 15 Hz; exposure 8 ms fixed"
    view.present(ALL)
    for second in (1.0, 2.0):
        view.step(bridge(second, (facts,)), second)
    assert "✓ camera" in row(view, "camera", 2.0)
    assert "stamped by the kernel" in row(view, "camera", 2.0)
    for second in range(3, 14):
        view.step(bridge(float(second), (facts,), frames=0), float(second))
    assert "! camera" in row(view, "camera", 13.0)  # it gives none


@pytest.mark.parametrize("note", ["begins from nothing: a playback", "goes on from the stored extrinsics"])
def test_how_a_calibration_begins_is_no_trouble_and_told_until_it_has_begun(
    view: View, estimate_of: Estimates, note: str
) -> None:
    view.present(ALL)
    view.step(health("calibration", 1, 1, notes=(note,)), 1.0)
    assert "✓ calibration" in row(view, "calibration", 1.0)
    assert note in row(view, "calibration", 1.0)
    view.step(estimate_of(1), 1.0)
    assert note not in text(view, 1.1)


def test_a_system_that_is_gone_is_not_called_calibrated(view: View, estimate_of: Estimates) -> None:
    view.present(ALL)
    mount = estimate_of(100).mount
    assert mount is not None
    view.step(estimate_of(100, State.CALIBRATED), 1.0)
    view.step(Extrinsics(1, "demo", "front", mount, State.CALIBRATED, 100, (), "omnivert 0.1.0", "abc"), 1.0)
    view.step(Receipt(1, "demo", "front", 4), 1.0)
    assert "nothing is missing" in text(view, 1.1)
    view.present(frozenset({("monitor", "m7")}))
    shown = text(view, 36.0)
    assert "CALIBRATED" not in shown
    assert "nothing is missing" not in shown
    assert "NEXT  no service answers" in shown
    assert "calibrated, 35 s ago" in shown
    assert " not_running phi" in view.line(36.0)


def test_a_long_trouble_has_a_line_of_its_own(view: View) -> None:
    view.present(ALL)
    note = "storage: the disk is full, so that nothing can be stored; 3 waiting"
    view.step(health("storage", 1, 1, notes=(note,)), 1.0)
    assert f"   storage: {note}" in text(view, 1.0).splitlines()


def test_one_screen_alone_has_nothing_to_quit(view: View) -> None:
    assert "ctrl-c quits" in text(view, 0.0)
    console = Console(width=100, color_system=None)
    with console.capture() as captured:
        console.print(view.screen(0.0, once=True))
    assert "ctrl-c" not in captured.get()


def test_huge_numbers_do_not_widen_the_screen(view: View, estimate_of: Estimates) -> None:
    view.present(ALL)
    mount = Mount(0.0, 100.0, 0.0, np.diag([1e300] * 3))
    view.step(estimate_of(100, mount=mount, lines_used=2**62, lines_new=2**62, driven_m=1e9), 2.0)
    for second in (1, 2):
        counts = {"gaps": {"k": 2**62}, "refused": {"r": 2**62}}
        view.step(health("vision", second, second * 2**60, **counts), float(second))
    lines = text(view, 2.1).splitlines()
    assert max(map(len, lines)) <= 100
    assert ">9999 " in row(view, "vision", 2.1)
    assert any(line.startswith(" phi ") and "calibrated" not in line and "e+" in line for line in lines)


def test_no_text_from_the_network_reaches_the_terminal_with_control_characters(
    view: View, estimate_of: Estimates
) -> None:
    evil = "\x1b]0;x\x07 \x9b2J \r\n \u202e"
    part = ParameterVerdict(State.NOT_YET, evil)
    view.present(ALL)
    view.step(estimate_of(9, phi=part, rho=part, psi=part, reasons=(evil, evil * 9), next_manoeuvre=evil), 1.0)
    for service in ("vision", "calibration", "storage", "player", "recorder"):
        view.step(health(service, 1, 1, notes=(evil, evil * 9), refused={evil: 3}), 1.0)
    for notes in ((), (f"encoder: {evil}", f"camera: {evil}")):
        view.step(bridge(1.0, notes), 1.0)
        assert set(text(view, 1.1) + view.line(1.1)).isdisjoint("\x1b\x07\x9b\r\u202e")
        assert "\n" not in view.line(1.1)


def test_a_restarted_service_does_not_show_a_negative_rate(view: View) -> None:
    view.present(ALL)
    view.step(health("vision", 9, 900), 1.0)
    view.step(health("vision", 1, 3), 2.0)
    assert "-" not in next(line for line in text(view, 2.1).splitlines() if " vision" in line).split("vision")[1]
