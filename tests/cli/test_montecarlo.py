"""`omnivert montecarlo` as a person or a script meets it."""

import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from omnivert.cli.offline.study_targets import tell_targets
from omnivert.studies.presets import PRESETS
from tests.processes import own

from .conftest import Marked, Omnivert

SHORT = ("montecarlo", "--paths", "straight,still", "--runs", "2", "--visible", "4")


def test_json_holds_each_path_below_the_pooled_figures(omnivert: Omnivert, tmp_path: Path) -> None:
    ran = omnivert(*SHORT, "--json", "--plots", tmp_path / "charts")
    assert ran.code == 0
    assert ran.json["runs"] == 4
    assert ran.json["false_calibrated"] == ran.json["calibrated_runs"] == 0
    assert set(ran.json["paths"]) == {"straight", "still"}
    assert ran.json["efficiency"].keys() == {"filter", "smoother"}
    assert (tmp_path / "charts" / "montecarlo-verdicts.png").read_bytes()[:4] == b"\x89PNG"


def test_the_table_has_a_row_for_each_path_and_the_same_seed_gives_it_again(omnivert: Omnivert) -> None:
    first, second = (omnivert(*SHORT) for _ in range(2))
    assert first.code == 0
    assert first.out == second.out
    rows = [line.split()[:2] for line in first.out.splitlines()]
    assert ["straight", "2"] in rows
    assert ["all", "4"] in rows


def test_a_preset_shows_its_targets_beside_the_figures(omnivert: Omnivert) -> None:
    ran = omnivert("montecarlo", "--preset", "degenerate", "--runs", "1", "--seed", "9")
    assert ran.code == 0
    assert sum(line.startswith("false calibrated") and line.endswith("✓") for line in ran.out.splitlines()) == 8
    assert "chance" not in ran.err  # no error over its bound among these targets


@pytest.mark.parametrize(("runs", "said"), [(2, "of 2 runs chance alone moves error/bound by 50 %"), (50, "")])
def test_targets_of_few_runs_are_told_with_what_chance_does(
    runs: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    case = replace(PRESETS["world"][0], targets={"efficiency_smoother": (0.0, 1.15)})
    figures = {
        "runs": runs,
        "efficiency": {"smoother": [1.36, 2.27, 1.53]},
        "targets_met": {"efficiency_smoother": False},
    }
    tell_targets([case], {case.name: figures})
    out, err = capsys.readouterr()
    assert "missed" in out
    assert (said in err) if said else not err


def test_knocks_are_told_by_kind_with_their_targets(omnivert: Omnivert, tmp_path: Path) -> None:
    ran = omnivert("montecarlo", "--preset", "knock", "--runs", "1", "--seed", "3", "--json", "--plots", tmp_path)
    assert ran.code == 0
    assert ran.json["preset"] == "knock"
    assert set(ran.json["paths"]) == {"1 mrad", "3 mrad"}
    for figures in ran.json["paths"].values():
        assert figures["by_kind"]["yaw"]["runs"] == figures["runs"] == 1
        assert figures["by_kind"]["left"]["noticed_share"] is None
        assert figures["false_alarms"] == 0
    assert (tmp_path / "montecarlo-knock.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("wrong", "right"), [(("--paths", "papr"), "--paths paper"), (("--preset", "wrld"), "--preset world")]
)
def test_a_wrong_word_is_refused_with_the_right_one(omnivert: Omnivert, wrong: tuple[str, str], right: str) -> None:
    ran = omnivert("montecarlo", *wrong)
    assert ran.code == 2
    assert right in ran.err


@pytest.mark.parametrize(
    ("options", "idle"),
    [
        (("--preset", "knock", "--bearing-mrad", "3.0"), "--bearing-mrad beside --preset knock"),
        (("--preset", "world", "--paths", "turn"), "--paths beside --preset world"),
        (("--preset", "world", "--free"), "--free beside --preset world"),
        (("--preset", "degenerate", "--hours", "1"), "--hours beside --preset degenerate"),
        (("--preset", "long", "--runs", "3"), "--runs beside --preset long"),
        (("--hours", "1"), "--hours without a preset"),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(
    omnivert: Omnivert, options: tuple[str, ...], idle: str
) -> None:
    ran = omnivert("montecarlo", *options)
    assert ran.code == 2
    assert idle in ran.err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_an_end_from_outside_leaves_no_worker(marked: Marked, number: int, code: int) -> None:
    program = "from omnivert.cli import main; main()"
    arguments = ("montecarlo", "--paths", "straight", "--runs", "100000", "--jobs", "2", "--json")
    started = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        env=marked.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with own(started) as process:
        until = time.monotonic() + 60.0
        while len(marked.processes()) < 4 and time.monotonic() < until:  # two workers, what tracks their semaphores
            time.sleep(0.05)
        assert len(marked.processes()) >= 4
        process.send_signal(number)
        process.communicate(timeout=30.0)
        assert process.returncode == code
    while marked.processes() and time.monotonic() < until:
        time.sleep(0.05)
    assert marked.processes() == []
