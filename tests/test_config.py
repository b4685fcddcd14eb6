"""Configuration: a mistake is refused with the cure, and the paper's values are one word away."""

import re
from pathlib import Path

import pytest

from omnivert.config import Config, Section, load, parsed, with_rig
from omnivert.errors import UseError


def test_an_empty_file_is_the_default(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("")
    assert load(tmp_path / "robot.toml") == Config()


@pytest.mark.parametrize(
    ("given", "what", "help"),
    [
        ({"vision": {"sector": 3}}, "unknown key vision.sector", "did you mean sectors"),
        ({"robt": {}}, "unknown key robt", "did you mean robot"),
        ({"robot": {"wheel_base_m": 400}}, "robot.wheel_base_m = 400", "400 mm would be 0.4"),
        ({"robot": {"wheel_base_mm": 400}}, "unknown key robot.wheel_base_mm", "wheel_base_m"),
        ({"calibration": {"start_phi_rad": 20}}, "calibration.start_phi_rad = 20", "20 deg would be 0.3491"),
        ({"ring": {"r_min_px": 300.0}}, "ring", ""),
        ({"robot": {"id": "Robot 1"}}, "robot.id", ""),
        ({"robot": {"wheel_base_m": float("nan")}}, "robot.wheel_base_m", ""),
        ({"robot": {"wheel_base_m": True}}, "robot.wheel_base_m = true", "a plain number"),
        ({"robot": {"wheel_base_m": "0.4"}}, 'robot.wheel_base_m = "0.4"', "a plain number"),
        ({"robot": {"wheel_base_m": 10**400}}, "robot.wheel_base_m = 1000", "a plain number"),
        ({"camera": {"width_px": "640"}}, 'camera.width_px = "640"', "a plain number"),
        ({"camera": {"width_px": 640.0}}, "camera.width_px = 640.0", "a plain number"),
        ({"camera": {"bearing_sign": True}}, "camera.bearing_sign = true", ""),
        ({"bus": {"shared_memory": 1}}, "bus.shared_memory = 1", "without quotes"),
        ({"bus": {"listen": [3]}}, "bus.listen.0 = 3", "in quotes"),
        ({"storage": {"path": 3}}, "storage.path = 3", "in quotes"),
        ({"ring": {"center_px": [321.5]}}, "ring.center_px", "[321.5, 239.0]"),
        ({"ring": {"center_px": [321.5, "239"]}}, 'ring.center_px.1 = "239"', "a plain number"),
        ({"recorder": {"split_s": 1e-9}}, "recorder.split_s = 1e-09", ""),
        ({"recorder": {"split_mb": 0.001}}, "recorder.split_mb = 0.001", ""),
        ({"robot": 1}, "robot = 1", "[robot]"),
        ({"a\nb": 1}, "unknown key", ""),
    ],
)
def test_a_mistake_is_named_with_its_cure(given: dict[str, object], what: str, help: str) -> None:
    with pytest.raises(UseError) as refusal:
        parsed(given, "robot.toml")
    assert f"robot.toml: {what}" in refusal.value.what
    assert help in refusal.value.help
    assert "\n" not in str(refusal.value)
    assert not re.search(r"class|instance|dictionary", str(refusal.value))  # what only programmers know


@pytest.mark.parametrize("center", [(-226.0, 239.0), (866.0, 239.0), (321.5, -226.0), (321.5, 706.0), (1e9, 0.0)])
def test_a_ring_that_the_picture_cannot_show_is_refused(center: tuple[float, float]) -> None:
    with pytest.raises(UseError, match=r"ring\.center_px .* outside the picture of 640 x 480"):
        parsed({"ring": {"center_px": center}}, "robot.toml")
    assert parsed({"ring": {"center_px": (-224.0, 704.0)}}, "").ring.center_px == (-224.0, 704.0)


def test_a_whole_number_may_stand_where_a_number_is_needed() -> None:
    assert parsed({"robot": {"wheel_base_m": 1}, "ring": {"center_px": [320, 240]}}, "").robot.wheel_base_m == 1.0


@pytest.mark.parametrize("text", ["[1]", "null", '"robot"', "1"])
def test_json_that_holds_no_tables_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "robot.json").write_text(text)
    with pytest.raises(UseError, match=r"robot\.json: .*: a table is needed$"):
        load(tmp_path / "robot.json")


