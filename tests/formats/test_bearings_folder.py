"""The folder of bearings and wheel displacements: all of it comes through, or nothing does and one line says why."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.calibration.calibrator import Calibrator
from omnivert.config import Config, with_rig
from omnivert.errors import DataError
from omnivert.formats.bearings_folder import BearingsFolder
from omnivert.formats.bearings_import import import_bearings
from omnivert.formats.meta import METRE_WHEEL
from omnivert.messages import Bearings, Estimate, Message, Mount, State, Ticks
from omnivert.offline import calibrated
from omnivert.simulation.recording import Drive, Scene, recorded
from omnivert.wire.recording import Recording

META: dict[str, Any] = {"robot": {"wheel_base_m": 0.3}, "bearing_std_rad": 0.006, "remark": "unknown keys are ignored"}
BEARINGS = """t_s,track_id,bearing_rad
0.1,7,0.25
0.1,3,-0.5
0.35,7,6.0
0.6,9,-6.2832
0.6,7,0.5
"""
WHEELS = "t_s,left_m,right_m\n0,0,0\n0.25,0.0123456,-0.0000004\n0.5,0.02,0.01\n0.75,0.03,0.02\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three looks with two, one and two bearings, four rows of wheels, and truth."""
    there = tmp_path / "drive"
    (there / "truth").mkdir(parents=True)
    (there / "meta.json").write_text(json.dumps(META))
    (there / "bearings.csv").write_text(BEARINGS)
    (there / "wheels.csv").write_text(WHEELS)
    (there / "truth" / "extrinsics.json").write_text('{"phi_rad": 1, "camera_yaw_rad": 2}')
    return there


def imported(folder: Path) -> Recording:
    import_bearings(folder, folder.parent / "out.mcap")
    return Recording(folder.parent / "out.mcap")


def messages(recording: Recording) -> list[Message]:
    return [message for _, message in recording.messages()]


def looks(folder: Path) -> list[Bearings]:
    return [message for message in messages(imported(folder)) if isinstance(message, Bearings)]


def test_rows_of_one_time_are_one_look(folder: Path) -> None:
    first, second, third = looks(folder)
    assert [look.stamp_ns for look in (first, second, third)] == [100_000_000, 350_000_000, 600_000_000]
    assert [look.track_id.tolist() for look in (first, second, third)] == [[7, 3], [7], [9, 7]]
    assert first.bearing_rad.tolist() == [0.25, -0.5]
    assert [look.age_frames.tolist() for look in (first, second, third)] == [[0, 0], [1], [0, 2]]
    assert (first.ring, first.reasons, first.strength.tolist()) == (None, (), [1.0, 1.0])
    assert third.std_rad.tolist() == [0.006, 0.006]


def test_bearings_of_a_whole_turn_are_brought_to_half_a_turn_either_way(folder: Path) -> None:
    _, second, third = looks(folder)
    assert second.bearing_rad[0] == pytest.approx(6.0 - 2.0 * math.pi, abs=1e-12)
    assert third.bearing_rad[0] == pytest.approx(2.0 * math.pi - 6.2832, abs=1e-12)


def test_wheels_come_through_to_a_tenth_of_a_micrometre(folder: Path) -> None:
    recording = imported(folder)
    encoder = recording.config(Config()).encoder
    assert (encoder.left_sign, encoder.right_sign) == (1, 1)
    ticks = [message for message in messages(recording) if isinstance(message, Ticks)]
    left = [encoder.metres_per_tick * t.left for t in ticks]
    right = [encoder.metres_per_tick * t.right for t in ticks]
    assert left == pytest.approx([0.0, 0.0123456, 0.02, 0.03], abs=0.5e-7)
    assert right == pytest.approx([0.0, -0.0000004, 0.01, 0.02], abs=0.5e-7)


@given(way=st.floats(-1e5, 1e5))
def test_no_way_is_rounded_by_a_tenth_of_a_micrometre(tmp_path_factory: pytest.TempPathFactory, way: float) -> None:
    there = tmp_path_factory.getbasetemp() / "way"
    there.mkdir(exist_ok=True)
    (there / "meta.json").write_text(json.dumps(META))
    (there / "bearings.csv").write_text(BEARINGS)
    (there / "wheels.csv").write_text(f"t_s,left_m,right_m\n0.1,{way!r},0\n")
    read = BearingsFolder(there, Config())
    (ticks,) = [message for message in read.messages() if isinstance(message, Ticks)]
    assert abs(ticks.left * read.config.encoder.metres_per_tick - way) < 1e-7


