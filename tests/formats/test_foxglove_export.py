"""Files for Foxglove, read back by the schemas that they carry themselves."""

import json
import math
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from omnivert.config import Config, with_rig
from omnivert.errors import DataError, UseError
from omnivert.formats.foxglove.export import export_foxglove, layout_path
from omnivert.formats.foxglove.lines import FOLLOWED, MOVING, NEW, drawn
from omnivert.formats.foxglove.series import BEARINGS, ESTIMATE, TICKS
from omnivert.messages import (
    Bearings,
    Correction,
    Estimate,
    Frame,
    Looks,
    MeetingPoint,
    Message,
    Mount,
    ParameterVerdict,
    PixelFormat,
    Ring,
    Scan,
    State,
    Ticks,
)

PROJECT = Path(__file__).resolve().parents[2]
RIG = with_rig(Config(), {"camera": {"id": "rear", "bearing_sign": -1}, "ring": {"r_min_px": 60.0}}, "test")
PIXELS = np.random.default_rng(2).integers(0, 256, (480, 640), np.uint8)
SPREAD = np.diag([0.02**2, 0.004**2, 0.03**2])


def raw(stamp_ns: int, planes: int = 1) -> Frame:
    form = PixelFormat.GREY8 if planes == 1 else PixelFormat.BGR8
    return Frame(stamp_ns, form, 640, 480, np.tile(PIXELS[:, :, None], (1, 1, planes)).reshape(-1))


def compressed(stamp_ns: int, suffix: str = ".jpg") -> Frame:
    form = PixelFormat.JPEG if suffix == ".jpg" else PixelFormat.PNG
    return Frame(stamp_ns, form, 640, 480, cv2.imencode(suffix, PIXELS)[1].reshape(-1))


def bearings(stamp_ns: int, *angles: float, meeting: bool = False, moving: tuple[int, ...] = ()) -> Bearings:
    n = len(angles)
    looks = Looks(
        polarity=np.ones(n, np.int32),
        inner_px=np.linspace(70, 90, n).astype(np.float32),
        outer_px=np.linspace(200, 220, n).astype(np.float32),
        quality=np.ones(n, np.float32),
        moving=np.array([k in moving for k in range(n)], np.uint8),
    )
    return Bearings(
        stamp_ns,
        np.arange(10, 10 + n),
        np.array(angles, np.float64),
        np.full(n, 0.01),
        np.arange(n, dtype=np.int32) * 4,
        np.ones(n, np.float32),
        Ring(320.25, 240.5, 220.0, 0.9),
        ("dim",),
        MeetingPoint(318.0, 243.0, 0.5, used=meeting),
        looks,
    )


def estimate(stamp_ns: int, state: State, mount: Mount | None) -> Estimate:
    words = (ParameterVerdict(state), ParameterVerdict(State.USABLE), ParameterVerdict(State.NOT_YET, "turn"))
    more: dict[str, Any] = {"smoother": mount, "bound_std": None if mount is None else np.array([0.01, 0.001, 0.02])}
    noise = Correction("noise_k", 1e-4, 1e-5, True)
    return Estimate(
        stamp_ns, 3, mount, state, *words, "turn", 1.5, math.pi, 4, 5, 6, ("why",), corrections=(noise,), **more
    )


MOUNT = Mount(-0.34, 0.23, 0.33, SPREAD)
SWEEP = np.array([0.0, 1.5, 2.5, 0.0], np.float32)
DRIVE: list[Message] = [
    Ticks(1, 1000, -500),
    compressed(1_500_000_000),
    bearings(1_500_000_000, 0.5, -2.0, 3.1, moving=(2,)),
    estimate(1_500_000_000, State.NOT_YET, None),
    Scan(1_600_000_000, -1.0, 0.5, SWEEP),
    compressed(2_500_000_000, ".png"),
    estimate(2_500_000_000, State.CALIBRATED, MOUNT),
]


