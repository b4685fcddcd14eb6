"""A recording -> plain files -> a recording: every message of a sensor comes back as it was, byte by byte."""

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from omnivert.cli.settings import recording_path
from omnivert.config import Config, parsed
from omnivert.errors import DataError
from omnivert.formats.bearings_import import import_bearings
from omnivert.formats.folder_export import Exported, export
from omnivert.formats.frames_import import import_frames
from omnivert.messages import (
    Bearings,
    Estimate,
    Extrinsics,
    Frame,
    Message,
    Mount,
    ParameterVerdict,
    PixelFormat,
    Ring,
    Scan,
    State,
    Ticks,
)
from omnivert.wire.channels import CHANNELS
from omnivert.wire.recording import Recording, RecordingWriter

SECOND = 1_000_000_000
RIG = {
    "robot": {"id": "r7", "wheel_base_m": 0.31},
    "encoder": {"id": "odo", "wheel_diameter_m": 0.123, "ticks_per_rev": 977, "left_sign": -1, "noise_k_m": 3e-4},
    "camera": {"id": "mirror", "width_px": 64, "height_px": 48, "bearing_sign": -1, "frame_rate_hz": 7.3},
    "ring": {"center_px": [31.25, 24.125], "r_min_px": 4.5, "r_max_px": 23.0, "horizon_px": 11.1},
}
CONFIG = parsed(RIG, "the test")
KEYS = {channel.message: channel.key(CONFIG) for channel in CHANNELS}


def written(path: Path, messages: list[Message], attached: dict[str, bytes] | None = None) -> Recording:
    with RecordingWriter(path, CONFIG) as writer:
        for message in messages:
            writer.write(KEYS[type(message)], message)
        for name, data in (attached or {}).items():
            writer.attach(name, data)
    return Recording(path)


def streams(recording: Recording, *names: str) -> dict[str, list[tuple[int, bytes]]]:
    found: dict[str, list[tuple[int, bytes]]] = {}
    for entry in recording.entries(names or None):
        found.setdefault(entry.key, []).append((entry.stamp_ns, entry.data))
    return found


def round_trip(recording: Recording, folder: Path) -> tuple[Exported, Recording]:
    exported = export(recording, folder / "plain")
    reads = import_frames if exported.kind == "frames" else import_bearings
    reads(folder / "plain", folder / "again.mcap")
    return exported, Recording(folder / "again.mcap")


# ------------------------------------------------------------------ images, wheels, scans

sides = st.integers(1, 12)


@st.composite
def frames(draw: Any, stamp_ns: int) -> Frame:
    """Also such as no decoder takes, and of other sizes than the rig says: so they may have been recorded."""
    form, width, height = draw(st.sampled_from(list(PixelFormat))), draw(sides), draw(sides)
    size = {PixelFormat.GREY8: width * height, PixelFormat.BGR8: 3 * width * height}.get(form)
    data = draw(st.binary(max_size=40)) if size is None else draw(st.binary(min_size=size, max_size=size))
    return Frame(stamp_ns, form, width, height, np.frombuffer(data, np.uint8))


@st.composite
def drives(draw: Any) -> list[Message]:
    begin_ns = draw(st.integers(0, (2**32 - 4000) * SECOND))
    stamps = [begin_ns + by for by in sorted(draw(st.lists(st.integers(0, 3000 * SECOND), min_size=2, max_size=12)))]
    rays, angle = draw(st.integers(1, 4)), st.floats(-1.0, 1.0)
    angles = draw(angle), draw(angle)
    ranges = arrays(np.float32, rays, elements=st.floats(0.0, 1e4, width=32))
    counts = st.integers(-(2**53), 2**53)
    messages: list[Message] = []
    for stamp in stamps:
        if draw(st.booleans()) or stamp in (stamps[0], stamps[-1]):
            messages += [draw(frames(stamp)), Ticks(stamp, draw(counts), draw(counts))]
        if draw(st.booleans()):
            messages.append(Scan(stamp, *angles, draw(ranges)))
    return messages


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(drives())
def test_every_message_and_the_rig_come_back(tmp_path_factory: pytest.TempPathFactory, messages: Any) -> None:
    folder = tmp_path_factory.mktemp("trip")
    recording = written(folder / "drive.mcap", messages)
    exported, again = round_trip(recording, folder)
    assert (exported.kind, exported.notes) == ("frames", [])
    assert streams(again) == streams(recording)
    assert again.config(Config()).rig() == CONFIG.rig()


