"""The comparison measures what it says, with the peers in a process of their own, and says so in figures and charts."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.bench import growth as growing
from omnivert.bench.charts import write_comparison, write_growth
from omnivert.bench.contender import Contender
from omnivert.bench.peers.contest import NAMES, peer_run
from omnivert.bench.peers.environment import cache_folder, peers_python
from omnivert.bench.peers.run import PEERS
from omnivert.bench.score.score import score
from omnivert.bench.score.truth import Sighting, truth_of
from omnivert.bench.vision import decoded, raw, vision_run
from omnivert.cli.app import run
from omnivert.cli.settings import recording_path
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Frame, PixelFormat
from omnivert.offline import tracked
from omnivert.vision.frontend import FrontEnd
from omnivert.wire.recording import Recording, RecordingWriter

TRUTH = ("truth/lines.csv", "truth/nonstatic_lines.csv", "truth/centers.csv")


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 8 frames of the packaged drive and their truth."""
    path = tmp_path_factory.mktemp("bench") / "short.mcap"
    corridor = Recording(recording_path("corridor"))
    with RecordingWriter(path, corridor.config(Config())) as writer:
        for key, message in corridor.messages(types=(Frame,), to_s=2.5):
            writer.write(key, message)
        for name in TRUTH:
            writer.attach(name, corridor.attachment(name))
    return path


@pytest.fixture(scope="module")
def left(short: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Contender]:
    """The folder that the peers work on, and our own run that has filled it."""
    folder = tmp_path_factory.mktemp("job")
    recording = Recording(short)
    return folder, vision_run(recording, recording.config(Config()), 100, folder)


def test_what_is_timed_finds_what_the_service_finds(short: Path, left: tuple[Path, Contender]) -> None:
    recording = Recording(short)
    for ours, there in zip(left[1].sightings, tracked(recording, recording.config(Config())), strict=True):
        assert np.array_equal(ours.track_id, there.track_id)
        assert np.array_equal(ours.bearing_rad, there.bearing_rad)


def test_the_step_is_the_sum_of_its_stages_and_holds_no_decoding(short: Path, left: tuple[Path, Contender]) -> None:
    ours = left[1]
    assert list(ours.stages) == [stage.name for stage in FrontEnd(Config()).stages]
    assert ours.step.count == ours.sobel_pair.count == 8 - 3
    assert max(spread.median_ms for spread in ours.stages.values()) < ours.step.median_ms
    assert {frame.format for frame in decoded(Recording(short), 3)} == {PixelFormat.GREY8}


def test_frames_are_left_as_they_were_seen(short: Path, left: tuple[Path, Contender]) -> None:
    folder, ours = left
    job = json.loads((folder / "job.json").read_text())
    assert [tuple(center) for center in job["centers_px"]] == [s.center_px for s in ours.sightings]
    pictures = np.fromfile(folder / "pictures", dtype=np.uint8).reshape(8, 480, 640)
    for picture, frame in zip(pictures, decoded(Recording(short), 8), strict=True):
        assert np.array_equal(picture.ravel(), frame.data)


def test_a_broken_frame_is_black_for_the_peers(short: Path, tmp_path: Path) -> None:
    recording = Recording(short)
    config = recording.config(Config())
    path = tmp_path / "broken.mcap"
    with RecordingWriter(path, config) as writer:
        for k, (key, message) in enumerate(recording.messages()):
            assert isinstance(message, Frame)
            writer.write(key, replace(message, data=message.data[:2000]) if k == 2 else message)
    ours = vision_run(Recording(path), config, 4, tmp_path)
    assert (ours.sightings[2].center_px, ours.sightings[2].track_id.size) == (None, 0)
    pictures = np.fromfile(tmp_path / "pictures", dtype=np.uint8).reshape(4, -1)
    assert [bool(picture.any()) for picture in pictures] == [True, True, False, True]
    orb = peer_run("orb", Path(sys.executable), tmp_path)
    assert [s.track_id.size > 50 for s in orb.sightings] == [True, True, False, True]


@pytest.mark.parametrize("name", ["orb", "sift"])
def test_key_points_are_found_and_followed_in_another_process(
    short: Path, left: tuple[Path, Contender], name: str
) -> None:
    folder, _ = left
    moved: list[int] = []
    peer = peer_run(name, Path(sys.executable), folder, lambda: moved.append(1))
    judged = peer.score(truth_of(Recording(short)))
    assert len(moved) == len(peer.sightings) == 8
    assert judged is not None
    assert judged.detection.precision > judged.detection.precision_chance + 0.05
    assert judged.identity.correct_percent > 40.0  # measured 79 and 56 on these frames
    assert peer.json(None).keys() == left[1].json(None).keys()
    assert list(peer.stages) == ["detecting", "describing", "matching"]


def test_the_line_peers_run_where_their_environment_is(short: Path, left: tuple[Path, Contender]) -> None:
    made = list(cache_folder().glob("peers-*/bin/python"))
    if not made:
        pytest.skip("needs the peers' environment, which omnivert bench vision makes")
    for name in ("edlines", "lsd"):
        judged = peer_run(name, peers_python(made[0]), left[0]).score(truth_of(Recording(short)))
        assert judged is not None
        assert judged.detection.precision > 0.9  # measured 0.95 and 0.92 on the whole drive
        assert judged.identity.correct_percent > 90.0