def exported(folder: Path, drive: list[Message] = DRIVE, **more: Any) -> dict[str, list[tuple[int, Any]]]:
    """topic -> stamp and content of its messages, by the schemas in the file."""
    export_foxglove(drive, RIG, folder / "out.mcap", **more)
    found = defaultdict(list)
    with (folder / "out.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            content = json.loads(message.data) if channel.message_encoding == "json" else None
            if content is None:
                content = DecoderFactory().decoder_for(channel.message_encoding, schema)(message.data)  # type: ignore[misc]
            found[channel.topic].append((message.log_time, content))
    return dict(found)


def stamp_ns(content: Any) -> int:
    return int(content.timestamp.seconds) * 10**9 + int(content.timestamp.nanos)


def test_every_stream_has_its_topic_and_its_stamps(tmp_path: Path) -> None:
    found = exported(tmp_path)
    assert {topic: [at for at, _ in messages] for topic, messages in found.items()} == {
        "/encoder/base/ticks": [1],
        "/camera/rear/image": [1_500_000_000, 2_500_000_000],
        "/vision/rear/lines": [1_500_000_000],
        "/vision/rear/bearings": [1_500_000_000],
        "/calibration/rear/estimate": [1_500_000_000, 2_500_000_000],
        "/laser/rear/scan": [1_600_000_000],
        "/tf": [2_500_000_000],
    }
    for topic in ("/camera/rear/image", "/vision/rear/lines", "/laser/rear/scan", "/tf"):
        assert all(stamp_ns(content) == at for at, content in found[topic])


def test_compressed_pictures_are_the_bytes_that_they_were(tmp_path: Path) -> None:
    (_, jpeg), (_, png) = exported(tmp_path)["/camera/rear/image"]
    assert (jpeg.format, png.format) == ("jpeg", "png")
    for picture, frame in ((jpeg, DRIVE[1]), (png, DRIVE[5])):
        assert isinstance(frame, Frame)
        assert picture.data == frame.data.tobytes()


@pytest.mark.parametrize(("planes", "encoding"), [(1, "mono8"), (3, "bgr8")])
def test_raw_pictures_are_the_pixels_that_they_were_and_are_shown(tmp_path: Path, planes: int, encoding: str) -> None:
    found = exported(tmp_path, [raw(7, planes), bearings(7, 0.1)])
    ((_, picture),) = found["/camera/rear/image_raw"]
    assert (picture.encoding, picture.width, picture.height, picture.step) == (encoding, 640, 480, 640 * planes)
    assert picture.data == raw(7, planes).data.tobytes()
    assert '"imageTopic":"/camera/rear/image_raw"' in layout_path(tmp_path / "out.mcap").read_text()


def test_ring_and_lines_are_drawn_over_the_picture(tmp_path: Path) -> None:
    ((_, over),) = exported(tmp_path)["/vision/rear/lines"]
    assert [(c.position.x, c.position.y, c.diameter) for c in over.circles] == [
        (320.75, 241.0, 120.0),
        (320.75, 241.0, 440.0),
    ]
    assert [text.text for text in over.texts] == ["10", "11", "12"]
    assert [(text.position.x, text.position.y) for text in over.texts] == [
        (p.points[1].x, p.points[1].y) for p in over.points
    ]
    assert all(line.type == 3 and line.thickness > 0 for line in over.points)  # a strip
    colours = [
        (round(p.outline_color.r, 2), round(p.outline_color.g, 2), round(p.outline_color.b, 2)) for p in over.points
    ]
    assert colours == [NEW, NEW, MOVING]


@settings(max_examples=40)
@given(
    angles=st.lists(st.floats(-3.1, 3.1), min_size=1, max_size=6), sign=st.sampled_from((1, -1)), meets=st.booleans()
)
def test_a_line_lies_at_its_image_angle_from_its_inner_to_its_outer_end(
    angles: list[float], sign: int, meets: bool
) -> None:
    seen = bearings(1, *angles, meeting=meets)
    assert seen.looks is not None
    _, strokes = drawn(seen, sign, 60.0)
    u, v = (318.5, 243.5) if meets else (320.75, 241.0)  # half a pixel on: Foxglove counts from the pixel's corner
    for k, stroke in enumerate(strokes):
        for end, radius in ((stroke.start, seen.looks.inner_px[k]), (stroke.end, seen.looks.outer_px[k])):
            right, up = end[0] - u, v - end[1]
            assert math.hypot(right, up) == pytest.approx(radius)
            assert math.remainder(math.atan2(up, right) - sign * angles[k], math.tau) == pytest.approx(0.0, abs=1e-9)


def test_lines_of_a_while_are_shown_as_followed_and_without_a_ring_none() -> None:
    seen = bearings(1, 0.1, 0.2, 0.3, 0.4)
    assert [stroke.colour for stroke in drawn(seen, 1, 60.0)[1]] == [NEW, NEW, FOLLOWED, FOLLOWED]
    blind = Bearings(1, *(np.zeros(0, kind) for kind in (int, float, float, np.int32, np.float32)))  # type: ignore[arg-type]
    assert drawn(blind, 1, 60.0) == ([], [])


def test_estimates_can_be_plotted_with_their_sigmas(tmp_path: Path) -> None:
    (_, first), (_, last) = exported(tmp_path)["/calibration/rear/estimate"]
    assert (first["state"], first["phi_deg"], first["smoother"], first["rho_best_m"]) == ("not_yet", None, None, None)
    assert (last["state"], last["phi_state"], last["psi_state"]) == ("calibrated", "calibrated", "not_yet")
    assert (last["phi_deg"], last["phi_sigma_deg"]) == pytest.approx((math.degrees(-0.34), math.degrees(0.02)))
    assert (last["rho_m"], last["rho_low_m"], last["rho_high_m"]) == pytest.approx((0.23, 0.226, 0.234))
    assert last["smoother"]["psi_sigma_deg"] == pytest.approx(math.degrees(0.03))
    assert (last["psi_best_deg"], last["turned_deg"]) == pytest.approx((math.degrees(0.02), 180.0))
    assert (last["reasons"], last["next_manoeuvre"], last["lines_rejected"]) == (["why"], "turn", 6)


def test_numbers_that_are_not_finite_are_null(tmp_path: Path) -> None:
    mount = Mount(0.1, 0.2, 0.3, np.diag([np.inf, 1.0, np.nan]))
    ((_, told),) = exported(tmp_path, [estimate(5, State.NOT_YET, mount)])["/calibration/rear/estimate"]
    assert (told["phi_sigma_deg"], told["phi_low_deg"], told["rho_sigma_m"]) == (None, None, 1.0)


def test_every_value_has_its_place_in_the_schema(tmp_path: Path) -> None:
    found = exported(tmp_path)
    for topic, schema in (
        ("/calibration/rear/estimate", ESTIMATE),
        ("/vision/rear/bearings", BEARINGS),
        ("/encoder/base/ticks", TICKS),
    ):
        assert all(content.keys() == schema["properties"].keys() for _, content in found[topic])
    ((_, seen),) = found["/vision/rear/bearings"]
    assert (seen["lines"], seen["moving"], seen["reasons"]) == (3, 1, ["dim"])
    assert seen["tracks"][1] == pytest.approx(
        {"id": 11, "bearing_deg": math.degrees(-2.0), "std_deg": math.degrees(0.01), "age_frames": 4, "moving": False}
    )
    ((_, ticks),) = found["/encoder/base/ticks"]
    assert ticks["left_m"] == pytest.approx(1000 * RIG.encoder.metres_per_tick)


def test_the_camera_is_a_frame_of_its_own_once_its_place_is_trusted(tmp_path: Path) -> None:
    ((_, link),) = exported(tmp_path)["/tf"]
    assert (link.parent_frame_id, link.child_frame_id) == ("base_link", "rear")
    assert (link.translation.x, link.translation.y) == pytest.approx((0.23 * math.cos(0.34), -0.23 * math.sin(0.34)))
    assert (link.rotation.z, link.rotation.w) == pytest.approx((math.sin(-0.005), math.cos(0.005)))


def test_scans_have_their_angles_and_no_echo_is_infinitely_far(tmp_path: Path) -> None:
    found = exported(tmp_path, laser=(0.1, 0.2, math.pi / 2))
    ((_, scan),) = found["/laser/rear/scan"]
    assert (scan.frame_id, scan.start_angle, scan.end_angle) == ("laser", -1.0, 0.5)
    assert list(scan.ranges) == [math.inf, 1.5, 2.5, math.inf]
    link = found["/tf"][0][1]
    assert (link.child_frame_id, link.translation.x, link.rotation.z) == pytest.approx(("laser", 0.1, math.sqrt(0.5)))


def test_the_layout_shows_topics_and_fields_that_are_there(tmp_path: Path) -> None:
    found = exported(tmp_path)
    text = layout_path(tmp_path / "out.mcap").read_text()
    paths = [value for value in strings(json.loads(text)) if value.startswith("/")]
    assert len(paths) > 12
    for path in paths:
        topic, _, name = path.partition(".")
        assert topic in found
        assert not name or name in found[topic][-1][1]


def strings(value: Any) -> list[str]:
    """Every text in a JSON value, keys too."""
    match value:
        case dict():
            return [*value, *(text for part in value.values() for text in strings(part))]
        case list():
            return [text for part in value for text in strings(part)]
        case str():
            return [value]
        case _:
            return []


def test_nothing_is_overwritten_and_nothing_half_written_is_left(tmp_path: Path) -> None:
    exported(tmp_path)
    for left in (tmp_path / "out.mcap", layout_path(tmp_path / "out.mcap")):
        with pytest.raises(UseError, match="exists already"):
            exported(tmp_path)
        left.unlink()
    with pytest.raises(DataError, match="nothing to put"):
        exported(tmp_path, [])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(DataError, match="cannot write"):
        export_foxglove(DRIVE, RIG, tmp_path / "nowhere" / "out.mcap")


def test_a_disk_that_is_full_ends_the_export_in_one_line(tmp_path: Path) -> None:
    """In a process of its own, whose files may not grow beyond 60 kB."""
    script = """
import resource, sys
from pathlib import Path
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.foxglove.export import export_foxglove
from tests.formats.test_foxglove_export import raw
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    export_foxglove((raw(k) for k in range(100)), Config(), Path(sys.argv[1]))
except DataError as error:
    print(error)
"""
    command = [sys.executable, "-c", script, str(tmp_path / "out.mcap")]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=PROJECT)
    assert (ran.stdout, ran.stderr) == (f"cannot write {tmp_path / 'out.mcap'}: File too large\n", "")
    assert list(tmp_path.iterdir()) == []