def test_the_sigma_of_a_row_wins(folder: Path) -> None:
    (folder / "bearings.csv").write_text("std_rad,t_s,track_id,bearing_rad\n0.02,0.1,7,0\n0.03,0.1,8,0\n")
    (look,) = looks(folder)
    assert look.std_rad.tolist() == [0.02, 0.03]
    (folder / "meta.json").write_text('{"robot": {"wheel_base_m": 0.3}}')  # not needed then
    assert BearingsFolder(folder, Config()).counts == {"Bearings": 1, "Ticks": 4}


def test_everything_is_in_order_and_at_equal_times_ticks_go_first(folder: Path) -> None:
    replaced("bearings.csv", "0.35,", "0.5,")(folder)
    all_of_them = messages(imported(folder))
    assert [message.stamp_ns for message in all_of_them] == sorted(message.stamp_ns for message in all_of_them)
    assert [type(message) for message in all_of_them if message.stamp_ns == 500_000_000] == [Ticks, Bearings]


def test_of_wheels_at_one_time_the_last_row_counts(folder: Path) -> None:
    (folder / "wheels.csv").write_text("t_s,left_m,right_m\n0,0,0\n0.5,0.1,0.1\n0.5,0.2,0.2\n")
    ticks = [message for message in messages(imported(folder)) if isinstance(message, Ticks)]
    assert [(t.stamp_ns, t.left) for t in ticks] == [(0, 0), (500_000_000, 2_000_000)]


def test_the_wheel_base_comes_from_meta_and_all_that_it_leaves_open_from_the_configuration(folder: Path) -> None:
    base = with_rig(
        Config(),
        {
            "robot": {"id": "r7", "wheel_base_m": 1.0},
            "encoder": {"noise_k_m": 1e-3, "left_sign": -1},
            "camera": {"id": "radar", "width_px": 320, "height_px": 480, "bearing_sign": -1},
        },
        "test",
    )
    import_bearings(folder, folder.parent / "out.mcap", base)
    config = Recording(folder.parent / "out.mcap").config(Config())
    assert (config.robot.id, config.robot.wheel_base_m, config.encoder.noise_k_m) == ("r7", 0.3, 1e-3)
    assert (config.camera.id, config.camera.width_px, config.camera.frame_rate_hz) == ("radar", 320, 4.0)
    assert (config.camera.bearing_sign, config.encoder.left_sign) == (1, 1)  # the folder has its signs already


def test_truth_and_meta_are_attached_as_they_are(folder: Path) -> None:
    recording = imported(folder)
    assert recording.attachments == ("meta.json", "truth/extrinsics.json")
    assert recording.attachment("truth/extrinsics.json") == b'{"phi_rad": 1, "camera_yaw_rad": 2}'


def test_times_may_begin_before_zero(folder: Path) -> None:
    replaced("wheels.csv", "\n0,0,0", "\n-0.5,0,0")(folder)
    read = BearingsFolder(folder, Config())
    assert read.shift_ns == 500_000_000
    assert next(look.stamp_ns for look in read.messages() if isinstance(look, Bearings)) == 600_000_000


def test_importing_twice_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    import_bearings(folder, tmp_path / "one.mcap")
    import_bearings(folder, tmp_path / "two.mcap")
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_wheels_that_a_calibration_will_not_believe_are_told(folder: Path) -> None:
    assert BearingsFolder(folder, Config()).notes == ()
    (folder / "wheels.csv").write_text("t_s,left_m,right_m\n0,0,0\n0.75,0.1,0.1\n1.5,0.2,0.2\n2,0.3,0.3\n")
    (note,) = BearingsFolder(folder, Config()).notes
    assert "wheels.csv: silent while the wheels turned, 2 times" in note
    assert "up to 0.75 s apart" in note
    assert "encoder.max_gap_s = 0.5" in note
    patient = with_rig(Config(), {"encoder": {"max_gap_s": 0.8}}, "test")
    assert BearingsFolder(folder, patient).notes == ()


# ---------------------------------------------------------------- the same calibration as from the messages themselves

MOUNT = (-0.34, 0.23, 0.33)
RIG = with_rig(Config(), {"encoder": METRE_WHEEL}, "test")


def directly(drive: Sequence[Message], config: Config) -> Estimate:
    calibrator, last = Calibrator(config), None
    for message in drive:
        if isinstance(message, Ticks | Bearings):
            for result in calibrator.step(message):
                last = result if isinstance(result, Estimate) else last
    for result in calibrator.close():
        last = result if isinstance(result, Estimate) else last
    assert last is not None
    return last


