"""rec info, cut, merge and export on small recordings: what they say, and what they refuse."""

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnivert.cli.given import Given
from omnivert.config import Config
from omnivert.messages import Health, Ticks
from omnivert.odometry import Odometer
from omnivert.offline import calibrated
from omnivert.wire.recording import Recording, RecordingWriter


def test_info_says_what_play_says_and_each_stream(omnivert: Any, straight: Path) -> None:
    ran = omnivert("rec", "info", straight)
    assert (ran.code, ran.err) == (0, "")
    first, *rest = ran.out.splitlines()
    assert first == omnivert("play", straight, "--info").out.strip()
    (ticks,) = [line.split() for line in rest if line.startswith("v1/encoder")]
    assert ticks[:6] == ["v1/encoder/base/ticks", "400", "50.00", "20", "ms", "0"]
    assert any(re.fullmatch(r"file     \d\.\d MB, 8 chunks, all sound", line) for line in rest)


def test_info_as_json_tells_way_and_turn_as_the_odometer_does(omnivert: Any, turning: Path) -> None:
    told = omnivert("rec", "info", turning, "--json").json
    recording = Recording(turning)
    config = recording.config(Config())
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    stamps = []
    for _, message in recording.messages((Ticks,)):
        assert isinstance(message, Ticks)
        odometer.push(message)
        stamps.append(message.stamp_ns)
    samples = odometer.samples(stamps[0], stamps[-1])
    assert samples is not None
    motion = odometer.motion(samples)
    assert told["driven_m"] == pytest.approx(motion.driven_m)
    assert told["turned_rad"] == pytest.approx(motion.turned_rad)
    assert {stream["key"]: stream["count"] for stream in told["streams"]} == dict(recording.counts)
    given = Given.of(recording).json()
    assert {key: told[key] for key in given} == given
    assert (told["start_ns"], told["end_ns"]) == (recording.start_ns, recording.end_ns)
    assert (told["robot"], told["chunks"], told["chunks_damaged"]) == ("demo", recording.chunks, 0)


