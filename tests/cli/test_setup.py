"""`omnivert setup ring`: from pictures to a configuration that its owner still recognises."""

import os
import pty
import re
import struct
import subprocess
import sys
import tomllib
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.cli.robot import shots
from omnivert.cli.robot.config_edit import edit, edited
from omnivert.config import Config, load, parsed
from omnivert.errors import DataError, UseError

from .conftest import Omnivert

PICTURE = np.zeros((480, 640), dtype=np.uint8)


def mirror(folder: Path, name: str = "mirror.png", size: tuple[int, int] = (640, 480), seed: int = 1) -> Path:
    """A photograph of a mirror: a disc of wedges, black in its middle and around it."""
    folder.mkdir(exist_ok=True)
    v, u = np.mgrid[: size[1], : size[0]]
    x, y = u - 0.5 * size[0] - 7.0, v - 0.5 * size[1] + 4.0
    levels = np.random.default_rng(seed).uniform(70.0, 230.0, 24)
    ring = (np.hypot(x, y) < 0.42 * size[1]) & (np.hypot(x, y) > 0.12 * size[1])
    wedge = levels[np.minimum((np.arctan2(y, x) + np.pi) / (2.0 * np.pi) * 24.0, 23.0).astype(int)]
    (folder / name).write_bytes(cv2.imencode(".png", np.where(ring, wedge, 4.0).astype(np.uint8))[1].tobytes())
    return folder / name


CENTER, R_MIN, R_MAX = (327.0, 236.0), 57.6, 201.6

TOML = """\
# our robot; do not lose this line
[ring]
center_px = [300.0, 200.0]  # by hand, on Tuesday
r_max_px = 190.0   # guessed

[robot]            # the green one
id = 'r7'
"""


def test_the_ring_goes_into_the_file_and_all_else_in_it_stays(omnivert: Omnivert, tmp_path: Path) -> None:
    toml, drawn = tmp_path / "robot.toml", tmp_path / "drawn.png"
    toml.write_text(TOML)
    toml.chmod(0o640)
    ran = omnivert("setup", "ring", mirror(tmp_path), "--config", toml, "--picture", drawn, "--yes")
    assert ran.code == 0, ran.err
    ring = load(toml).ring
    assert np.hypot(ring.center_px[0] - CENTER[0], ring.center_px[1] - CENTER[1]) < 0.5
    assert abs(ring.r_max_px - R_MAX) < 1.0
    assert abs(ring.r_min_px - R_MIN) < 5.0
    lines = toml.read_text().splitlines()
    assert lines[0] == "# our robot; do not lose this line"
    assert lines[2].startswith("center_px = [32")
    assert lines[2].endswith("]  # by hand, on Tuesday")
    assert lines[3].endswith("   # guessed")
    assert lines[-2:] == ["[robot]            # the green one", "id = 'r7'"]
    assert toml.stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drawn.png", "mirror.png", "robot.toml"]
    shown = cv2.imread(str(drawn))
    assert shown is not None
    assert shown.shape[0] >= 2 * 480  # twice as large, below a band
    again = omnivert("setup", "ring", mirror(tmp_path), "--config", toml, "--picture", drawn, "--yes")
    assert "says so already" in again.err
    for told in (ran, again):
        assert told.err.splitlines()[-1].startswith(f"next    omnivert up --config {toml}")


def test_nothing_is_written_without_a_yes(omnivert: Omnivert, tmp_path: Path) -> None:
    toml = tmp_path / "robot.toml"
    toml.write_text(TOML)
    ran = omnivert("setup", "ring", mirror(tmp_path), "-c", toml, "--picture", tmp_path / "drawn.png", "--json")
    assert ran.code == 0
    assert toml.read_text() == TOML
    assert ran.json["written"] is None
    assert set(ran.json["changes"]["ring"]) == {"center_px", "r_min_px", "r_max_px"}
    told = omnivert("setup", "ring", mirror(tmp_path), "-c", toml, "--picture", tmp_path / "drawn.png")
    assert "not written" in told.err
    assert toml.read_text() == TOML