def test_the_corridor_comes_back_byte_by_byte(tmp_path: Path) -> None:
    corridor = Recording(recording_path("corridor"))
    _, again = round_trip(corridor, tmp_path)
    assert list(again.entries()) == list(corridor.entries())
    carried = {name: corridor.attachment(name) for name in corridor.attachments if name != "meta.json"}
    assert {name: again.attachment(name) for name in again.attachments if name != "meta.json"} == carried
    before, after = (json.loads(recording.attachment("meta.json")) for recording in (corridor, again))
    assert after["mirror"] == before["mirror"]
    assert {**after["laser"], "range_max": 20.0} == before["laser"]


def pixels(form: PixelFormat, stamp_ns: int = 1) -> Frame:
    planes = 3 if form is PixelFormat.BGR8 else 1
    data = np.random.default_rng(1).integers(0, 256, 64 * 48 * planes, dtype=np.uint8)
    return Frame(stamp_ns, form, 64, 48, data)


@pytest.mark.parametrize("form", [PixelFormat.GREY8, PixelFormat.BGR8])
def test_raw_pixels_become_pictures_that_anybody_can_open(tmp_path: Path, form: PixelFormat) -> None:
    frame = pixels(form, 5)
    export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3), frame]), tmp_path / "plain")
    picture = cv2.imread(str(tmp_path / "plain" / "frames" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert np.array_equal(np.asarray(picture).reshape(-1), frame.data)
    with (tmp_path / "plain" / "frames.csv").open() as table:
        assert list(csv.reader(table))[1] == ["0", "0.000000005", "frames/000000.png", str(form), "64", "48"]
    with (tmp_path / "plain" / "encoders.csv").open() as table:
        assert list(csv.reader(table)) == [["t_s", "left_ticks", "right_ticks"], ["0.000000001", "2", "3"]]


def test_what_is_changed_in_meta_json_holds(tmp_path: Path) -> None:
    export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3), pixels(PixelFormat.GREY8)]), tmp_path / "plain")
    meta = json.loads((tmp_path / "plain" / "meta.json").read_text())
    meta["ring"]["r_max_px"] = 22.0
    (tmp_path / "plain" / "meta.json").write_text(json.dumps(meta))
    import_frames(tmp_path / "plain", tmp_path / "again.mcap")
    config = Recording(tmp_path / "again.mcap").config(Config())
    assert (config.ring.r_max_px, config.robot.id, config.encoder.left_sign) == (22.0, "r7", -1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("grey8", "gray"), "format = 'gray' is none of grey8, bgr8, jpeg, png"),
        (("grey8", "bgr8"), "the image is grey8, frames.csv says bgr8"),
        (("64,48", "64,47"), "the image has 64 x 48 pixels, frames.csv says 64 x 47"),
        (("64,48", "0,48"), "a frame of 0 x 48 pixels"),
    ],
)
def test_a_table_of_frames_that_contradicts_them_is_refused(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3), pixels(PixelFormat.GREY8)]), tmp_path / "plain")
    table = tmp_path / "plain" / "frames.csv"
    table.write_text(table.read_text().replace(*change))
    with pytest.raises(DataError, match=r"frames\.csv, row 2") as refused:
        import_frames(tmp_path / "plain", tmp_path / "again.mcap")
    assert says in str(refused.value)


# ------------------------------------------------------------------ bearings


@st.composite
def looks(draw: Any, stamp_ns: int) -> Bearings:
    tracks = draw(st.lists(st.integers(0, 2**53), unique=True, max_size=4))
    size, bearing = len(tracks), st.floats(-np.pi, np.pi)
    return Bearings(
        stamp_ns,
        np.array(tracks, np.int64),
        draw(arrays(np.float64, size, elements=bearing)),
        draw(arrays(np.float64, size, elements=st.floats(1e-6, np.pi))),
        draw(arrays(np.int32, size, elements=st.integers(0, 2**31 - 1))),
        draw(arrays(np.float32, size, elements=st.floats(0.0, 1.0, width=32))),
    )


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_every_bearing_and_count_comes_back(tmp_path_factory: pytest.TempPathFactory, data: Any) -> None:
    folder, most = tmp_path_factory.mktemp("trip"), round(9.9e7 / CONFIG.encoder.metres_per_tick)
    begin_ns, counts = data.draw(st.integers(0, 2**61)), st.integers(-most, most)
    steps = data.draw(st.lists(st.integers(0, 3000 * SECOND), min_size=1, max_size=8, unique=True).map(sorted))
    messages: list[Message] = []
    for step in steps:
        stamp = begin_ns + step
        messages += [Ticks(stamp, data.draw(counts), data.draw(counts)), data.draw(looks(stamp))]
    recording = written(folder / "drive.mcap", messages)
    exported, again = round_trip(recording, folder)
    assert (exported.kind, exported.notes) == ("bearings", [])
    assert streams(again) == streams(recording)
    assert again.config(Config()).rig() == CONFIG.rig()


