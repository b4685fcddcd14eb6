"""What `omnivert track` tells of looks, ring and meeting point, and the video that it draws."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.bench.vision import raw
from omnivert.cli.offline import drawn
from omnivert.cli.offline.drawn import CODECS, Video, fitted, frame_rate_hz
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Bearings, Frame, Looks, MeetingPoint, PixelFormat
from omnivert.vision.frontend import FrontEnd
from omnivert.vision.image import grey_from_frame
from omnivert.wire.channels import FRAME
from omnivert.wire.recording import Recording, RecordingWriter

LOOKS = ("polarity", "inner_px", "outer_px", "quality", "moving")
MEETING = ("meeting_u_px", "meeting_v_px", "meeting_std_px", "meeting_used")


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def _pictures(path: Path) -> list[NDArray[Any]]:
    read = cv2.VideoCapture(str(path))
    pictures: list[NDArray[Any]] = []
    while True:
        there, picture = read.read()
        if not there:
            return pictures
        pictures.append(picture)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A front end that tells neither looks nor meeting point."""
    step = FrontEnd.step

    def without(self: FrontEnd, frame: Frame) -> Bearings:
        seen = step(self, frame)
        ring = None if seen.ring is None else replace(seen.ring, std_px=0.0)
        return replace(seen, looks=None, meeting=None, ring=ring)

    monkeypatch.setattr(FrontEnd, "step", without)


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> None:
    """A front end that tells both, tracks 2 and 5 moving, and a meeting point (3, 4) px off the ring's centre."""
    step = FrontEnd.step

    def filled(self: FrontEnd, frame: Frame) -> Bearings:
        seen = step(self, frame)
        n = len(seen.track_id)
        looks = Looks(
            polarity=np.where(seen.track_id % 2 == 0, 1, -1).astype(np.int32),
            inner_px=np.full(n, 70.25, dtype=np.float32),
            outer_px=np.full(n, 200.5, dtype=np.float32),
            quality=np.full(n, 0.75, dtype=np.float32),
            moving=np.isin(seen.track_id, (2, 5)).astype(np.uint8),
        )
        assert seen.ring is not None
        ring = replace(seen.ring, std_px=0.125)
        meeting = MeetingPoint(ring.center_u_px + 3.0, ring.center_v_px + 4.0, 0.5, True)
        return replace(seen, looks=looks, meeting=meeting, ring=ring)

    monkeypatch.setattr(FrontEnd, "step", filled)


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """Frames of noise at 12.5 Hz, 6 of 65x47, the fourth of them no picture."""
    path, rng = tmp_path / "tiny.mcap", np.random.default_rng(5)
    config = Config.model_validate(
        {
            "camera": {"width_px": 65, "height_px": 47},
            "ring": {"center_px": (32.0, 23.0), "r_min_px": 5.0, "r_max_px": 22.0},
        }
    )
    with RecordingWriter(path, config) as writer:
        for k in range(6):
            _, png = cv2.imencode(".png", rng.integers(0, 255, (47, 65), dtype=np.uint8))
            data = np.zeros(9, dtype=np.uint8) if k == 3 else png.ravel()
            writer.write(FRAME.key(config), Frame(80_000_000 * k, PixelFormat.PNG, 65, 47, data))
    return path