def of_recording(recording: Recording) -> Estimate:
    results = calibrated(recording, recording.config(Config()))
    return [result for result in results if isinstance(result, Estimate)][-1]


def test_a_drive_through_a_folder_is_calibrated_as_the_drive_itself(
    tmp_path: Path, write_bearings: Callable[[Path, Drive, Config], None]
) -> None:
    drive = recorded(Scene(mount=MOUNT, lasting=True, visible=6.0, lines=8, outliers=0.0), RIG, 11)
    write_bearings(tmp_path / "drive", drive, RIG)
    there, here = of_recording(imported(tmp_path / "drive")), directly(drive.messages, RIG)
    assert there.mount is not None
    assert here.mount is not None
    assert there.state == here.state
    assert there.frame == here.frame
    for name in ("phi_rad", "rho_m", "psi_rad", "covariance"):
        assert getattr(there.mount, name) == pytest.approx(getattr(here.mount, name), rel=1e-9, abs=1e-12), name
    off = np.array([there.mount.phi_rad - MOUNT[0], there.mount.rho_m - MOUNT[1], there.mount.psi_rad - MOUNT[2]])
    assert (np.abs(off) < 4.0 * np.sqrt(np.diag(there.mount.covariance))).all()


# ---------------------------------------------------------------- refusals

Damage = Callable[[Path], object]


def replaced(name: str, before: str, after: str) -> Damage:
    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        assert before in text
        (folder / name).write_text(text.replace(before, after, 1))

    return damage


def meta(**changes: Any) -> Damage:
    return lambda folder: (folder / "meta.json").write_text(json.dumps({**META, **changes}))


def without(key: str) -> Damage:
    return lambda folder: (folder / "meta.json").write_text(json.dumps({k: v for k, v in META.items() if k != key}))


def removed(name: str) -> Damage:
    return lambda folder: (folder / name).unlink()


def written(name: str, text: str | bytes) -> Damage:
    return lambda folder: (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())


def with_std(text: str) -> Damage:
    return written("bearings.csv", f"t_s,track_id,bearing_rad,std_rad\n0.1,7,0.25,0.01\n0.1,8,0.25,{text}\n")


def linked_out(folder: Path) -> None:
    (folder.parent / "secret.json").write_text("{}")
    (folder / "truth" / "other.json").symlink_to(folder.parent / "secret.json")


