"""Configuration: a mistake is refused with the cure, and the paper's values are one word away."""

from pathlib import Path

import pytest

from omnivert.config import Config, load, parsed
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
    ],
)
def test_a_mistake_is_named_with_its_cure(given: dict[str, object], what: str, help: str) -> None:
    with pytest.raises(UseError) as refusal:
        parsed(given, "robot.toml")
    assert f"robot.toml: {what}" in refusal.value.what
    assert help in refusal.value.help
    assert "\n" not in str(refusal.value)


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


def test_the_rig_digest_follows_the_geometry_and_nothing_else() -> None:
    digest = Config().rig_digest()
    assert parsed({"vision": {"min_length": 0.5}, "encoder": {"port": "/dev/x"}}, "").rig_digest() == digest
    for rig in ({"robot": {"wheel_base_m": 0.41}}, {"camera": {"bearing_sign": -1}}, {"encoder": {"left_sign": -1}}):
        assert parsed(rig, "").rig_digest() != digest