def test_what_bearings_of_a_camera_say_beyond_the_form_is_told(tmp_path: Path) -> None:
    none = np.zeros(0)
    seen = Bearings(1, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))
    ringed = Bearings(2, seen.track_id, none, none, seen.age_frames, seen.strength, Ring(1.0, 2.0, 3.0, 1.0), ("dark",))
    exported = export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3), seen, ringed, Ticks(3, 2, 3)]), tmp_path / "plain")
    assert exported.notes == ["bearings.csv: ring, reasons and looks of 1 frames are left out"]
    assert exported.counts == {"Ticks": 2, "Bearings": 2}


# ------------------------------------------------------------------ what is beside them


def test_results_stand_beside_and_are_not_read_again(tmp_path: Path) -> None:
    mount = Mount(0.5, 0.25, -0.2, np.diag([1e-4, 4e-6, 9e-4]))
    good = ParameterVerdict(State.CALIBRATED)
    estimate = Estimate(6, 1, mount, State.CALIBRATED, good, good, good, "", 1.5, 2.5, 3, 0, 0)
    claim = Extrinsics(6, "r7", "mirror", mount, State.CALIBRATED, 7, ("seen",), "omnivert 0", "x")
    messages: list[Message] = [Ticks(1, 2, 3), pixels(PixelFormat.GREY8), Ticks(9, 9, 9), estimate, claim, claim]
    recording = written(tmp_path / "a.mcap", messages)
    _, again = round_trip(recording, tmp_path)
    assert streams(again) == streams(recording, "Frame", "Ticks")
    results = tmp_path / "plain" / "results"
    with (results / "estimates.csv").open() as table:
        (row,) = csv.DictReader(table)
    assert (row["t_s"], row["state"], float(row["phi_rad"])) == ("0.000000006", "calibrated", 0.5)
    assert float(row["rho_std_m"]) == pytest.approx(0.002)
    (told,) = json.loads((results / "extrinsics.json").read_text())
    assert (told["rho_m"], told["covariance"][2][2], told["reasons"]) == (0.25, 9e-4, ["seen"])


def test_sweeps_of_another_form_are_told(tmp_path: Path) -> None:
    scans: list[Message] = [Scan(1, -1.0, 0.5, np.ones(rays, np.float32)) for rays in (3, 4, 3, 3)]
    exported = export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3), pixels(PixelFormat.GREY8), *scans]), tmp_path / "p")
    assert exported.notes == ["scans.csv: 1 sweeps of another form than the first are left out"]


def test_a_recording_that_no_import_would_take_is_exported_and_says_so(tmp_path: Path) -> None:
    exported = export(written(tmp_path / "a.mcap", [pixels(PixelFormat.GREY8)]), tmp_path / "plain")
    assert exported.notes == ["omnivert import frames will refuse the folder: encoders.csv: holds no rows"]


@pytest.mark.parametrize("name", ["../evil", "/etc/evil", "frames.csv", "frames/000000.png", "truth/../../evil", ""])
def test_what_it_carries_leaves_no_folder_and_overwrites_nothing(tmp_path: Path, name: str) -> None:
    recording = written(tmp_path / "a.mcap", [Ticks(1, 2, 3), pixels(PixelFormat.GREY8)], {name: b"evil", "ok": b"1"})
    exported = export(recording, tmp_path / "plain")
    assert exported.notes == [f"{name!r}, a file that it carries, has no place in the folder"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "plain"]
    assert (tmp_path / "plain" / "ok").read_bytes() == b"1"
    assert b"evil" not in (tmp_path / "plain" / "frames.csv").read_bytes()


def test_what_fails_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = written(tmp_path / "a.mcap", [Ticks(1, 2, 3), pixels(PixelFormat.GREY8)])
    with pytest.raises(DataError, match="cannot write"):
        export(recording, tmp_path / "nowhere" / "plain")

    def full(path: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(DataError, match="No space left") as refused:
        export(recording, tmp_path / "plain")
    assert refused.value.code == "OV313"
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_recording_without_images_and_bearings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="neither images nor bearings") as refused:
        export(written(tmp_path / "a.mcap", [Ticks(1, 2, 3)]), tmp_path / "plain")
    assert refused.value.code == "OV313"
