"""Every command helps; wrong use is refused in one form, with the nearest right word, and exit code 2."""

import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from omnivert.cli.app import app
from omnivert.cli.explain import explanations
from omnivert.cli.robot.show_config import annotated
from omnivert.config import Config, parsed
from omnivert.errors import UseError

OMNIVERT = (sys.executable, "-c", "from omnivert.cli import main; main()")


def commands(group: Any, names: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """Every command by its names, and its whole help."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*names, name))
        else:
            yield (*names, name), inspect.cleandoc(command.help)


COMMANDS = dict(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_helps(omnivert: Any, command: tuple[str, ...]) -> None:
    ran = omnivert(*command, "--help")
    assert ran.code == 0
    assert "Usage: omnivert " + " ".join(command) in ran.out


@pytest.mark.parametrize("command", COMMANDS)
def test_no_line_of_help_is_broken_twice(command: tuple[str, ...]) -> None:
    """Past the first paragraph a line's end in the text is one on the screen, too, after those that the width makes."""
    assert not [part for part in COMMANDS[command].split("\n\n")[1:] if "\n" in part]


def test_without_a_command_it_shows_where_to_begin(omnivert: Any) -> None:
    ran = omnivert()
    assert ran.code == 0
    assert "omnivert demo" in ran.out


def test_it_tells_its_version(omnivert: Any) -> None:
    assert omnivert("--version").out.startswith("omnivert 0.")


@pytest.mark.parametrize(
    ("arguments", "near"),
    [
        (("calibrte", "corridor"), "calibrate"),
        (("calibrate", "corridor", "--pictur", "x"), "--picture"),
        (("extrinsics", "lst"), "list"),
        (("calibrate", "coridor"), "corridor"),
        (("calibrate", "corridor", "--mode", "papr"), "paper"),
        (("explain", "OV1044"), "OV104"),
    ],
)
def test_a_typo_is_refused_with_the_nearest_right_word(omnivert: Any, arguments: tuple[str, ...], near: str) -> None:
    ran = omnivert(*arguments)
    assert ran.code == 2
    assert ran.out == ""
    assert ran.err.startswith("error[OV2") or ran.err.startswith("error[OV321")
    assert near in ran.err.split("help")[1]


def test_wrong_use_with_json_is_one_object_too(omnivert: Any) -> None:
    ran = omnivert("calibrate", "nowhere.mcap", "--json")
    assert ran.code == 2
    assert ran.json["error"]["code"] == "OV321"


@pytest.mark.parametrize("arguments", [("up",), ("record",), ("import", "frames", ".")])
def test_a_missing_argument_is_wrong_use(omnivert: Any, arguments: tuple[str, ...]) -> None:
    assert omnivert(*arguments).code == 2


def test_a_bad_configuration_is_refused_with_its_key(omnivert: Any, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[robot]\nwheel_bass_m = 0.4\n")
    ran = omnivert("calibrate", "corridor", "--config", tmp_path / "robot.toml")
    assert ran.code == 2
    assert "robot.wheel_bass_m" in ran.err
    assert "did you mean wheel_base_m?" in ran.err


def test_a_recording_is_never_overwritten(omnivert: Any, tmp_path: Path) -> None:
    (tmp_path / "drive.mcap").write_bytes(b"the only drive")
    ran = omnivert("record", tmp_path / "drive.mcap")
    assert (ran.code, (tmp_path / "drive.mcap").read_bytes()) == (2, b"the only drive")


@pytest.mark.parametrize("command", [("record",), ("up", "--play", "corridor", "--record")])
def test_a_recording_finds_its_place_before_anything_starts(
    omnivert: Any, tmp_path: Path, command: tuple[str, ...]
) -> None:
    ran = omnivert(*command, tmp_path)
    assert (ran.code, "is a folder" in ran.err) == (2, True)
    ran = omnivert(*command, tmp_path / "none" / "drive.mcap")
    assert (ran.code, "there is no folder" in ran.err) == (2, True)


def test_up_does_not_record_over_its_own_store(omnivert: Any, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(f'[storage]\npath = "{tmp_path}/x.db"')
    ran = omnivert("up", "-c", tmp_path / "robot.toml", "--record", tmp_path / "x.db")
    assert (ran.code, "--record and storage.path" in ran.err) == (2, True)


def test_a_demo_into_a_file_is_wrong_use(omnivert: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"mine")
    ran = omnivert("demo", "-o", tmp_path / "file")
    assert (ran.code, (tmp_path / "file").read_bytes()) == (2, b"mine")


@pytest.mark.parametrize("command", [("explain",), ("--help",), ("config",), ("config", "--json")], ids=" ".join)
def test_who_stops_reading_ends_it_quietly(command: tuple[str, ...]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as pipe:
        done = subprocess.run([*OMNIVERT, *command], stdout=pipe, stderr=subprocess.PIPE, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_trouble(straight: Path, closed: str) -> None:
    command = f'exec "$@" {closed}'
    words = ["sh", "-c", command, "sh", *OMNIVERT, "track", str(straight)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)


def test_an_import_overwrites_no_recording_either(omnivert: Any, tmp_path: Path) -> None:
    (tmp_path / "drive.mcap").write_bytes(b"the only drive")
    ran = omnivert("import", "frames", tmp_path, "-o", tmp_path / "drive.mcap")
    assert (ran.code, (tmp_path / "drive.mcap").read_bytes()) == (2, b"the only drive")


@pytest.mark.parametrize(
    "arguments",
    [
        ("calibrate", "x" * 300),
        ("import", "frames", "x" * 300, "-o", "y"),
        ("extrinsics", "list", "--store", "x" * 300),
    ],
)
def test_what_the_system_refuses_is_a_refusal(omnivert: Any, arguments: tuple[str, ...]) -> None:
    ran = omnivert(*arguments)
    assert ran.code == 1
    assert ran.err.startswith("error[OV")
    assert "too long" in ran.err


def test_a_result_that_finds_no_room_is_a_refusal() -> None:
    with Path("/dev/full").open("wb") as full:
        command = [*OMNIVERT, "config"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "error[OV210]" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_speed_without_end_is_wrong_use(omnivert: Any) -> None:
    ran = omnivert("play", "corridor", "--speed", "inf")
    assert (ran.code, "--speed 0" in ran.err) == (2, True)


@pytest.mark.parametrize(
    "arguments",
    [
        ("play", "corridor", "--speed", "nan"),
        ("play", "corridor", "--from", "nan"),
        ("play", "corridor", "--to", "inf"),
        ("demo", "--speed", "inf"),
    ],
)
def test_a_number_that_is_none_is_wrong_use(omnivert: Any, arguments: tuple[str, ...]) -> None:
    assert omnivert(*arguments).code == 2


@pytest.mark.parametrize("end_point", ["nonsense", "tcp/", "/x", ""])
def test_an_end_point_of_no_form_is_wrong_use(omnivert: Any, end_point: str) -> None:
    ran = omnivert("monitor", "--once", "--connect", end_point)
    assert ran.code == 2
    assert "PROTOCOL/ADDRESS" in ran.err


def test_no_router_is_said_in_one_line(omnivert: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("omnivert.cli.robot.monitor.PATIENCE_S", 0.1)
    ran = omnivert("monitor", "--once", "--connect", f"unixsock-stream/{tmp_path}/none.sock")
    assert ran.code == 1
    assert "error[OV401]" in ran.err


def test_the_printed_configuration_is_the_configuration() -> None:
    given = {"robot": {"id": "r2", "wheel_base_m": 0.31}, "bus": {"listen": ["tcp/192.168.1.5:7447"]}}
    config = parsed(given, "test")
    text = annotated(config)
    assert parsed(tomllib.loads(text), "printed") == config
    assert 'id = "r2"  # default: "demo"' in text
    assert parsed(tomllib.loads(annotated(Config())), "printed") == Config()


def test_the_printed_configuration_fits_a_terminal_and_tells_what_may_be_set() -> None:
    """What it calls the most is: a larger number is refused."""
    lines = annotated(Config()).splitlines()
    assert max(map(len, lines)) <= 100
    assert 'protocol = "omnivert"  # "omnivert", "ros_arduino_bridge", "roboclaw", "create2"' in lines
    assert "wheel_diameter_m = 0.15  # 0.01 to 2" in lines
    table, told = "", 0
    for line in lines:
        if line.startswith("["):
            table = line.strip("[]")
        if found := re.fullmatch(r"(?:# )?(\w+) = (\S+)  # (above )?(\S+) to (\S+)", line):
            name, value, above, low, high = found.groups()
            kind = type(json.loads(value))
            for wrong in (kind(float(high) * 1.1 + 1), kind(float(low) - 1), *((kind(float(low)),) if above else ())):
                with pytest.raises(UseError):
                    parsed({table: {name: wrong}}, "a test")
            told += 1
    assert told > 60


@pytest.mark.parametrize("first", ["default", "paper"])
@pytest.mark.parametrize("then", ["default", "paper"])
def test_settings_that_follow_the_mode_follow_it_in_a_printed_file_too(first: str, then: str) -> None:
    printed = annotated(parsed({"vision": {"mode": first}}, "test"))
    changed = printed.replace(f'mode = "{first}"', f'mode = "{then}"')
    assert parsed(tomllib.loads(changed), "copy").vision == parsed({"vision": {"mode": then}}, "test").vision


def test_a_setting_that_differs_from_its_mode_is_printed_and_kept() -> None:
    given = {"vision": {"mode": "paper", "min_length": 0.28}}
    printed = annotated(parsed(given, "test"))
    assert "min_length = 0.28  # default: 0.5" in printed
    assert parsed(tomllib.loads(printed), "copy") == parsed(given, "test")


def test_the_configuration_as_json(omnivert: Any) -> None:
    assert omnivert("config", "--json").json["robot"]["id"] == "demo"


def test_a_terminal_without_utf8_gets_plain_letters(store: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C"}
    command = [
        sys.executable,
        "-c",
        "from omnivert.cli import main; main()",
        "extrinsics",
        "show",
        "--store",
        str(store),
    ]
    ran = subprocess.run(command, env=environment, capture_output=True, timeout=60, check=False)
    assert ran.returncode == 0, ran.stderr
    assert b"+-" in ran.stdout
    ran.stdout.decode("ascii")


def test_a_pipe_gets_no_colours() -> None:
    command = [*OMNIVERT, "calibrate", "nowhere.mcap", "--json"]
    ran = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert ran.returncode == 2
    assert b"\x1b" not in ran.stdout + ran.stderr
    assert json.loads(ran.stdout)["error"]["code"] == "OV321"


def test_no_code_of_a_refusal_means_two_things() -> None:
    """A second entry of a code would silently take the place of the first."""
    folder = Path(explanations.__file__).parent
    texts = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    codes = re.findall(r'^    "(OV\d+)": Explanation\(', texts, flags=re.MULTILINE)
    assert sorted(codes) == sorted(explanations.EXPLANATIONS)
