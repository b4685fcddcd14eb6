"""calibrate, track and play --info on small recordings: results on stdout, story on stderr, honest exit codes."""

import csv
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.cli.given import missing
from omnivert.cli.offline import results
from omnivert.cli.offline.calibrate import Outcome, refusal
from omnivert.cli.outputs import check_outputs
from omnivert.errors import DataError
from omnivert.messages import Estimate, Mount, ParameterVerdict, State
from omnivert.wire.recording import Recording


def test_a_straight_drive_is_refused_with_what_is_missing(omnivert: Any, straight: Path) -> None:
    ran = omnivert("calibrate", straight)
    assert ran.code == 1
    assert ran.out == ""
    given, drive, error, *rest = ran.err.splitlines()
    assert given.startswith("given   straight.mcap  8.0 s")
    assert given.endswith("24 frames (3.0 Hz, longest gap 333 ms) · 400 ticks · 0 missing")
    assert drive.startswith("drive   ")
    assert error.startswith("error[OV104]: phi and psi can not be told apart")
    assert any(line.startswith("  because  ") for line in rest)
    assert any(line.startswith("  help     ") for line in rest)
    assert any("omnivert explain OV104" in line for line in rest)


def test_a_refusal_has_one_number_for_the_way_that_was_driven(omnivert: Any, straight: Path) -> None:
    told = omnivert("calibrate", straight).err
    (driven,) = re.findall(r"drive   (\S+) m driven", told)
    assert f"because  you drove straight for {driven} m" in told


def test_a_refusal_has_one_number_for_the_turn_that_was_made(omnivert: Any, turning: Path) -> None:
    told = omnivert("calibrate", turning).err
    (turned,) = re.findall(r"m driven, (\S+) deg turned", told)
    assert f"because  you only turned on the spot, by {turned} deg" in told


@pytest.mark.parametrize("left_out", [(), (3,), (3, 4, 9), (1, 4, 5, 6)])
def test_what_is_lost_is_counted_by_the_rhythm_of_the_rest(left_out: tuple[int, ...]) -> None:
    jitter = (0, 9, -12, 4, 15, -3, 0, 8, -14, 2, 7, 0)
    stamps = [10_000_000_000 + 100 * k + jitter[k % 12] for k in range(36) if k not in left_out]
    assert missing(stamps) == len(left_out)
    assert (missing([]), missing([5]), missing([5, 5, 5]), missing([5, 9])) == (0, 0, 0, 0)


def test_a_refusal_with_json_is_one_object_with_all_that_is_known(omnivert: Any, straight: Path) -> None:
    ran = omnivert("calibrate", straight, "--json")
    assert ran.code == 1
    assert ran.json["error"]["code"] == "OV104"
    assert ran.json["verdict"] == "not_yet"
    assert ran.json["given"]["frames"] == 24
    assert ran.json["next_manoeuvre"]