def test_every_peer_has_a_name() -> None:
    assert NAMES.keys() == PEERS.keys()


def test_a_peer_that_stops_is_named_with_what_it_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="EDLines") as refused:
        peer_run("edlines", Path(sys.executable), tmp_path)
    assert refused.value.code == "OV221"
    assert "job.json" in refused.value.because


def test_an_environment_that_lacks_something_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot run on") as refused:
        peers_python(tmp_path / "python")
    assert refused.value.code == "OV220"
    assert "\n" not in str(refused.value)


def test_an_interpreter_beside_one_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some-python").write_text("#!/bin/sh\nexit 0\n")
    (tmp_path / "some-python").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    assert peers_python(Path("some-python")) == tmp_path / "some-python"
    with pytest.raises(DataError, match="cannot run on") as refused:
        peers_python(Path("none-such"))
    assert refused.value.because == "No such file or directory"


def test_an_environment_that_cannot_be_made_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setattr("omnivert.bench.peers.environment.cache_folder", lambda: tmp_path / "file" / "below")
    said: list[str] = []
    with pytest.raises(DataError, match="cannot be made") as refused:
        peers_python(None, said.append)
    assert refused.value.code == "OV220"
    assert "\n" not in str(refused.value)
    assert len(said) == 1
    assert "--no-peers" in refused.value.help


def test_the_command_prints_one_object(short: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ["bench", "vision", str(short), "--no-peers", "--json", "--plots", str(tmp_path / "plots")]
    assert run(arguments) == 0
    body = json.loads(capsys.readouterr().out)
    assert body["ratio_to_sobel"] == pytest.approx(body["vision_ms"] / body["sobel_pair_ms"])
    assert body["score"]["recall"] > 0.8
    assert (body["frames"], body["score"]["frames"], body["peers"], body["growth"]) == (8, 8, {}, None)
    assert set(body["stages"]) == {stage.name for stage in FrontEnd(Config()).stages}
    assert cv2.imread(str(tmp_path / "plots" / "vision-comparison.png")) is not None


def test_the_command_prints_tables(short: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "vision", str(short), "--no-peers", "--frames", "5"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[0].split() == ["stage", "median", "ms", "p99", "ms", "in", "Sobel", "pairs"]
    assert rows[-1].startswith("lines a frame")
    assert any(row.startswith("omnivert ") for row in rows)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, short: Path) -> growing.Growth:
    monkeypatch.setattr(growing, "SIZES", ((320, 240), (480, 360), (640, 480)))
    monkeypatch.setattr(growing, "LINES", (10, 40))
    monkeypatch.setattr(growing, "FRAMES", 2)
    recording = Recording(short)
    return growing.growth(recording, recording.config(Config()))


def test_growth_is_over_sizes_and_lines(small: growing.Growth) -> None:
    assert [p.width_px for p in small.sizes] == [p.width_px for p in small.frames] == [320, 480, 640]
    assert [p.ring_pixels for p in small.sizes] == pytest.approx([36644, 82448, 146574], rel=1e-3)
    assert [p.lines for p in small.lines] == pytest.approx([10, 40], abs=2)
    assert small.json().keys() == {"sizes", "frames", "lines", "exponent_in_ring_pixels", "us_per_line"}


def test_slopes_are_those_of_the_points() -> None:
    def point(pixels: int, lines: float, ms: float) -> growing.Point:
        return growing.Point(1, 1, pixels, None, lines, ms, 0.1)

    sizes = tuple(point(n, 50, 1e-4 * n) for n in (10_000, 40_000, 90_000))
    lines = tuple(point(1, n, 3.0 + 0.02 * n) for n in (10, 50, 100))
    grown = growing.Growth(sizes, sizes, lines)
    assert grown.exponent == pytest.approx(1.0)
    assert grown.us_per_line == pytest.approx(20.0)


def test_a_drawn_picture_has_its_lines_at_any_size() -> None:
    config = growing.scaled_config(Config(), 1.5)
    assert (config.camera.width_px, config.camera.height_px, config.ring.r_max_px) == (960, 720, 337.5)
    assert config.ring.center_px == pytest.approx((322.0 * 1.5 - 0.5, 239.5 * 1.5 - 0.5))
    bearings = FrontEnd(config).step(raw(growing.picture_with_lines(config, 30), 0))
    assert bearings.track_id.size == pytest.approx(30, abs=1)


def test_charts_are_drawn_with_and_without_truth(
    tmp_path: Path, short: Path, left: tuple[Path, Contender], small: growing.Growth
) -> None:
    ours = left[1]
    blind: Any = replace(ours, sightings=[Sighting(np.empty(0, dtype=np.int64), np.empty(0))] * 8)
    truths = truth_of(Recording(short))
    assert truths is not None
    both = {"omnivert": ours, "nothing": blind}
    write_comparison(tmp_path / "a.png", both, {name: score(c.sightings, truths) for name, c in both.items()})
    write_comparison(tmp_path / "b.png", both, dict.fromkeys(both))
    write_growth(tmp_path / "c.png", small)
    widths = []
    for name in ("a", "b", "c"):
        picture = cv2.imread(str(tmp_path / f"{name}.png"))
        assert picture is not None
        assert picture.std() > 10.0
        widths.append(picture.shape[1])
    assert widths[0] > 2 * widths[1]
