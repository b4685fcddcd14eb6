"""What the doctor says of the machine itself: installation, settings, store, disk."""

from dataclasses import replace
from pathlib import Path

import pytest

from omnivert.config import Config, parsed
from omnivert.doctor import about_signs
from omnivert.doctor.evidence import Device, Evidence, Keeping, OnBus, Service
from omnivert.doctor.finding import Status
from omnivert.doctor.host import keeping, this_host
from omnivert.doctor.report import Report
from omnivert.doctor.table import checked
from omnivert.messages import Health
from omnivert.store import Store
from tests.cli.conftest import extrinsics

GB = 2**30


def robot(config: Config, kept: Keeping | None, **more: object) -> Evidence:
    """A robot whose devices are fine; nothing is heard of it."""
    whole = Evidence(config, "robot.toml", True, False, this_host(), encoder=Device("a"), camera=Device("b"))
    return replace(whole, keeping=kept, **more)  # type: ignore[arg-type]


def found(evidence: Evidence, name: str) -> tuple[Status, str, str]:
    (check,) = checked(evidence, [name])
    return check.finding.status, check.finding.fact, check.finding.help


def stored_at(path: Path) -> Config:
    return parsed({"storage": {"path": str(path)}}, "the test")


@pytest.mark.parametrize(
    ("free", "status"),
    [(2**20, Status.STOPS), (100 * 2**20, Status.WORSE), (GB, Status.FINE), (None, Status.UNCHECKED)],
)
def test_a_disk_that_is_nearly_full_is_said_with_what_is_left(free: int | None, status: Status) -> None:
    said, fact, help = found(robot(Config(), Keeping("", None, free)), "disk")
    assert said is status
    assert (status is Status.FINE) == (status is not Status.UNCHECKED and not help)
    if free is not None:
        assert "of recording" in fact


def test_the_disk_is_really_asked(tmp_path: Path) -> None:
    kept = keeping(stored_at(tmp_path / "store.db"))
    assert kept.free_bytes is not None
    assert kept.free_bytes > 0


def test_a_store_is_looked_at_and_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "store.db"
    config = stored_at(path)
    assert "nothing stored yet" in keeping(config).store
    assert not path.exists()
    with Store(path) as store:
        store.put(extrinsics("demo", "front", 1, 0.5))
    before = path.stat().st_mtime_ns
    kept = keeping(config)
    assert kept.trouble is None
    assert "1 entry" in kept.store
    assert "not taken up: stored for another rig" in kept.store
    assert path.stat().st_mtime_ns == before


def test_a_store_that_can_not_be_written_stops(tmp_path: Path) -> None:
    nowhere = stored_at(tmp_path / "none" / "store.db")
    assert found(robot(nowhere, keeping(nowhere)), "store")[::2] == (Status.STOPS, f"mkdir -p {tmp_path / 'none'}")
    folder = stored_at(tmp_path)
    assert found(robot(folder, keeping(folder)), "store")[0] is Status.STOPS
    (tmp_path / "text.db").write_text("no store at all, but long enough to be looked at " * 40)
    text = stored_at(tmp_path / "text.db")
    assert found(robot(text, keeping(text)), "store")[0] is Status.STOPS


def test_what_storage_says_of_its_store_is_believed() -> None:
    health = Health(0, "storage", "front", 9.0, notes=("storage: the store x.db cannot be written: full; 2 waiting",))
    bus = OnBus(services=(Service("storage", "front", True, None, health),))
    status, fact, _ = found(robot(Config(), Keeping("fine", None, GB), bus=bus), "store")
    assert (status, fact) == (Status.STOPS, "the store x.db cannot be written: full; 2 waiting")


def test_another_machine_is_not_looked_at() -> None:
    for name in ("store", "disk"):
        status, fact, _ = found(robot(Config(), None), name)
        assert (status, "omnivert doctor there" in fact) == (Status.UNCHECKED, True)


def test_opencvs_over_each_other_are_named(tmp_path: Path) -> None:
    host = replace(this_host(), opencvs=("opencv-python", "opencv-python-headless"))
    status, _, help = found(robot(Config(), None, host=host), "install")
    assert status is Status.WORSE
    assert help.startswith("pip uninstall -y opencv-python &&")


def test_settings_that_differ_are_named(tmp_path: Path) -> None:
    config = parsed({"robot": {"wheel_base_m": 0.3}}, "the test")
    assert found(robot(config, None), "config")[1].endswith("1 value differs from the default: robot.wheel_base_m")


def test_without_configuration_and_robot_that_is_the_first_thing() -> None:
    evidence = replace(robot(Config(), None), source="", configured=False)
    report = Report.of(evidence, checked(evidence))
    assert report.first is not None
    assert report.first.name == "config"
    assert report.named(Status.STOPS) == ["config"]


@pytest.mark.parametrize("recording", [True, False])
def test_of_a_recording_nobody_is_asked_to_push_a_robot(recording: bool) -> None:
    seen = robot(Config(), None, recording=recording)
    told = [about_signs.wheels(seen).fact, about_signs.sense(seen).fact, about_signs.turns(seen).fact]
    assert all(("which this recording does not show" in fact) is recording for fact in told)
    assert all(("omnivert doctor --push" in fact) is not recording for fact in told)