@pytest.mark.parametrize("answer", ["y", "n"])
def test_a_person_at_a_terminal_is_asked(tmp_path: Path, answer: str) -> None:
    toml = tmp_path / "robot.toml"
    toml.write_text(TOML)
    arguments = ["setup", "ring", str(mirror(tmp_path)), "-c", str(toml), "--picture", str(tmp_path / "drawn.png")]
    program = f"from omnivert.cli import main; import sys; sys.argv[1:] = {arguments!r}; main()"
    ours, theirs = pty.openpty()
    with subprocess.Popen([sys.executable, "-c", program], stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        seen = b""
        while b"[y/N]" not in seen:
            seen += os.read(ours, 4096)
        os.write(ours, f"{answer}\n".encode())
        try:
            while piece := os.read(ours, 4096):
                seen += piece
        except OSError:  # the other end is closed
            pass
        assert process.wait(30.0) == 0
    os.close(ours)
    assert (toml.read_text() != TOML) is (answer == "y"), seen


def test_pictures_of_another_size_than_configured_change_the_camera_too(omnivert: Omnivert, tmp_path: Path) -> None:
    toml = tmp_path / "robot.toml"
    toml.write_text(TOML)
    picture = mirror(tmp_path, size=(800, 600))
    assert omnivert("setup", "ring", picture, "-c", toml, "--picture", tmp_path / "drawn.png", "--yes").code == 0
    camera = load(toml).camera
    assert (camera.width_px, camera.height_px) == (800, 600)


def test_a_folder_is_read_and_what_cannot_be_is_named(omnivert: Omnivert, tmp_path: Path) -> None:
    for k in range(3):
        mirror(tmp_path / "photos", f"{k}.png", seed=k)
    (tmp_path / "photos" / "torn.jpg").write_bytes(b"\xff\xd8 torn")
    (tmp_path / "photos" / "empty.png").write_bytes(b"")
    ran = omnivert("setup", "ring", tmp_path / "photos", "--picture", tmp_path / "drawn.png", "--json")
    assert (ran.code, ran.json["pictures"], ran.json["agree"], len(ran.json["left_out"])) == (0, 3, 3, 2)
    assert "torn.jpg" in ran.err
    assert "empty.png" in ran.err
    assert ran.json["r_min_from"] == "both"


def test_the_camera_of_the_configuration_is_looked_through_when_no_picture_is_named(
    omnivert: Omnivert, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shots, "LIVE_EVERY_S", 0.01)
    for k in range(4):
        mirror(tmp_path / "camera", f"{k}.png", seed=k)
    toml = tmp_path / "robot.toml"
    toml.write_text(f"[camera]\nsource = '{tmp_path / 'camera'}'\nframe_rate_hz = 50.0\n")
    ran = omnivert("setup", "ring", "-c", toml, "--picture", tmp_path / "drawn.png", "--yes", "--json")
    assert (ran.code, ran.json["pictures"]) == (0, 4)
    assert abs(load(toml).ring.r_max_px - R_MAX) < 1.0


def test_a_camera_that_does_not_open_is_refused_in_time(
    omnivert: Omnivert, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shots, "LIVE_PATIENCE_S", 0.3)
    toml = tmp_path / "robot.toml"
    toml.write_text(f"[camera]\nsource = '{tmp_path / 'away'}'\nreopen_s = 0.05\n")
    ran = omnivert("setup", "ring", "-c", toml, "--picture", tmp_path / "drawn.png")
    assert ran.code == 1
    assert "error[OV501]" in ran.err
    assert "is not there" in ran.err


def png_that_claims(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header says that it is that large."""

    def part(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", header) + part(b"IDAT", zlib.compress(b"\0" * 100)) + part(b"IEND", b"")


def test_what_cannot_be_measured_is_refused_with_a_code_and_the_way_out(omnivert: Omnivert, tmp_path: Path) -> None:
    def refused(code: int, error: str, text: str, *arguments: object) -> None:
        ran = omnivert("setup", "ring", *arguments, "--picture", tmp_path / "drawn.png")
        assert ran.code == code, ran.err
        assert f"error[{error}]" in ran.err
        assert text in ran.err
        assert not (tmp_path / "drawn.png").exists()

    black = tmp_path / "black.png"
    cv2.imwrite(str(black), PICTURE)
    refused(1, "OV120", "nothing is in it", black)
    refused(1, "OV121", "not of one size", mirror(tmp_path), mirror(tmp_path, "b.png", (800, 600)))
    refused(2, "OV321", "there is no such file", tmp_path / "missing.png")
    (tmp_path / "none").mkdir()
    refused(1, "OV121", "there is no image in it", tmp_path / "none")
    (tmp_path / "bomb.png").write_bytes(png_that_claims(30_000, 30_000))
    refused(1, "OV121", "beyond the limit of 16384", tmp_path / "bomb.png")
    with (tmp_path / "huge.jpg").open("wb") as file:
        file.truncate(2 * 2**30)
    refused(1, "OV121", "beyond the limit of 256 MiB", tmp_path / "huge.jpg")
    (tmp_path / "r.json").write_text("{}")
    refused(2, "OV208", "only a TOML file", mirror(tmp_path), "-c", tmp_path / "r.json", "--yes")


def test_a_picture_is_never_drawn_over_one_that_is_measured(omnivert: Omnivert, tmp_path: Path) -> None:
    picture = mirror(tmp_path)
    held = picture.read_bytes()
    assert omnivert("setup", "ring", picture, "--picture", picture).code == 2
    assert picture.read_bytes() == held


def test_settings_that_do_not_go_together_leave_the_file_as_it_is(omnivert: Omnivert, tmp_path: Path) -> None:
    toml = tmp_path / "robot.toml"
    toml.write_text("[ring]\nr_min_px = 230.0\nr_max_px = 300.0\nhorizon_px = 260.0\n")
    held = toml.read_bytes()
    ran = omnivert("setup", "ring", mirror(tmp_path), "-c", toml, "--picture", tmp_path / "drawn.png", "--yes")
    assert ran.code == 2
    assert "horizon_px" in ran.err
    assert toml.read_bytes() == held


# ---------------------------------------------------------------- files that people write

CHANGES: dict[str, dict[str, Any]] = {"ring": {"center_px": [311.1, 222.2], "r_max_px": 201.0}}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# only a comment\n",
        "ring.center_px = [1.0, 2.0]\nring.r_max_px = 99.0\n[robot]\nid = 'a'\n",
        "ring = {center_px = [1.0, 2.0], r_max_px = 99.0}\n",
        "[ring]\r\nr_max_px = 99.0 # said he\r\n\r\n[robot]\r\nid = 'a'\r\n",
        "[ring]\ncenter_px = [ # of both\n  1.0, # u\n  2.0, # v\n# and more\n] # at the end\n",
        "[ring]\ncenter_px = [\n  1.0 # u\n  , 2.0 # v\n]\n",
        "[robot]\nid = 'a'",
    ],
)
def test_a_file_of_any_style_is_changed_in_place(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    before = load(path)
    edit(path, CHANGES)
    after = load(path)
    assert (after.ring.center_px, after.ring.r_max_px) == ((311.1, 222.2), 201.0)
    assert after.model_copy(update={"ring": before.ring}) == before
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")
    assert path.read_bytes().count(b"\r\n") >= text.count("\r\n")
    assert re.findall("# .*", path.read_text()) == re.findall(r"# [^\r\n]*", text)


def test_a_link_to_the_configuration_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real.toml").write_text(TOML)
    (tmp_path / "robot.toml").symlink_to(tmp_path / "real.toml")
    edit(tmp_path / "robot.toml", CHANGES)
    assert (tmp_path / "robot.toml").is_symlink()
    assert load(tmp_path / "real.toml").ring.r_max_px == 201.0


def test_what_is_added_ends_its_lines_as_the_file_does(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"# ours\r\n[robot]\r\nid = 'r7'\r\n")
    edit(path, CHANGES)
    held = path.read_bytes()
    assert held.startswith(b"# ours\r\n[robot]\r\nid = 'r7'\r\n")
    assert held.count(b"\n") == held.count(b"\r\n") > 5
    assert load(path).ring.r_max_px == 201.0


def test_a_file_that_is_write_protected_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(TOML)
    path.chmod(0o444)
    with pytest.raises(DataError, match="write-protected") as refused:
        edit(path, CHANGES)
    assert refused.value.code == "OV322"
    assert (path.read_text(), list(tmp_path.iterdir())) == (TOML, [path])


@pytest.mark.parametrize("text", ["[ring", "ring = 3\n"])
def test_a_file_that_is_not_understood_is_not_changed(text: str) -> None:
    with pytest.raises(UseError, match=r"robot\.toml"):
        edited(text, CHANGES, "robot.toml")


def test_the_printed_settings_of_the_defaults_can_be_changed(omnivert: Omnivert) -> None:
    text = edited(omnivert("config").out, CHANGES, "robot.toml")
    assert "# Radius of the rim, known from one still image" in text
    changed = parsed(tomllib.loads(text), "robot.toml")
    assert changed.model_copy(update={"ring": Config().ring}) == Config()
    assert changed.ring.r_max_px == 201.0