@pytest.mark.usefixtures("full")
def test_tables_tell_looks_and_meeting_point_where_they_are_known(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    ran = omnivert("track", straight, "--csv", tmp_path / "l.csv", "--centers", tmp_path / "c.csv", "--json")
    lines, centers = _rows(tmp_path / "l.csv"), _rows(tmp_path / "c.csv")
    assert tuple(lines[0])[6:] == ("strength", *LOOKS)
    for row in lines:
        track = int(row["track_id"])
        told = tuple(row[name] for name in LOOKS)
        assert told == ("-1" if track % 2 else "1", "70.25", "200.50", "0.7500", str(int(track in (2, 5))))
    for row in centers:
        assert float(row["meeting_u_px"]) == pytest.approx(float(row["cu_px"]) + 3.0, abs=1e-3)
        assert float(row["meeting_v_px"]) == pytest.approx(float(row["cv_px"]) + 4.0, abs=1e-3)
        assert (row["std_px"], row["meeting_std_px"], row["meeting_used"]) == ("0.1250", "0.5000", "1")
    meeting, ring = ran.json["meeting"], ran.json["ring"]
    assert meeting["median_offset_px"] == pytest.approx(5.0)
    assert (meeting["frames"], meeting["frames_used"], meeting["used"]) == (24, 24, True)
    assert ran.json["moving_tracks"] == 2
    assert ring["median_std_px"] == 0.125
    assert abs(ring["median_radius_px"] - 225.0) < 2.0
    sightings: dict[str, int] = {}
    for row in lines:
        sightings[row["track_id"]] = sightings.get(row["track_id"], 0) + 1
    assert ran.json["median_track_frames"] == np.median(list(sightings.values()))


@pytest.mark.usefixtures("full")
def test_moving_tracks_are_said(omnivert: Any, straight: Path) -> None:
    assert omnivert("track", straight).out.splitlines()[0].endswith(" tracks, 2 of them moving")


@pytest.mark.usefixtures("bare")
def test_what_is_not_known_stays_empty_and_null(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    ran = omnivert("track", straight, "--csv", tmp_path / "l.csv", "--centers", tmp_path / "c.csv", "--json")
    assert {row[name] for row in _rows(tmp_path / "l.csv") for name in LOOKS} == {""}
    assert {row[name] for row in _rows(tmp_path / "c.csv") for name in ("std_px", *MEETING)} == {""}
    assert (ran.json["moving_tracks"], ran.json["meeting"], ran.json["ring"]["median_std_px"]) == (None, None, None)
    assert omnivert("track", straight).out.splitlines()[0].endswith(" tracks")


@pytest.fixture
def spoilt(straight: Path, tmp_path: Path) -> Path:
    """The straight drive; frames 5 to 9 are half black, 12 and 13 cut off, 15 is all white."""
    source, path, index = Recording(straight), tmp_path / "spoilt.mcap", -1
    config = source.config(Config())
    with RecordingWriter(path, config) as writer:
        for key, message in source.messages():
            if isinstance(message, Frame):
                index += 1
                picture = grey_from_frame(message).copy()
                if 5 <= index <= 9:
                    picture[240:] = 0
                if index == 15:
                    picture[:] = 255
                if index not in (12, 13):
                    message = raw(picture, message.stamp_ns)
                else:
                    message = replace(message, data=message.data[: message.data.size // 2].copy())
            writer.write(key, message)
    return path


def test_what_was_wrong_with_frames_is_counted_and_named(omnivert: Any, spoilt: Path) -> None:
    told = omnivert("track", spoilt, "--json").json
    expected = {
        "50 % of the ring is black": 5,
        "jpeg frame is cut off": 2,
        "ring not in the picture; last one held": 1,
        "no lines": 1,
        "100 % of the ring is white": 1,
    }
    assert told["reasons"] == expected
    assert next(iter(told["reasons"])) == "50 % of the ring is black"
    assert told["frames_unusable"] == 3
    assert told["notes"] == {}
    rows = [row.split(maxsplit=1) for row in omnivert("track", spoilt).out.splitlines()]
    assert ["3", "frames could not be used"] in rows
    assert {row[1]: int(row[0]) for row in rows if row[-1] in expected} == expected


def test_a_ring_that_is_not_where_it_is_configured_is_told(omnivert: Any, straight: Path, tmp_path: Path) -> None:
    source, path = Recording(straight), tmp_path / "moved.mcap"
    config = source.config(Config())
    u, v = config.ring.center_px
    ring = config.ring.model_copy(update={"center_px": (u + 28.0, v)})
    with RecordingWriter(path, config.model_copy(update={"ring": ring})) as writer:
        for key, message in source.messages():
            writer.write(key, message)
    told = omnivert("track", path, "--json").json["notes"]
    assert set(told) == {"ring"}
    assert told["ring"] in omnivert("track", path).out.splitlines()
    assert omnivert("track", straight, "--json").json["notes"] == {}


def test_a_rig_of_the_configuration_that_the_recording_does_not_share_is_told(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    file = tmp_path / "other.toml"
    file.write_text("[ring]\nr_max_px = 150.0\n[vision]\nmax_lines = 150\n")
    for command in ("track", "calibrate"):
        ran = omnivert(command, straight, "--config", file)
        assert "not used of the configuration: ring.r_max_px;" in ran.err
    assert "not used" not in omnivert("track", straight).err


def test_a_video_has_every_frame_in_the_size_of_the_pictures_at_the_pace_of_the_stamps(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    ran = omnivert("track", straight, "--video", tmp_path / "v.mp4", "--draw", tmp_path / "d")
    assert ran.code == 0
    assert f"wrote {tmp_path}/v.mp4" in " ".join(ran.err.split())
    assert cv2.VideoCapture(str(tmp_path / "v.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(3.0, abs=0.01)
    pictures = _pictures(tmp_path / "v.mp4")
    assert len(pictures) == len(list((tmp_path / "d").iterdir())) == 24
    still = cv2.imread(str(tmp_path / "d" / "000017.png"))
    assert still is not None
    assert pictures[17].shape == still.shape
    assert np.abs(pictures[17].astype(int) - still).mean() < 4.0
    assert np.abs(pictures[17].astype(int) - pictures[0]).mean() > 4.0


def test_a_frame_that_cannot_be_read_is_dark_in_the_video_with_its_reason(
    omnivert: Any, tiny: Path, tmp_path: Path
) -> None:
    ran = omnivert("track", tiny, "--video", tmp_path / "v.avi", "--draw", tmp_path / "d")
    assert ran.code == 1  # not one of its frames shows a ring
    assert "OV110" in ran.err
    pictures = _pictures(tmp_path / "v.avi")
    assert len(pictures) == 6
    assert {path.stem for path in (tmp_path / "d").iterdir()} == {f"{k:06d}" for k in (0, 1, 2, 4, 5)}
    picture, dark = np.median(pictures[2]), np.median(pictures[3])
    assert picture > 60.0
    assert dark < 30.0
    assert pictures[3].max() > 120
    assert cv2.VideoCapture(str(tmp_path / "v.avi")).get(cv2.CAP_PROP_FPS) == pytest.approx(12.5, abs=0.01)


@pytest.mark.parametrize("suffix", CODECS)
@pytest.mark.parametrize("size", [(65, 47), (64, 48)])
@pytest.mark.parametrize("rate", [0.1, 12.35, 59.94, 240.1])
def test_every_format_is_read_back_with_its_count_size_and_rate(
    tmp_path: Path, suffix: str, size: tuple[int, int], rate: float
) -> None:
    path = tmp_path / f"a%03d:b{suffix.upper()}"
    video = Video(path, rate)
    for k in range(5):
        video.step(np.full((size[1], size[0], 3), 40 * k, dtype=np.uint8))
    video.release()
    video.check()
    read = cv2.VideoCapture(str(path))
    assert read.get(cv2.CAP_PROP_FPS) == pytest.approx(rate, rel=0.01)
    pictures = _pictures(path)
    assert [abs(float(np.median(picture)) - 40 * k) < 6.0 for k, picture in enumerate(pictures)] == [True] * 5
    assert {picture.shape for picture in pictures} == {(48, size[0] + size[0] % 2, 3)}


def test_writing_a_video_says_nothing_of_its_own(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for suffix in CODECS:
        video = Video(tmp_path / f"v{suffix}", 5.0)
        video.step(np.zeros((48, 64, 3), dtype=np.uint8))
        video.release()
    assert capfd.readouterr() == ("", "")


def test_a_video_without_a_frame_is_no_error(tmp_path: Path) -> None:
    video = Video(tmp_path / "v.mp4", 5.0)
    video.release()
    video.check()


def test_a_video_that_lost_frames_on_its_way_is_said(tmp_path: Path) -> None:
    video = Video(tmp_path / "v.avi", 5.0)
    for _ in range(9):
        video.step(np.zeros((48, 64, 3), dtype=np.uint8))
    video.release()
    (tmp_path / "v.avi").write_bytes(b"")
    with pytest.raises(DataError, match="only 0 of 9 frames got there"):
        video.check()


def test_a_place_that_the_codec_cannot_open_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DataError, match="cannot write") as refused:
        Video(tmp_path / "none" / "v.mp4", 5.0).step(np.zeros((48, 64, 3), dtype=np.uint8))
    assert refused.value.code == "OV322"
    assert capfd.readouterr() == ("", "")


def test_the_rate_is_that_of_the_median_interval() -> None:
    assert frame_rate_hz([0, 100_000_000, 200_000_000, 900_000_000], 15.0) == 10.0
    assert frame_rate_hz([5, 5, 40_000_005, 40_000_005, 80_000_005], 15.0) == 25.0
    assert frame_rate_hz([7], 15.0) == 15.0
    assert frame_rate_hz([0, 1, 2], 15.0) == 1000.0
    assert frame_rate_hz([0, 10**15], 15.0) == 0.1
    assert frame_rate_hz([0, 4_166_700], 15.0) == 240.0


@pytest.mark.parametrize("shape", [(10, 10), (48, 64), (200, 64), (48, 300), (1, 500)])
def test_a_picture_of_another_size_is_fitted_in_without_cutting(shape: tuple[int, int]) -> None:
    picture = np.full((*shape, 3), 90, dtype=np.uint8)
    picture[:, -max(shape[1] // 4, 1) :] = 200
    inside = fitted(picture, (64, 48))
    assert inside.shape == (48, 64, 3)
    assert set(np.unique(inside)) >= {90, 200}


@pytest.mark.parametrize("name", ["v.txt", "v", "v.mp4.gz"])
def test_a_video_of_another_kind_is_refused_before_the_work(
    omnivert: Any, straight: Path, tmp_path: Path, name: str
) -> None:
    ran = omnivert("track", straight, "--video", tmp_path / name, "--draw", tmp_path / "d")
    assert (ran.code, ran.out, "a video is .mp4, .webm or .avi" in ran.err) == (2, "", True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["none/v.mp4", "file/v.mp4", "folder.mp4"])
def test_a_place_where_no_video_can_be_is_refused_before_the_work(
    omnivert: Any, straight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "file").write_bytes(b"mine")
    (tmp_path / "folder.mp4").mkdir()
    monkeypatch.setattr(drawn, "overlay", None)
    ran = omnivert("track", straight, "--video", tmp_path / name)
    assert (ran.code, ran.out, "error[OV322]" in ran.err) == (2, "", True)
    assert (tmp_path / "file").read_bytes() == b"mine"


def test_a_video_overwrites_neither_its_recording_nor_another_result(
    omnivert: Any, straight: Path, tmp_path: Path
) -> None:
    drive = tmp_path / "drive.mp4"
    drive.write_bytes(straight.read_bytes())
    ran = omnivert("track", drive, "--video", tmp_path / "." / "drive.mp4")
    assert (ran.code, "error[OV208]" in ran.err) == (2, True)
    assert drive.read_bytes() == straight.read_bytes()
    for other in ("--csv", "--centers", "--draw"):
        ran = omnivert("track", straight, "--video", tmp_path / "x.mp4", other, tmp_path / "x.mp4")
        assert (ran.code, "would overwrite each other" in ran.err) == (2, True)
