"""What is in deploy/ is what the code does."""

import configparser
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from omnivert.cli.robot.show_config import annotated
from omnivert.cli.settings import with_mode
from omnivert.config import Config, load
from omnivert.drivers.protocols.omnivert_line import OmnivertLine
from omnivert.drivers.protocols.sample import Sample

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"

# As much of an Arduino as the sketch touches: a clock, two counters to move, and a line to the computer.
ARDUINO = """
#include <cstdio>
static unsigned long clock_us = 1000;
static unsigned long micros() { return clock_us; }
static struct { void begin(unsigned long) {} void print(const char *text) { fputs(text, stdout); } } Serial;
enum { INPUT_PULLUP, CHANGE };
static int pins[8];
static void pinMode(int, int) {}
static int digitalRead(int pin) { return pins[pin]; }
static int digitalPinToInterrupt(int pin) { return pin; }
static void attachInterrupt(int, void (*)(), int) {}
static void noInterrupts() {}
static void interrupts() {}
#include SKETCH
int main() {
  setup();
  lastUs = micros();
  for (int k = 0; k < 4; ++k) {
    clock_us += PERIOD_US;
    pins[LEFT_A] = pins[LEFT_B] = pins[RIGHT_A] = 1;
    pins[RIGHT_B] = 0;
    leftEdge();
    rightEdge();
    rightEdge();
    loop();
    loop();
  }
}
"""


def test_the_default_configuration_is_the_default() -> None:
    path = DEPLOY / "robot.toml"
    assert load(path) == Config()
    assert path.read_text(encoding="utf-8") == annotated(Config()) + "\n", "omnivert config > deploy/robot.toml"


def test_every_setting_stands_in_the_default_configuration() -> None:
    # Those that follow the mode are commented out.
    text = re.sub(r"^# (\w+ = )", r"\1", (DEPLOY / "robot.toml").read_text(encoding="utf-8"), flags=re.MULTILINE)
    given = tomllib.loads(text)
    said = {name: set(table) for name, table in given.items()}
    assert said == {name: set(table) for name, table in Config().model_dump().items()}


def test_the_mode_is_one_word_in_a_copy_of_the_default_configuration(tmp_path: Path) -> None:
    copy = tmp_path / "robot.toml"
    copy.write_text((DEPLOY / "robot.toml").read_text(encoding="utf-8").replace('mode = "default"', 'mode = "paper"'))
    paper = load(copy)
    assert (paper.vision.edge_tolerance_deg, paper.vision.min_length) == (5.0, 0.5)
    assert paper == with_mode(Config(), "paper") == with_mode(load(DEPLOY / "robot.toml"), "paper")


def test_the_arduino_sketch_speaks_the_protocol(tmp_path: Path) -> None:
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("needs a C++ compiler, and none is here")
    source, program = tmp_path / "device.cpp", tmp_path / "device"
    source.write_text(ARDUINO)
    sketch = f'-DSKETCH="{DEPLOY / "encoder.ino"}"'
    subprocess.run([compiler, "-Wall", "-Werror", "-include", "cstdio", sketch, source, "-o", program], check=True)
    said = subprocess.run([program], check=True, capture_output=True).stdout
    parser = OmnivertLine()
    samples = parser.feed(said)
    assert not parser.refused
    start = 1000
    assert samples == [Sample(start + 20_000 * k, k, -2 * k) for k in range(1, 5)]
    assert max(map(len, said.splitlines())) <= 80


def test_the_unit_starts_what_the_project_installs() -> None:
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(DEPLOY / "omnivert.service")
    service = unit["Service"]
    assert service["ExecStart"].split("/bin/")[1] == "omnivert up --config /etc/omnivert/robot.toml"
    assert not Config().storage.path.is_absolute()
    assert service["WorkingDirectory"] == f"/var/lib/{service['StateDirectory']}"
    assert int(service["TimeoutStopSec"]) > 3
    assert service["Restart"] == "always"


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("needs systemd-analyze, which is not here")
    text = (DEPLOY / "omnivert.service").read_text().replace("/opt/omnivert/bin/omnivert", "/bin/true")
    (tmp_path / "omnivert.service").write_text(text)
    done = subprocess.run(
        [analyze, "verify", tmp_path / "omnivert.service"], capture_output=True, text=True, check=False
    )
    assert [line for line in done.stderr.splitlines() if "omnivert.service" in line] == []