def test_the_command_to_type_next_takes_any_name(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    """What is printed is pasted into a shell: blanks, quotes and what looks like markup stay of the name."""
    odd = tmp_path / "my [bold] drive's.mcap"
    commands = (
        ("rec", "cut", straight, "--to", 2, "-o", odd),
        ("rec", "export", odd, "-o", tmp_path / "it's [a] folder"),
        ("import", "frames", tmp_path / "it's [a] folder", "-o", tmp_path / "one 'more.mcap"),
    )
    for command in commands:
        ran = omnivert(*command)
        assert ran.code == 0, ran
        name, *following = shlex.split(ran.err.splitlines()[-1].removeprefix("next"), comments=True)
        made = tmp_path / f"{command[1]}.mcap"
        again = omnivert(*(made if word == "OUT.mcap" else word for word in following))
        assert name == "omnivert"
        assert again.code == 0 or "error[OV1" in again.err, again  # it is found; two seconds do not calibrate


def test_info_shows_names_that_a_terminal_would_obey_without_their_power(omnivert: Any, tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", Config()) as writer:
        writer.write("v1/encoder/base/ticks", Ticks(1, 1, 1))
        writer.write("v1/\x1b[2J\x9b2J/x/health", Health(1, "x", "x", 1.0))
    ran = omnivert("rec", "info", tmp_path / "a.mcap")
    assert "v1/ [2J 2J/x/health" in ran.out
    assert ran.out.replace("\n", "").isprintable()


def test_info_finds_gaps_damage_and_what_the_recorder_had_lost(omnivert: Any, tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", Config()) as writer:
        for i in range(400):
            if not 150 <= i < 153:
                writer.write("v1/encoder/base/ticks", Ticks(i * 10_000_000, i, i))
        lost = {"v1/encoder/base/ticks": 2}
        writer.write("v1/recorder/r/health", Health(1, "recorder", "r", 1.0, dropped=lost, gaps=lost))
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[data.index(b"zstd") + 40] ^= 1
    (tmp_path / "a.mcap").write_bytes(data)
    ran = omnivert("rec", "info", tmp_path / "a.mcap")
    assert "1 damaged; a part of it is damaged, 100 messages are lost; its recorder lost 4 messages" in ran.out
    told = omnivert("rec", "info", tmp_path / "a.mcap", "--json").json
    (ticks, _) = told["streams"]
    assert (ticks["count"], ticks["missing"], told["chunks_damaged"], told["recorder_lost"]) == (297, 3, 1, 4)
    assert ticks["longest_gap_s"] == pytest.approx(0.04)


def test_a_recording_that_was_exported_and_imported_is_calibrated_to_the_same_bytes(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    assert omnivert("rec", "export", straight, "-o", tmp_path / "plain").code == 0
    again = omnivert("import", "frames", tmp_path / "plain", "-o", tmp_path / "again.mcap", "--json").json
    assert again["messages"] == {"Frame": 24, "Ticks": 400, "Scan": 24}
    last = []
    for path in (straight, tmp_path / "again.mcap"):
        recording = Recording(path)
        (*_, estimate) = calibrated(recording, recording.config(Config()))
        last.append(estimate)
    assert type(last[0]) is type(last[1])
    assert (last[0].stamp_ns, repr(last[0])) == (last[1].stamp_ns, repr(last[1]))


def attached(path: Path) -> dict[str, bytes]:
    recording = Recording(path)
    return {name: recording.attachment(name) for name in recording.attachments}


def test_cut_and_merge_go_there_and_back(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    a, b, whole = (tmp_path / f"{name}.mcap" for name in ("a", "b", "whole"))
    first = omnivert("rec", "cut", straight, "--to", "3.3", "-o", a)
    assert (first.code, first.out.startswith(f"{a}  ")) == (0, True)
    second = omnivert("rec", "cut", straight, "--from", "3.3", "-o", b, "--json").json
    assert second["bytes"] == b.stat().st_size
    merged = omnivert("rec", "merge", b, a, "-o", whole, "--json").json
    assert merged["messages"] == dict(Recording(straight).counts)
    assert list(Recording(whole).entries()) == list(Recording(straight).entries())
    assert attached(whole) == attached(straight)
    again = omnivert("rec", "merge", straight, a, "-o", tmp_path / "c.mcap")
    assert (again.code, "error[OV312]" in again.err, "overlap" in again.err) == (1, True, True)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("cut", "REC", "-o", "REC"), 2, "OV208"),
        (("cut", "REC", "-o", "OUT", "--from", "nan"), 2, "OV205"),
        (("cut", "REC", "-o", "OUT", "--from", "100"), 1, "OV305"),
        (("cut", "nowhere.mcap", "-o", "OUT"), 2, "OV321"),
        (("merge", "REC", "-o", "OUT"), 2, "OV205"),
        (("merge", "REC", "corridor", "-o", "REC"), 2, "OV208"),
        (("export", "REC", "-o", "REC"), 2, "OV208"),
        (("export", "REC", "-o", "FULL"), 2, "OV208"),
        (("export", "REC", "-o", "none/none"), 2, "OV322"),
        (("info", "nowhere.mcap"), 2, "OV321"),
    ],
)
def test_what_makes_no_sense_is_refused_and_leaves_nothing(
    omnivert: Any, straight: Path, tmp_path: Path, arguments: tuple[str, ...], code: int, says: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_bytes(b"")
    places = {"REC": straight, "OUT": tmp_path / "out.mcap", "FULL": tmp_path / "full"}
    before = straight.read_bytes()
    ran = omnivert("rec", *(places.get(word, word) for word in arguments))
    assert (ran.code, ran.out) == (code, "")
    assert f"error[{says}]" in ran.err
    assert [path.name for path in tmp_path.iterdir()] == ["full"]
    assert straight.read_bytes() == before


@pytest.mark.parametrize("command", ["cut", "merge", "export"])
def test_what_a_damaged_recording_has_lost_is_said(omnivert: Any, straight: Path, tmp_path: Path, command: str) -> None:
    broken, out = tmp_path / "broken.mcap", tmp_path / "out"
    data = bytearray(straight.read_bytes())
    data[len(data) // 2] ^= 0xFF
    broken.write_bytes(data)
    given = [broken]
    if command == "merge":
        given.append(tmp_path / "later.mcap")
        shifted(straight, given[-1])
    lost = Recording(broken).lost
    assert lost > 0
    notes = omnivert("rec", command, *given, "-o", out, "--json").json["notes"]
    assert notes[0] == f"{broken} is not whole: a part of it is damaged, {lost} messages are lost"
    assert not any("later.mcap" in note for note in notes)


def shifted(recording: Path, out: Path) -> None:
    """The same drive an hour later."""
    whole = Recording(recording)
    with RecordingWriter(out, whole.config(Config())) as writer:
        for key, message in whole.messages():
            writer.write(key, replace(message, stamp_ns=message.stamp_ns + 3600 * 10**9))


def test_an_empty_folder_is_as_good_as_none(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    told = omnivert("rec", "export", straight, "-o", tmp_path / "plain", "--json").json
    assert told == {
        "folder": str(tmp_path / "plain"),
        "kind": "frames",
        "messages": {"Frame": 24, "Ticks": 400, "Scan": 24},
        "notes": [],
    }
    assert np.genfromtxt(tmp_path / "plain" / "encoders.csv", delimiter=",", names=True).size == 400
