"""What the counts of a health message are called."""

import numpy as np
import pytest

from omnivert.config import Timeline as Settings
from omnivert.messages import Bearings, Ticks
from omnivert.pictures.notes import counted_reasons
from omnivert.timeline import Timeline

MS = 10**6


def lines(stamp_ms: int) -> Bearings:
    none = np.zeros(0)
    return Bearings(stamp_ms * MS, none.astype(np.int64), none, none, none.astype(np.int32), none.astype(np.float32))


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        ({}, ""),
        ({"Bearings: not waited for": 12}, "12 late, not waited for: Bearings"),
        ({"Bearings: came too late": 3}, "3 too late, left out: Bearings"),
        ({"v1/vision/front/bearings: no envelope": 1}, "1 refused: v1/vision/front/bearings: no envelope"),
        ({"Bearings: not waited for": 12, "Ticks: repeated": 2}, "2 refused: Ticks: repeated"),
        ({"Bearings: not waited for": 12, "Ticks: came too late": 20}, "20 too late, left out: Ticks"),
    ],
)
def test_late_is_told_apart_from_refused_and_gives_way_to_it(refused: dict[str, int], said: str) -> None:
    assert counted_reasons(refused) == said


def test_bearings_that_a_timeline_did_not_wait_for_are_called_late() -> None:
    timeline = Timeline((Ticks, Bearings), Settings(lateness_s=0.25))
    for stamp_ms in (0, 10):
        timeline.push(lines(stamp_ms), False)
    for stamp_ms in range(0, 2000, 20):
        timeline.push(Ticks(stamp_ms * MS, 0, 0), False)
    timeline.push(lines(1000), False)
    assert counted_reasons(timeline.refused) == "1 too late, left out: Bearings"