@pytest.mark.parametrize(("name", "text"), [("r.toml", "[robot]\nid = 'r2'\n"), ("r.json", '{"robot": {"id": "r2"}}')])
def test_a_mark_of_the_encoding_at_the_beginning_is_no_part_of_it(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8-sig")
    assert load(tmp_path / name).robot.id == "r2"


@pytest.mark.parametrize(("name", "text"), [("r.toml", "x = {}{}"), ("r.json", "{}{}")])
def test_what_is_nested_too_deeply_is_refused_in_one_line(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text.format("[" * 100_000, "]" * 100_000))
    with pytest.raises(UseError, match="nested too deeply"):
        load(tmp_path / name)


@pytest.mark.parametrize("text", ["[robot", "\xff\xfe", "= 3"])
def test_a_file_that_is_not_toml_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(UseError, match=r"robot\.toml"):
        load(path)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UseError, match=r"missing\.toml"):
        load(tmp_path / "missing.toml")


def test_paper_mode_takes_the_papers_values_unless_told_otherwise() -> None:
    paper = parsed({"vision": {"mode": "paper"}}, "").vision
    assert (paper.edge_tolerance_deg, paper.min_length) == (5.0, 0.5)
    assert (paper.sectors, paper.bins, paper.areas, paper.clip) == (720, 32, 3, 0.1)
    assert (paper.f1, paper.f2, paper.f3, paper.lookback_frames) == (1.05, 0.75, 0.8, 20)
    assert parsed({"vision": {"mode": "paper", "min_length": 0.4}}, "").vision.min_length == 0.4


def test_json_of_the_settings_loads_as_the_same_settings(tmp_path: Path) -> None:
    config = parsed({"robot": {"id": "r2", "wheel_base_m": 0.3}, "vision": {"mode": "paper"}}, "")
    (tmp_path / "config.json").write_text(config.model_dump_json())
    assert load(tmp_path / "config.json") == config


SECTIONS = {name: field.annotation for name, field in Config.model_fields.items()}


@pytest.mark.parametrize("name", SECTIONS)
def test_every_table_and_every_setting_in_it_says_what_it_means(name: str) -> None:
    section = SECTIONS[name]
    assert isinstance(section, type)
    assert issubclass(section, Section)
    assert section.__doc__
    assert [key for key, field in section.model_fields.items() if len(field.description or "") < 8] == []


def test_the_rig_digest_follows_the_geometry_and_nothing_else() -> None:
    digest = Config().rig_digest()
    assert parsed({"vision": {"min_length": 0.5}, "encoder": {"port": "/dev/x"}}, "").rig_digest() == digest
    geometry = ({"robot": {"wheel_base_m": 0.41}}, {"camera": {"bearing_sign": -1}})
    for rig in (*geometry, {"encoder": {"left_sign": -1}}, {"encoder": {"swap_sides": True}}):
        assert parsed(rig, "").rig_digest() != digest


def test_what_was_stored_with_sides_swapped_is_of_another_rig_and_says_so() -> None:
    right, swapped = Config(), parsed({"encoder": {"swap_sides": True}}, "")
    for one, other in ((right, swapped), (swapped, right)):
        (change,) = one.rig_changes(other.rig_digest())
        assert change.startswith("encoder (")
        assert "swap_sides" in change
    assert swapped.rig()["encoder"]["swap_sides"] is True
    assert with_rig(right, swapped.rig(), "a recording").rig_digest() == swapped.rig_digest()


def test_the_digest_of_a_rig_without_swapped_sides_is_what_it_always_was() -> None:
    """What robots have stored under it is taken up again."""
    assert Config().rig_digest() == "6ac37446-17b008e2-2a0fa889-13d42508-41a7a8c7"
