"""Messages that are missing: the cable is blamed for none that the bridge or the bus has lost, and for all others."""

from dataclasses import replace

import numpy as np
import pytest

from omnivert.doctor import about_streams
from omnivert.doctor.evidence import Evidence, OnBus, Seen, Service
from omnivert.doctor.finding import Finding, Status
from omnivert.doctor.stream import Stream
from omnivert.messages import Health
from tests.doctor.conftest import Told

S = 10**9
DISPLACED = "camera: frame displaced by a newer one"
WAITED = "encoder: waited too long to be stamped"


def heard(seconds: float, rate_hz: float, every: int = 10**9, lost: int = 0) -> Stream:
    """Messages at this rate, of which every so many-th is missing."""
    numbers = np.arange(round(seconds * rate_hz))
    stamps = (numbers[numbers % every != every - 1] * (S / rate_hz)).astype(np.int64)
    return Stream(stamps, stamps + S // 100, lost)


def bridge(before: dict[str, int], now: dict[str, int]) -> OnBus:
    first, newest = (Health(1, "bridge", "front", 1.0, refused=refused) for refused in (before, now))
    return OnBus(services=(Service("bridge", "front", True, first, newest),), seconds=10.0)


def frames(corridor: Told, stream: Stream, bus: OnBus, expected_hz: float = 15.0) -> Finding:
    evidence = corridor.set("camera", frame_rate_hz=expected_hz).evidence
    return about_streams.frames(live(evidence, replace(evidence.seen, frames=stream), bus))


def ticks(corridor: Told, stream: Stream, bus: OnBus, blind_s: float = 0.0) -> Finding:
    evidence = corridor.evidence
    seen = replace(evidence.seen, frames=heard(10.0, 15.0), ticks=stream, blind_s=blind_s)
    return about_streams.ticks(live(evidence, seen, bus))


def live(evidence: Evidence, seen: Seen, bus: OnBus) -> Evidence:
    return replace(evidence, recording=False, seen=seen, bus=bus)


def test_frames_that_never_came_to_the_bridge_are_the_cables(corridor: Told) -> None:
    for bus in (bridge({}, {}), bridge({DISPLACED: 40}, {DISPLACED: 40}), bridge({}, {DISPLACED: 1})):
        found = frames(corridor, heard(10.0, 15.0, every=5), bus)
        assert (found.status, "cable" in found.help) == (Status.WORSE, True), found


@pytest.mark.parametrize("rate", ["a few missing", "every second one missing"])
def test_frames_that_were_displaced_in_the_bridge_are_not(corridor: Told, rate: str) -> None:
    """Where every second one is missing, the others have a rhythm of their own: only the configured rate tells."""
    stream = heard(10.0, 15.0, every=5) if rate == "a few missing" else heard(10.0, 7.5)
    gone = 150 - stream.count
    found = frames(corridor, stream, bridge({DISPLACED: 40}, {DISPLACED: 40 + gone}))
    assert found.status is Status.WORSE
    assert f"the bridge had no time for {gone} of them" in found.reason
    assert "this machine less to do" in found.help
    assert not {"cable", "light"} & set(f"{found.reason} {found.help}".split())


def test_frames_that_were_lost_behind_the_bridge_are_of_the_way_from_it(corridor: Told) -> None:
    found = frames(corridor, heard(10.0, 15.0, every=5, lost=30), bridge({}, {DISPLACED: 2}))
    assert "30 were lost on the way" in found.reason
    assert "cable" not in found.help
    far = replace(bridge({}, {}), is_here=False)
    assert "omnivert doctor there" in frames(corridor, heard(10.0, 15.0, every=5, lost=30), far).help


def test_wheel_counts_that_waited_too_long_in_the_port_are_not_the_cables(corridor: Told) -> None:
    gap = heard(10.0, 50.0)
    stream = replace(gap, stamp_ns=np.delete(gap.stamp_ns, slice(100, 150)), sent_ns=np.delete(gap.sent_ns, slice(50)))
    waited = ticks(corridor, stream, bridge({}, {WAITED: 50}), blind_s=1.0)
    assert "the bridge had no time for 50 of them" in waited.reason
    assert "cable" not in waited.help
    cut = ticks(corridor, stream, bridge({}, {"encoder: line cut off": 50}), blind_s=1.0)
    assert "cable" in cut.help
    lost = ticks(corridor, replace(stream, lost=50), bridge({}, {}), blind_s=1.0)
    assert "50 were lost on the way" in lost.reason


def test_what_nothing_is_missing_of_blames_nobody(corridor: Told) -> None:
    bus = bridge({}, {DISPLACED: 3, WAITED: 3})
    assert frames(corridor, heard(10.0, 15.0), bus).status is Status.FINE
    assert ticks(corridor, heard(10.0, 50.0), bus).status is Status.FINE
