"""`omnivert simulate` and what stands around it, as a person calls it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnivert.cli.robot.demo_watch import Heard
from omnivert.cli.robot.drive import MOTIONS, STOP, line
from omnivert.messages import Estimate, Frame, Mount, ParameterVerdict, PixelFormat, State
from omnivert.wire.recording import Recording

SHORT = "[[leg]]\nturn_deg = 6.0\n"
SLOW = "[camera]\nframe_rate_hz = 2.0\n"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "short.toml").write_text(SHORT)
    (tmp_path / "robot.toml").write_text(SLOW)
    return tmp_path


def test_a_recording_can_be_tracked_and_is_scored(files: Path, omnivert: Any) -> None:
    out = files / "drive.mcap"
    ran = omnivert("simulate", "-o", out, "--path", files / "short.toml", "-c", files / "robot.toml", "--json")
    assert ran.code == 0, ran.err
    body = ran.json
    assert body["messages"] == {"Frame": 2, "Ticks": 50, "Scan": 2}
    assert dict(Recording(out).counts) == {
        "v1/camera/front/frame": 2,
        "v1/encoder/base/ticks": 50,
        "v1/laser/front/scan": 2,
    }
    assert body["truth"]["rho_m"] == 0.23
    tracked = omnivert("track", out, "--json")
    assert tracked.code == 0, tracked.err
    assert tracked.json["score"]["recall"] > 0.8


@pytest.mark.parametrize(
    ("arguments", "code", "exit_code"),
    [
        (("--world", "nowhere"), "OV212", 2),
        (("--path", "papr"), "OV212", 2),
        ((), "OV205", 2),
    ],
)
def test_what_does_not_exist_is_refused(
    omnivert: Any, tmp_path: Path, arguments: tuple[str, ...], code: str, exit_code: int
) -> None:
    out = ("-o", tmp_path / "x.mcap") if arguments else ()
    ran = omnivert("simulate", *out, *arguments)
    assert (ran.code, code in ran.err) == (exit_code, True), ran.err
    assert list(tmp_path.iterdir()) == []


def test_a_path_into_the_wall_leaves_nothing(omnivert: Any, files: Path) -> None:
    (files / "far.toml").write_text("speed_m_s = 5.0\n[[leg]]\nstraight_m = 90.0\n")
    ran = omnivert("simulate", "-o", files / "x", "--path", files / "far.toml")
    assert ran.code == 1
    assert "OV213" in ran.err
    assert sorted(path.name for path in files.iterdir()) == ["far.toml", "robot.toml", "short.toml"]


def test_the_shown_files_are_a_world_and_a_path_of_ones_own(omnivert: Any, files: Path) -> None:
    ran = omnivert("simulate", "--show", "--world", "hall", "--path", "arc-0.5")
    world, _, path = ran.out.partition("# paths/")
    (files / "my.toml").write_text(world)
    (files / "way.toml").write_text(f"# {path}")
    out = files / "drive"
    ran = omnivert(
        "simulate", "-o", out, "--world", files / "my.toml", "--path", files / "short.toml", "-c", files / "robot.toml"
    )
    assert ran.code == 0, ran.err
    assert len(list((out / "frames").iterdir())) == 2
    assert omnivert("simulate", "-o", out, "--path", files / "way.toml").code == 2  # is there already


def test_a_file_of_ones_own_is_shown_too_and_one_that_is_none_is_named(omnivert: Any, files: Path) -> None:
    ran = omnivert("simulate", "--show", "--path", files / "short.toml")
    assert (ran.code, SHORT in ran.out) == (0, True)
    for arguments, said in ((("--world", "offise"), "did you mean office"), (("--path", "my.toml"), "cannot read my")):
        ran = omnivert("simulate", "--show", *arguments)
        assert (ran.code, ran.out) == (2, "")
        assert "OV212" in ran.err
        assert said in ran.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("up", "--path", "paper"),
        ("up", "--sim", "office", "--play", "corridor"),
        ("up", "--sim", "offise"),
        ("up", "--sim", "office", "--path", "papr"),
        ("demo", "--sim", "--speed", "2"),
        ("drive",),
    ],
)
def test_what_does_not_go_together_is_refused(omnivert: Any, arguments: tuple[str, ...]) -> None:
    assert omnivert(*arguments).code == 2


def test_the_line_of_drive_says_motion_state_sigmas_and_what_next() -> None:
    covariance = np.diag([np.radians(1.5), 0.004, np.radians(1.6)]) ** 2
    part = ParameterVerdict(State.NOT_YET)
    mount = Mount(0.1, 0.2, 0.3, covariance)
    estimate = Estimate(1, 1, mount, State.NOT_YET, part, part, part, "turn 90 deg", 1.0, 1.0, 5, 0, 0)
    said = line(MOTIONS[b"w"], estimate, 120)
    for part_of_it in ("forward", "not yet", "phi ±1.5 deg", "rho ±0.0040 m", "psi ±1.6 deg", "next: turn 90 deg"):
        assert part_of_it in said
    assert len(line(STOP, estimate, 40)) == 40
    assert "waiting" in line(None, None, 80)
    assert "in the way" in line(STOP, None, 80, blocked=True)


def test_a_live_demo_is_over_with_the_estimate_of_its_last_frame() -> None:
    heard = Heard(total_frames=2, end_ns=0)
    part = ParameterVerdict(State.NOT_YET)
    heard.step(Frame(20, PixelFormat.GREY8, 1, 1, np.zeros(1, np.uint8)))
    heard.step(Estimate(10, 1, None, State.NOT_YET, part, part, part, "", 1.0, 1.0, 5, 0, 0))
    assert not heard.complete
    heard.ended()
    assert not heard.complete
    heard.step(Estimate(20, 2, None, State.NOT_YET, part, part, part, "", 1.0, 1.0, 5, 0, 0))
    assert heard.complete
