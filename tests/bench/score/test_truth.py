"""The truth comes out of a recording as it was put in, and damage to it is said."""

from pathlib import Path

import numpy as np
import pytest

from omnivert.bench.score.truth import CENTERS, LINES, NONSTATIC, truth_of
from omnivert.cli.settings import recording_path
from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.messages import Ticks
from omnivert.wire.recording import Recording, RecordingWriter

HEADER = "index,line_id,bearing_rad,image_angle_rad,distance_m,visible_fraction,contrast\n"
ROWS = "2,7,0.5,-0.5,3.0,0.6,20\n0,7,0.25,-0.25,3.1,0.7,21\n0,8,-3.0,3.0,1.0,0.1,4\n"


def recording(path: Path, **tables: str) -> Recording:
    """A recording with one message and these attachments."""
    with RecordingWriter(path / "drive.mcap", Config()) as writer:
        writer.write("v1/encoder/base/ticks", Ticks(1, 0, 0))
        for name, text in tables.items():
            writer.attach({"lines": LINES, "nonstatic": NONSTATIC, "centers": CENTERS}[name], text.encode())
    return Recording(path / "drive.mcap")


def test_rows_go_to_their_frames_in_whatever_order_they_stand(tmp_path: Path) -> None:
    truths = truth_of(
        recording(
            tmp_path,
            lines=HEADER + ROWS,
            nonstatic=HEADER + "0,900000,1.5,0,1,0.5,9\n",
            centers="index,cu_px,cv_px\n2,320.5,240.25\n",
        )
    )
    assert truths is not None
    first, second, third = truths
    assert second is None
    assert first is not None
    assert third is not None
    assert first.line_id.tolist() == [7, 8]
    assert first.bearing_rad.tolist() == [0.25, -3.0]
    assert first.visible_fraction.tolist() == [0.7, 0.1]
    assert first.contrast.tolist() == [21.0, 4.0]
    assert first.neither_rad.tolist() == [1.5]
    assert first.center_px is None
    assert third.center_px == (320.5, 240.25)
    assert third.neither_rad.size == 0


def test_a_recording_without_truth_has_none(tmp_path: Path) -> None:
    assert truth_of(recording(tmp_path)) is None
    assert truth_of(recording(tmp_path, centers="index,cu_px,cv_px\n0,1,2\n")) is None


def test_a_world_where_nothing_moves_has_a_truth(tmp_path: Path) -> None:
    truths = truth_of(recording(tmp_path, lines=HEADER + ROWS, nonstatic=HEADER))
    assert truths is not None
    assert truths[0] is not None
    assert truths[0].neither_rad.size == 0


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n",
        HEADER,
        "index,line_id\n0,1\n",
        HEADER + "0,1,x,0,0,0,0\n",
        HEADER + "0,1,nan,0,0,0,0\n",
        HEADER + "0,1\n",
    ],
    ids=["empty", "blank", "no rows", "no column", "no number", "not finite", "short row"],
)
def test_a_damaged_truth_is_refused_by_name(tmp_path: Path, text: str) -> None:
    with pytest.raises(DataError, match=r"truth/lines\.csv") as refused:
        truth_of(recording(tmp_path, lines=text))
    assert refused.value.code == "OV306"


def test_the_packaged_drive_knows_all_its_lines() -> None:
    source = Recording(recording_path("corridor"))
    truths = truth_of(source)
    assert truths is not None
    assert len(truths) == 158
    known = [truth for truth in truths if truth is not None]
    assert len(known) == 158
    assert 200 < np.mean([truth.line_id.size for truth in known]) < 500
    assert all(np.unique(truth.line_id).size == truth.line_id.size for truth in known)