ROW = ("bearings.csv, row 4",)  # the one at 0.35 s


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (removed("meta.json"), ("meta.json", "no such file")),
        (removed("bearings.csv"), ("bearings.csv", "no such file")),
        (removed("wheels.csv"), ("wheels.csv", "no such file")),
        (written("meta.json", "{"), ("meta.json", "not JSON")),
        (without("robot"), ("meta.json", "robot.wheel_base_m is missing")),
        (without("bearing_std_rad"), ("meta.json", "bearing_std_rad is missing", "no column 'std_rad'")),
        (meta(robot={"wheel_base_m": 258}), ("meta.json", "wheel_base_m = 258")),
        (meta(bearing_std_rad=0.0), ("meta.json", "bearing_std_rad = 0 ")),
        (meta(bearing_std_rad=-0.006), ("meta.json", "bearing_std_rad = -0.006")),
        (meta(bearing_std_rad=4), ("meta.json", "bearing_std_rad = 4", "radians")),
        (meta(bearing_std_rad=float("nan")), ("meta.json", "bearing_std_rad", "no finite number")),
        (meta(bearing_std_rad="0.006"), ("meta.json", "bearing_std_rad", "no finite number")),
        (written("bearings.csv", ""), ("bearings.csv", "empty")),
        (written("bearings.csv", "t_s,track_id,bearing_rad\n"), ("bearings.csv", "no rows")),
        (written("wheels.csv", "t_s,left_m,right_m\n\n"), ("wheels.csv", "no rows")),
        (written("wheels.csv", b"\xff\xfe\x00"), ("wheels.csv", "UTF-8")),
        (replaced("bearings.csv", "bearing_rad", "bearing"), ("bearings.csv", "no column 'bearing_rad'")),
        (replaced("bearings.csv", "t_s", "time"), ("bearings.csv", "no column 't_s'")),
        (replaced("wheels.csv", "right_m", "right"), ("wheels.csv", "no column 'right_m'")),
        (replaced("wheels.csv", "right_m", "left_m"), ("wheels.csv, row 1", "'left_m' twice")),
        (replaced("bearings.csv", "0.35,", "0.05,"), (*ROW, "runs backwards, by 0.05 s")),
        (replaced("bearings.csv", "0.35,", "nan,"), (*ROW, "'nan' is no time")),
        (replaced("bearings.csv", "0.35,", "soon,"), (*ROW, "'soon' is no number")),
        (replaced("bearings.csv", "0.6,9", "9999,9"), ("bearings.csv, row 5", "jumps by")),
        (replaced("bearings.csv", "7,6.0", "7,nan"), (*ROW, "bearing_rad = 'nan' is no finite number")),
        (replaced("bearings.csv", "7,6.0", "7,-inf"), (*ROW, "bearing_rad", "no finite number")),
        (replaced("bearings.csv", "7,6.0", "7,east"), (*ROW, "'east' is no number")),
        (replaced("bearings.csv", "7,6.0", "7,"), (*ROW, "bearing_rad is empty")),
        (replaced("bearings.csv", "7,6.0", "7,6.4"), (*ROW, "bearing_rad = 6.4", "radians")),
        (replaced("bearings.csv", "7,6.0", "7,-90"), (*ROW, "bearing_rad = -90", "radians")),
        (replaced("bearings.csv", "7,6.0", "7,6.0,1"), (*ROW, "4 fields")),
        (replaced("bearings.csv", "7,6.0", "7.5,6.0"), (*ROW, "track_id = '7.5' is no whole number")),
        (replaced("bearings.csv", "7,6.0", "-7,6.0"), (*ROW, "track_id = -7 is negative")),
        (replaced("bearings.csv", "7,6.0", "door,6.0"), (*ROW, "track_id = 'door' is no number")),
        (replaced("bearings.csv", "7,6.0", "1e300,6.0"), (*ROW, "no whole number")),
        (replaced("bearings.csv", "0.1,3", "0.10,7"), ("bearings.csv, row 3", "track_id 7 comes twice at t_s = 0.10")),
        (with_std("0"), ("bearings.csv, row 3", "std_rad = 0 ")),
        (with_std("-0.01"), ("bearings.csv, row 3", "std_rad = -0.01")),
        (with_std("1e-9"), ("bearings.csv, row 3", "std_rad = 1e-09")),
        (with_std("3.2"), ("bearings.csv, row 3", "std_rad = 3.2")),
        (with_std("nan"), ("bearings.csv, row 3", "std_rad", "no finite number")),
        (with_std(""), ("bearings.csv, row 3", "std_rad is empty")),
        (replaced("wheels.csv", "0.5,0.02", "0.2,0.02"), ("wheels.csv, row 4", "runs backwards, by 0.05 s")),
        (replaced("wheels.csv", "0.5,0.02", "0.5,NaN"), ("wheels.csv, row 4", "left_m = 'NaN' is no finite number")),
        (replaced("wheels.csv", "0.5,0.02", "0.5,inf"), ("wheels.csv, row 4", "left_m")),
        (replaced("wheels.csv", "0.5,0.02", "0.5,1e12"), ("wheels.csv, row 4", "left_m = 1e+12 is no way")),
        (replaced("wheels.csv", "0.75,", "3601,"), ("wheels.csv, row 5", "jumps by 3600.5 s")),
        (
            written("wheels.csv", "t_s,left_m,right_m\n100,0,0\n101,0,0\n"),
            ("wheels.csv, row 2", "99.4 s after the last bearing", "bearings.csv, row 5", "one clock"),
        ),
        (
            written("wheels.csv", "t_s,left_m,right_m\n-9,0,0\n-8,0,0\n"),
            ("wheels.csv, row 3", "8.1 s before the first bearing", "bearings.csv, row 2"),
        ),
        (linked_out, ("truth/other.json", "leaves the folder")),
    ],
)
def test_a_fault_is_one_line_that_names_file_and_row_and_leaves_nothing_behind(
    folder: Path, damage: Damage, says: tuple[str, ...]
) -> None:
    damage(folder)
    before = sorted(folder.parent.iterdir())
    with pytest.raises(DataError) as refusal:
        import_bearings(folder, folder.parent / "out.mcap")
    assert (refusal.value.code, refusal.value.exit_code) == ("OV310", 1)
    line = str(refusal.value)
    assert "\n" not in line
    assert all(word in line for word in says), line
    assert sorted(folder.parent.iterdir()) == before


def test_an_empty_folder_and_no_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"meta\.json"):
        import_bearings(tmp_path / "empty", tmp_path / "out.mcap")
    with pytest.raises(DataError, match="is no folder"):
        import_bearings(tmp_path / "missing", tmp_path / "out.mcap")


