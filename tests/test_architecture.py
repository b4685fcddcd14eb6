"""The house: who may import whom, and each foreign package in its one room."""

import ast
from functools import cache
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
SOURCES = sorted(path for top in ("omnivert", "services") for path in (PROJECT / top).rglob("*.py"))

# Reading order is data order. A room may import itself and what stands above it.
HOUSE = (
    ("omnivert", "omnivert.angles", "omnivert.errors", "omnivert.threads", "omnivert.compiled"),
    ("omnivert.messages",),
    ("omnivert.config",),
    ("omnivert.timeline", "omnivert.increments"),
    ("omnivert.odometry",),
    ("omnivert.vision", "omnivert.calibration", "omnivert.drivers", "omnivert.simulation"),  # side by side
    ("omnivert.wire",),
    ("omnivert.store",),
    ("omnivert.store_rules", "omnivert.formats", "omnivert.pictures"),
    ("omnivert.offline",),
    ("omnivert.doctor",),
    ("omnivert.studies",),
    ("services",),
    ("omnivert.bench",),
    ("omnivert.cli",),
)
VISION = (
    "image",
    "turns",
    "cholesky",
    "edges",
    "rim",
    "ring",
    "fall",
    "survey",
    "inner",
    "line_fit",
    "lines",
    "meeting",
    "doubt",
    "faults",
    "descriptor",
    "dissimilarity",
    "panorama",
    "matching",
    "motion",
    "assignment",
    "tracker",
    "frontend",
    "warm_up",
    "account",
)  # data order, too
ONE_ROOM = {
    "zenoh": "omnivert/wire/bus.py",
    "msgpack": "omnivert/wire/codec.py",
    "mcap": "omnivert/wire/mcap_file.py",
    "filterpy": "omnivert/calibration/kalman/ekf.py",
    "sqlite3": "omnivert/store.py",
    "numba": "omnivert/compiled.py",
    "serial": "omnivert/drivers/serial_line.py",
    "tomlkit": "omnivert/cli/robot/config_edit.py",
    "rosbags": "omnivert/formats/rosbag/file.py",
    "foxglove": "omnivert/formats/foxglove/file.py",
}


@cache
def imported(path: Path) -> frozenset[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return frozenset(names)


def place(module: str) -> tuple[int, str]:
    """The floor and the room that a dotted name lies in; the innermost one."""
    level, room = max(
        ((level, room) for level, rooms in enumerate(HOUSE) for room in rooms if f"{module}.".startswith(f"{room}.")),
        key=lambda found: len(found[1]),
    )
    return level, room


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(PROJECT).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_imports_point_only_up_the_house(path: Path) -> None:
    level, room = place(module_name(path))
    ours = {name for name in imported(path) if name.split(".")[0] in ("omnivert", "services")}
    assert {name for name in ours if place(name)[0] >= level and place(name)[1] != room} == set()


def test_inside_vision_imports_point_only_up_its_data_flow() -> None:
    folder = PROJECT / "omnivert" / "vision"
    assert {path.stem for path in folder.glob("*.py")} == {*VISION, "__init__"}
    for here, name in enumerate(VISION):
        used = {dotted.split(".")[2] for dotted in imported(folder / f"{name}.py") if dotted.count(".") > 1}
        assert used & set(VISION) <= set(VISION[:here]), name


@pytest.mark.parametrize(("package", "room"), ONE_ROOM.items())
def test_a_foreign_package_lives_in_one_room(package: str, room: str) -> None:
    users = {str(path.relative_to(PROJECT)) for path in SOURCES if package in {n.split(".")[0] for n in imported(path)}}
    assert users == {room}


def test_every_module_stands_in_the_house() -> None:
    for path in SOURCES:
        assert place(module_name(path))[0] > 0 or module_name(path) in HOUSE[0], path


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_a_file_is_one_idea_short_enough_to_read(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


KERNELS = [
    path
    for path in SOURCES
    if module_name(path).startswith(
        ("omnivert.vision", "omnivert.calibration", "omnivert.timeline", "omnivert.increments", "omnivert.odometry")
    )
]


@pytest.mark.parametrize("path", KERNELS, ids=module_name)
def test_kernels_and_steppers_know_no_clock_and_no_environment(path: Path) -> None:
    assert imported(path).isdisjoint({"time", "datetime", "os", "logging", "random", "threading"})