def test_a_recording_that_has_lost_a_part_is_told_with_what_was_lost(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    data = bytearray(straight.read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(data)
    whole, ran = Recording(straight), omnivert("calibrate", tmp_path / "damaged.mcap", "--json")
    given = ran.json["given"]
    assert given["cut"] == "a part of it is damaged"
    assert given["frames"] + given["ticks"] < sum(whole.counts.values())
    assert 0 < given["lost"] < 100
    (note,) = [line for line in ran.err.splitlines() if line.startswith("note ")]
    assert f"not whole: a part of it is damaged, {given['lost']} messages are lost" in note


def test_a_recording_without_ticks_is_refused(omnivert: Any, without_ticks: Path) -> None:
    ran = omnivert("calibrate", without_ticks)
    assert ran.code == 1
    assert "error[OV102]" in ran.err


def test_tracks_and_centres_are_written_as_tables(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    lines, centers, drawn = tmp_path / "lines.csv", tmp_path / "centers.csv", tmp_path / "drawn"
    ran = omnivert("track", straight, "--csv", lines, "--centers", centers, "--draw", drawn, "--json")
    assert ran.code == 0
    assert ran.json["frames"] == 24
    with lines.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:4] == ["index", "t_s", "track_id", "bearing_rad"]
    assert len(rows) == ran.json["sightings"]
    assert {int(row["index"]) for row in rows} == set(range(24))
    assert float(rows[-1]["t_s"]) == pytest.approx(23 / 3, abs=1e-5)
    assert all(-np.pi <= float(row["bearing_rad"]) <= np.pi for row in rows)
    with centers.open() as file:
        found = list(csv.DictReader(file))
    assert [row["index"] for row in found] == [str(index) for index in range(ran.json["ring_found"])]
    assert abs(float(found[0]["cu_px"]) - 321.5) < 5.0
    picture = cv2.imread(str(drawn / "000023.png"))
    assert picture is not None
    assert picture.shape[1] == 2 * 640
    assert 2 * 480 < picture.shape[0] < 2 * 480 + 50  # a band that says which frame


def test_a_recording_with_truth_is_scored(omnivert: Any, scored: Path) -> None:
    ran = omnivert("track", scored, "--json")
    score = ran.json["score"]
    assert score["frames"] == 24
    assert score["recall"] > 0.8
    assert score["precision"] > score["precision_chance"]
    assert score["correct_percent"] + score["false_percent"] + score["false_new_percent"] == pytest.approx(100.0)
    rows = omnivert("track", scored).out.splitlines()
    assert max(map(len, rows)) <= 100
    found, kept, lines = rows[1:]
    assert re.match(r"lines   \d+\.\d true ones a frame · bearings to \d\.\d\d mrad", lines)
    assert found.startswith(f"found   {100 * score['recall']:.1f} % of the strong lines")
    assert kept.startswith(f"kept    {score['correct_percent']:.2f} % of links right")


def test_without_truth_there_is_no_score(omnivert: Any, straight: Path) -> None:
    assert omnivert("track", straight, "--json").json["score"] is None


def test_a_damaged_truth_is_said_and_the_lines_come_all_the_same(omnivert: Any, damaged_truth: Path) -> None:
    ran = omnivert("track", damaged_truth, "--json")
    assert (ran.code, ran.json["score"], ran.json["frames"]) == (0, None, 3)
    assert ran.err.startswith("not scored: truth/lines.csv in ")


def test_tracking_in_paper_mode_finds_fewer_lines(omnivert: Any, straight: Path) -> None:
    ours, paper = omnivert("track", straight, "--json"), omnivert("track", straight, "--mode", "paper", "--json")
    assert paper.json["lines_per_frame"] < ours.json["lines_per_frame"]


def test_a_table_that_cannot_be_written_is_said(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    ran = omnivert("track", straight, "--csv", tmp_path / "nowhere" / "lines.csv")
    assert ran.code == 2
    assert "error[OV322]" in ran.err


@pytest.mark.parametrize("option", ["--csv", "--centers", "--draw"])
def test_a_place_below_a_file_is_refused_before_the_work(
    omnivert: Any, straight: Path, tmp_path: Path, option: str
) -> None:
    (tmp_path / "file").write_bytes(b"")
    ran = omnivert("track", straight, option, tmp_path / "file" / "below")
    assert (ran.code, ran.out) == (2, "")
    assert "error[OV322]" in ran.err


@pytest.mark.parametrize("place", ["", "none/picture.png"])
def test_a_picture_that_cannot_be_written_is_refused_before_the_work(
    omnivert: Any, straight: Path, tmp_path: Path, place: str
) -> None:
    ran = omnivert("calibrate", straight, "--picture", tmp_path / place, "--json")
    assert (ran.code, ran.json["error"]["code"]) == (2, "OV322")


@pytest.mark.parametrize("command", [("track", "--csv"), ("track", "--centers"), ("calibrate", "--picture")])
def test_no_result_overwrites_its_recording(
    omnivert: Any, straight: Path, tmp_path: Path, command: tuple[str, str]
) -> None:
    drive = tmp_path / "drive.mcap"
    drive.write_bytes(straight.read_bytes())
    ran = omnivert(command[0], drive, command[1], tmp_path / "." / "drive.mcap")
    assert ran.code == 2
    assert "error[OV208]" in ran.err
    assert drive.read_bytes() == straight.read_bytes()


def test_no_result_overwrites_the_configuration_it_is_made_with(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("")
    (tmp_path / "link.png").hardlink_to(tmp_path / "robot.toml")
    for command in (("track", "--csv", "robot.toml"), ("track", "--centers", "robot.toml")):
        ran = omnivert(command[0], straight, "-c", tmp_path / "robot.toml", command[1], tmp_path / command[2])
        assert (ran.code, "is the configuration itself" in ran.err) == (2, True)
    ran = omnivert("calibrate", straight, "-c", tmp_path / "robot.toml", "--picture", tmp_path / "link.png")
    assert (ran.code, "is the configuration itself" in ran.err) == (2, True)
    assert (tmp_path / "robot.toml").read_text() == ""


@pytest.mark.parametrize("options", [("--csv", "--centers"), ("--csv", "--draw"), ("--centers", "--draw")])
def test_no_result_overwrites_another(omnivert: Any, straight: Path, tmp_path: Path, options: tuple[str, str]) -> None:
    ran = omnivert("track", straight, options[0], tmp_path / "x.csv", options[1], tmp_path / "." / "x.csv")
    assert (ran.code, "error[OV208]" in ran.err) == (2, True)
    assert f"{options[0]} and {options[1]} would overwrite each other" in ran.err
    assert list(tmp_path.iterdir()) == []


def test_results_may_all_go_nowhere(omnivert: Any, straight: Path) -> None:
    assert omnivert("track", straight, "--csv", "/dev/null", "--centers", "/dev/null").code == 0


def test_frames_are_not_drawn_into_a_file(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"mine")
    ran = omnivert("track", straight, "--draw", tmp_path / "file")
    assert (ran.code, "error[OV322]" in ran.err, (tmp_path / "file").read_bytes()) == (2, True, b"mine")


def test_a_picture_of_a_format_that_is_not_drawn_is_refused(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    ran = omnivert("calibrate", straight, "--picture", tmp_path / "x.txt")
    assert (ran.code, f"--picture {tmp_path}/x.png" in ran.err) == (2, True)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_the_system_protects_is_no_wrong_use(
    omnivert: Any, straight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def protected(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", protected)
    with pytest.raises(DataError, match="Permission denied"):
        check_outputs({}, {"--csv": tmp_path / "lines.csv"})


@pytest.mark.parametrize(("place", "said"), [("", "is a folder"), ("/dev/null", "is no file")])
def test_what_is_no_recording_file_is_called_what_it_is(omnivert: Any, tmp_path: Path, place: str, said: str) -> None:
    ran = omnivert("calibrate", tmp_path / place)
    assert (ran.code, said in ran.err, "no such file" in ran.err) == (2, True, False)


def test_checking_for_a_place_leaves_nothing(omnivert: Any, without_ticks: Path, tmp_path: Path) -> None:
    assert omnivert("calibrate", without_ticks, "--picture", tmp_path / "result.png").code == 1
    assert list(tmp_path.iterdir()) == []


def test_info_says_what_a_recording_holds(omnivert: Any, straight: Path) -> None:
    assert "24 frames (3.0 Hz" in omnivert("play", straight, "--info").out
    assert omnivert("play", straight, "--info", "--json").json["frames"] == 24


def test_an_import_of_no_folder_is_refused_and_leaves_nothing(omnivert: Any, tmp_path: Path) -> None:
    ran = omnivert("import", "frames", tmp_path / "none", "-o", tmp_path / "out.mcap")
    assert ran.code == 1
    assert "error[OV310]" in ran.err
    assert list(tmp_path.iterdir()) == []


MOUNT = Mount(3.1, 0.2, -0.3, np.diag([0.01**2, 0.002**2, 0.02**2]))


def test_errors_go_the_short_way_round_and_are_counted_in_sigmas() -> None:
    truth = (-3.1, 0.196, -0.28)
    assert results.errors(MOUNT, truth) == pytest.approx((-0.0831853, 0.004, -0.02), abs=1e-6)
    assert results.in_sigmas(MOUNT, truth) == pytest.approx((8.31853, 2.0, 1.0), abs=1e-4)


@pytest.mark.parametrize(
    ("state", "driven", "turned", "code"),
    [
        (State.INVALID, 5.0, 3.0, "OV106"),
        (State.MOVED, 5.0, 3.0, "OV107"),
        (State.WAITING, 0.0, 0.0, "OV108"),
        (State.NOT_YET, 6.1, 0.07, "OV104"),
        (State.NOT_YET, 0.1, 6.0, "OV105"),
        (State.NOT_YET, 5.0, 3.0, "OV109"),
    ],
)
def test_a_refusal_names_the_cause(state: State, driven: float, turned: float, code: str) -> None:
    part = ParameterVerdict(state)
    last = Estimate(1, 9, MOUNT, state, part, part, part, "turn about 90 deg", driven, turned, 5, 0, 0)
    error = refusal(Outcome(estimates=[last]))
    assert error.code == code
    assert error.help == "turn about 90 deg, then run this again"