def test_a_failed_import_leaves_the_recording_that_was_there(folder: Path, tmp_path: Path) -> None:
    import_bearings(folder, tmp_path / "out.mcap")
    before = (tmp_path / "out.mcap").read_bytes()
    removed("wheels.csv")(folder)
    with pytest.raises(DataError):
        import_bearings(folder, tmp_path / "out.mcap")
    assert (tmp_path / "out.mcap").read_bytes() == before


@given(rows=st.text(alphabet="0123456789.,-+eEnaif\n", max_size=200))
def test_any_rows_give_messages_in_order_or_a_refusal_that_names_the_file(
    tmp_path_factory: pytest.TempPathFactory, rows: str
) -> None:
    there = tmp_path_factory.getbasetemp() / "any"
    there.mkdir(exist_ok=True)
    (there / "meta.json").write_text(json.dumps(META))
    (there / "wheels.csv").write_text("t_s,left_m,right_m\n0,0,0\n3000,1,1\n")
    (there / "bearings.csv").write_text("t_s,track_id,bearing_rad\n" + rows)
    said, all_of_them = "", list[Message]()
    try:
        all_of_them = list(BearingsFolder(there, Config()).messages())
    except DataError as error:
        said = str(error)
    assert bool(all_of_them) != (".csv" in said)
    stamps = [message.stamp_ns for message in all_of_them]
    assert stamps == sorted(stamps)
    for look in all_of_them:
        if isinstance(look, Bearings):
            assert (np.abs(look.bearing_rad) <= np.pi).all()
            assert np.unique(look.track_id).size == look.track_id.size > 0


# ---------------------------------------------------------------- a real sensor: monocular cameras of small robots


@pytest.mark.parametrize("robot", [4])  # the shortest to calibrate; 3 and 5 take a minute each
def test_real_bearings_are_imported_and_never_called_calibrated_with_a_wrong_value(
    shared_data: Path, tmp_path: Path, robot: int
) -> None:
    folder = shared_data / f"mrclam_set6_robot{robot}"
    if not folder.is_dir():
        pytest.skip(f"needs {folder.name}, which is not here")
    read = import_bearings(folder, tmp_path / "out.mcap")
    rows = (folder / "bearings.csv").read_text().splitlines()[1:]
    seen = [message for message in read.messages() if isinstance(message, Bearings)]
    assert sum(look.track_id.size for look in seen) == len(rows)
    assert read.counts["Bearings"] == len({row.split(",")[0] for row in rows})
    recording = Recording(tmp_path / "out.mcap")
    truth = json.loads(recording.attachment("truth/extrinsics.json"))
    estimates = [r for r in calibrated(recording, recording.config(Config())) if isinstance(r, Estimate)]
    assert len(estimates) == read.counts["Bearings"] + 1  # the last frame once more, with everything solved
    for mount in (e.mount for e in estimates if e.state is State.CALIBRATED):
        assert mount is not None
        off, sigma = off_and_sigma(mount, truth)
        assert (np.abs(off) <= 3.0 * sigma).all(), (off, sigma)


def off_and_sigma(mount: Mount, truth: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the sensor's x, y and heading (m, m, rad): phi alone says nothing where the sensor is 12 mm from the origin.

    The truth itself is good to 10 mm and 0.2 deg, as its file says.
    """
    (c, s), rho = (math.cos(mount.phi_rad), math.sin(mount.phi_rad)), mount.rho_m
    slope = np.array([[-rho * s, c, 0.0], [rho * c, s, 0.0], [1.0, 0.0, 1.0]])
    variance = np.diag(slope @ mount.covariance @ slope.T) + np.array([0.01, 0.01, math.radians(0.2)]) ** 2
    off = (
        rho * c - truth["rho_m"] * math.cos(truth["phi_rad"]),
        rho * s - truth["rho_m"] * math.sin(truth["phi_rad"]),
        math.remainder(mount.phi_rad + mount.psi_rad - truth["phi_rad"] - truth["psi_rad"], math.tau),
    )
    return np.array(off), np.sqrt(variance)


def test_what_is_off_is_told_in_its_own_sigmas() -> None:
    truth = {"phi_rad": 0.0, "rho_m": 0.1, "psi_rad": 0.5}
    mount = Mount(math.pi / 2, 0.1, 0.5, np.diag([0.1**2, 0.02**2, 0.03**2]))
    off, sigma = off_and_sigma(mount, truth)
    assert off == pytest.approx([-0.1, 0.1, math.pi / 2])
    assert sigma == pytest.approx([math.hypot(0.01, 0.01), math.hypot(0.02, 0.01), math.hypot(0.1, 0.03, 0.00349066)])
