"""A whole drive: folder and recording hold the same, every path that ships can be driven, bad files are named."""

import json
import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from omnivert.cli.offline.simulate import PathOption, WorldOption
from omnivert.config import Config, parsed
from omnivert.errors import DataError, UseError
from omnivert.formats.frames_import import import_frames
from omnivert.formats.written import write_recording
from omnivert.messages import Bearings, Estimate, Frame, Scan, State, Ticks
from omnivert.offline import calibrated
from omnivert.simulation.fixtures import built
from omnivert.simulation.place import Kind, Place
from omnivert.simulation.route import Route
from omnivert.simulation.stage import Stage
from omnivert.simulation.toml_file import loaded, names
from omnivert.simulation.trip import Trip
from omnivert.simulation.trip_folder import write_folder
from omnivert.wire.recording import Recording

SLOW = parsed({"camera": {"frame_rate_hz": 2.0}}, "the test")
SHORT = Route.model_validate({"leg": [{"straight_m": 0.15}, {"turn_deg": 5.0}]})


def trip(route: Route = SHORT, world: str = "office", noise_k: float = 2e-4, seed: int = 4) -> Trip:
    return Trip(Stage(SLOW, loaded(world, "worlds", Place), seed), route, noise_k)


def same(one: object, other: object) -> bool:
    return all(np.array_equal(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))  # type: ignore[arg-type]


def test_a_folder_that_is_imported_is_the_recording(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_folder(trip(), tmp_path / "drive", lambda done, total: told.append((done, total)))
    import_frames(tmp_path / "drive", tmp_path / "imported.mcap", SLOW)
    write_recording(trip(), tmp_path / "straight.mcap")
    imported, straight = Recording(tmp_path / "imported.mcap"), Recording(tmp_path / "straight.mcap")
    assert imported.counts == straight.counts
    assert told[-1] == (sum(straight.counts.values()), sum(straight.counts.values()))
    pairs = zip(imported.messages(), straight.messages(), strict=True)
    for (key, one), (other_key, other) in pairs:
        assert key == other_key
        assert same(one, other), (one, other)
    assert set(imported.attachments) == set(straight.attachments)
    for name in straight.attachments:
        assert imported.attachment(name) == straight.attachment(name), name
    assert imported.config(Config()).rig() == straight.config(Config()).rig()


def test_a_recording_carries_poses_lines_and_mount_of_every_picture(tmp_path: Path) -> None:
    drive = trip()
    messages = list(drive.messages())
    truth = {name: data.decode() for name, data in drive.attachments()}
    kinds = [type(message) for message in messages]
    assert (kinds.count(Frame), kinds.count(Scan), kinds.count(Ticks)) == (
        drive.frames,
        drive.frames,
        drive.counts["Ticks"],
    )
    stamps = [message.stamp_ns for message in messages]
    assert stamps == sorted(stamps)
    assert json.loads(truth["truth/extrinsics.json"])["rho_m"] == 0.23
    poses = np.loadtxt(truth["truth/poses.csv"].splitlines(), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(poses[:, 0], np.arange(drive.frames))
    assert np.hypot(*(poses[-1, 2:4] - poses[0, 2:4])) == pytest.approx(0.15, abs=0.05)
    lines = np.loadtxt(truth["truth/lines.csv"].splitlines(), delimiter=",", skiprows=1)
    world = truth["truth/edges_world.csv"].splitlines()[1:]
    place = {int(row.split(",")[0]): [float(x) for x in row.split(",")[1:3]] for row in world}
    phi, rho, psi = np.radians(-19.5), 0.23, np.radians(18.9)
    for index, line, bearing, _, distance, *_ in lines:  # by the model of the bearings, from pose and place alone
        _, _, x, y, heading = poses[int(index)]
        sight = np.array(place[int(line)]) - (x + rho * np.cos(heading + phi), y + rho * np.sin(heading + phi))
        off = np.arctan2(sight[1], sight[0]) - heading - phi - psi - bearing
        assert abs(np.sin(off)) * np.hypot(*sight) < 1.5e-3  # ends within a millimetre are one line
        assert distance == pytest.approx(np.hypot(*sight), rel=0.03)


def test_the_calibration_finds_the_mount_from_a_drive_without_noise() -> None:
    legs = [{"straight_m": 0.5}, {"turn_deg": 60.0}, {"straight_m": 0.5}]
    drive = trip(Route.model_validate({"leg": legs, "speed_m_s": 0.25, "turn_deg_s": 15.0}), noise_k=0.0)
    found = [m for m in estimates(drive) if m.smoother is not None or m.mount is not None]
    mount = found[-1].smoother or found[-1].mount
    assert mount is not None
    assert mount.rho_m == pytest.approx(0.23, abs=0.01)
    assert mount.phi_rad == pytest.approx(np.radians(-19.5), abs=0.05)
    assert mount.phi_rad + mount.psi_rad == pytest.approx(np.radians(-0.6), abs=0.003)


def test_a_robot_that_rests_before_it_drives_ends_calibrated_without_an_alarm() -> None:
    around = [{"straight_m": 0.75}, {"turn_deg": 90.0}] * 3
    legs = [{"rest_s": 6.0}, *around, {"straight_m": 0.75}]
    found = estimates(trip(Route.model_validate({"leg": legs, "speed_m_s": 0.25, "turn_deg_s": 15.0})))
    assert State.MOVED not in {estimate.state for estimate in found}
    assert found[-1].state is State.CALIBRATED
    mount = found[-1].mount
    assert mount is not None
    off = np.array([mount.phi_rad, mount.rho_m, mount.psi_rad]) - [np.radians(-19.5), 0.23, np.radians(18.9)]
    assert (np.abs(off) < 3.0 * np.sqrt(np.diag(mount.covariance))).all()


def estimates(drive: Trip) -> list[Estimate]:
    class Kept:
        """What `calibrated` needs of a recording."""

        counts: dict[str, int]

        def messages(self, types: tuple[type, ...]) -> object:
            return ((key_of[type(m)], m) for m in drive.messages() if isinstance(m, types))

    from omnivert.wire.channels import FRAME, TICKS

    key_of = {Frame: FRAME.key(SLOW), Ticks: TICKS.key(SLOW)}
    kept = Kept()
    kept.counts = {key_of[Frame]: drive.frames}
    results = calibrated(kept, SLOW)  # type: ignore[arg-type]
    return [m for m in results if isinstance(m, Estimate) and not isinstance(m, Bearings)]


@pytest.mark.parametrize(("world", "path"), [*(("office", path) for path in names("paths")), ("hall", "arc-1.9")])
def test_every_path_fits_into_the_worlds_that_ship(world: str, path: str) -> None:
    assert trip(loaded(path, "paths", Route), world).seconds > 30.0


def test_the_commands_name_all_worlds_and_paths_that_ship() -> None:
    for kind, option in (("worlds", WorldOption), ("paths", PathOption)):
        told = str(get_args(option)[1].help).split(", or your own")[0].split(", ")
        assert sorted(told) == names(kind)


def test_a_path_into_a_wall_is_refused_with_its_place() -> None:
    with pytest.raises(DataError, match=r"leads into something.*x = 8\.[67]") as refused:
        trip(Route.model_validate({"leg": [{"straight_m": 20.0}], "speed_m_s": 2.0}))
    assert refused.value.code == "OV213"


def test_a_camera_that_sits_far_out_does_not_go_through_a_wall() -> None:
    """From [-1.6, -0.2] toward a wall at x = 3."""
    square = {"points": [[-4, -3], [3, -3], [3, 3], [-4, 3]], "closed": True}
    for rho, nearest in ((0.23, 0.28), (0.6, 0.65)):
        place = Place.model_validate({"wall": [square], "start": [-1.6, -0.2, 0.0], "camera": {"rho_m": rho}})
        with pytest.raises(DataError, match="leads into something") as refused:
            Trip(Stage(SLOW, place, 4), Route.model_validate({"leg": [{"straight_m": 9.0}], "speed_m_s": 0.5}), 0.0)
        stopped = re.search(r"x = ([\d.]+) m", str(refused.value))
        assert stopped is not None
        assert float(stopped[1]) == pytest.approx(3.0 - nearest, abs=0.5 * 0.02 + 0.005)


def test_what_would_hang_above_its_wall_is_not_there() -> None:
    wall = {
        "points": [[0, 0], [4, 0]],
        "high_m": 0.8,
        "fixtures": [{"kind": kind, "at_m": 2} for kind in get_args(Kind)],
    }
    panels, rounds = built(Place.model_validate({"wall": [wall]}))
    assert all(panel.low_m < panel.high_m for panel in panels)
    assert [(pipe.kind, pipe.low_m, pipe.high_m) for pipe in rounds] == [("pipe", 0.0, 0.8)]
    assert {thing.kind for thing in panels} == {"wall", "door", "door_frame", "shelf", "cabinet", "pilaster"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[leg]]\nstraight_m = 1.0\nturn_deg = 2.0\n", "a leg is one of"),
        ("[[leg]]\narc_m = 1.0\n", "an arc has arc_m and radius_m"),
        ("[[leg]]\nstraight = 1.0\n", "leg.0.straight"),
        ("leg = 3\n", "leg"),
        ("speed_m_s = 1e-300\n[[leg]]\nstraight_m = 1.0\n", "a drive lasts 4 h at most"),
        ("turn_deg_s = 0.001\n[[leg]]\nturn_deg = 36.0\n", "takes 10 h"),
        ("[[leg]]\nrest_s = 3600.0\n" * 5, "takes 5 h"),
        ("[[leg]]\narc_m = 10.0\nradius_m = 1e-3\n", "an arc turns by 36000 degrees at most"),
        ("[[leg]]\narc_m = 1000.0\nradius_m = 5e-324\n", "an arc turns by"),
        ("start = [1e300, 0.0, 0.0]\n[[leg]]\nstraight_m = 1.0\n", "start.0"),
        ("start = [0.0, 0.0, 1e300]\n[[leg]]\nstraight_m = 1.0\n", "start.2"),
        ("", "leg"),
        ("[[leg]\n", "cannot be parsed"),
    ],
)
def test_a_path_of_ones_own_that_is_wrong_is_named(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "my.toml"
    file.write_text(text)
    with pytest.raises(UseError) as refused:
        loaded(str(file), "paths", Route)
    assert refused.value.code == "OV212"
    assert said in str(refused.value)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("start = [0, 0]\n[[wall]]\npoints = [[0, 0], [1, 0]]\n", "start"),
        (
            '[[wall]]\npoints = [[0, 0], [1, 0]]\nfixtures = [{ kind = "door", at_m = 3.0 }]\n',
            "beyond its wall of 1.00 m",
        ),
        ('[[wall]]\npoints = [[0, 0], [1, 0]]\nfixtures = [{ kind = "dor", at_m = 0.5 }]\n', "wall.0.fixtures.0.kind"),
        ("[[wall]]\npoints = [[0, 0], [1e300, 0]]\n", "wall.0.points.1.0"),
        (
            '[[wall]]\npoints = [[0, 0], [9, 0]]\nfixtures = [{ kind = "door", at_m = 3, low_m = 2, high_m = 1 }]\n',
            "low_m must be below high_m",
        ),
        ("[camera]\nheight_m = 3.0\n[[wall]]\npoints = [[0, 0], [1, 0]]\n", "below ceiling"),
    ],
)
def test_a_world_of_ones_own_that_is_wrong_is_named(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "my.toml"
    file.write_text(text)
    with pytest.raises(UseError, match=r"my\.toml") as refused:
        loaded(str(file), "worlds", Place)
    assert said in str(refused.value)


def test_the_examples_of_the_file_formats_are_what_is_read() -> None:
    text = (Path(__file__).resolve().parents[2] / "deploy" / "simulation-files.md").read_text()
    world, path = (tomllib.loads(part) for part in re.findall(r"```toml\n(.*?)```", text, re.DOTALL))
    bare = Place.model_validate({"wall": [{"points": [[0, 0], [1, 0]]}]})
    shown = Place.model_validate(world)
    assert (shown.camera, shown.ceiling, shown.laser) == (bare.camera, bare.ceiling, bare.laser)  # "the values above"
    assert len(Route.model_validate(path).leg) == 4
    assert re.findall(r"`(\w+)`", text.split("A fixture is")[1].split(";")[0]) == list(get_args(Kind))


def test_a_name_that_is_nearly_right_is_told() -> None:
    with pytest.raises(UseError) as refused:
        loaded("offise", "worlds", Place)
    assert refused.value.help == "did you mean office?"
    with pytest.raises(UseError, match=r"cannot read nowhere\.toml"):
        loaded("nowhere.toml", "paths", Route)
