"""The recorder: all that comes is written, in files no larger or longer than asked for, and what is lost is counted."""

import json
import resource
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from omnivert.config import Config, parsed
from omnivert.messages import Frame, Health, Message, PixelFormat, Ticks
from omnivert.wire.bus import Bus, Router
from omnivert.wire.channels import FRAME, HEALTH, TICKS
from omnivert.wire.codec import encode
from omnivert.wire.received import Received
from omnivert.wire.recording import Recording
from services import recorder
from services._parts import Parts
from services.recorder import Recorded, _Numbers

DEADLINE_S = 30.0
MS = 1_000_000
SECOND = 1000 * MS
KEYS = {Ticks: "v1/encoder/base/ticks", Frame: "v1/camera/front/frame", Health: "v1/vision/front/health"}


def limited(mb: float = 0.0, s: float = 0.0, compression: str = "none", **more: Any) -> Config:
    table = {"split_mb": mb, "split_s": s, "compression": compression}
    return parsed({"recorder": table, **more}, "the test")


def written(folder: Path, config: Config, messages: list[Message]) -> list[Path]:
    with Parts(folder / "drive.mcap", config) as parts:
        for message in messages:
            parts.put(KEYS[type(message)], message, encode(message))
    return parts.paths


def held(paths: list[Path], *names: str) -> list[bytes]:
    return [entry.data for path in paths for entry in Recording(path).entries(names or None)]


def drive(sizes: list[int]) -> list[Message]:
    noise = np.random.default_rng(1)
    frames = [noise.integers(0, 256, size, dtype=np.uint8) for size in sizes]
    return [
        message
        for i, data in enumerate(frames)
        for message in (Ticks(2 * i * MS, i, i), Frame((2 * i + 1) * MS, PixelFormat.JPEG, 64, 48, data))
    ]


# ------------------------------------------------------------------ parts


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    sizes=st.lists(st.integers(1, 40_000), min_size=1, max_size=40),
    mb=st.floats(0.05, 0.5),
    compression=st.sampled_from(["none", "lz4", "zstd"]),
)
def test_parts_are_no_larger_than_asked_for_and_hold_all(
    tmp_path_factory: pytest.TempPathFactory, sizes: Any, mb: Any, compression: Any
) -> None:
    folder, messages = tmp_path_factory.mktemp("parts"), drive(sizes)
    paths = written(folder, limited(mb, compression=compression), messages)
    assert sorted(folder.iterdir()) == paths
    assert held(paths) == [encode(message) for message in messages]
    assert max(path.stat().st_size for path in paths) <= 1e6 * mb
    assert len(paths) <= 1 + 2 * (sum(sizes) + 300 * len(messages)) / max(1e6 * mb - 45_000, 5000)


@pytest.mark.parametrize("seconds", [1.0, 2.5, 100.0])
def test_parts_last_no_longer_than_asked_for(tmp_path: Path, seconds: float) -> None:
    messages: list[Message] = [Ticks(50 * SECOND + i * 100 * MS, i, i) for i in range(95)]
    messages.insert(40, Health(7, "vision", "front", 1.0))
    paths = written(tmp_path, limited(s=seconds), messages)
    assert held(paths) == [encode(message) for message in messages]
    assert len(paths) == -(-9.5 // seconds)
    for path in paths:
        recording = Recording(path)
        assert recording.end_ns - recording.start_ns < seconds * SECOND
        assert recording.config(Config()).rig() == Config().rig()


def test_parts_of_a_recorder_that_comes_back_stand_behind_the_earlier_ones(tmp_path: Path) -> None:
    messages: list[Message] = [Ticks(i * 500 * MS, i, i) for i in range(4)]
    for _ in range(2):
        written(tmp_path, limited(s=1.0), messages)
    assert [path.name for path in sorted(tmp_path.iterdir())] == [f"drive-00{n}.mcap" for n in range(1, 5)]
    assert [path.name for path in written(tmp_path, limited(), messages)] == ["drive.mcap"]


def test_parts_that_are_taken_away_meanwhile_end_nothing_and_still_count(tmp_path: Path) -> None:
    messages: list[Message] = [Ticks(i * 100 * MS, i, i) for i in range(60)]
    taken = tmp_path / "taken"
    taken.mkdir()
    with Parts(tmp_path / "drive.mcap", limited(s=1.0)) as parts:
        for message in messages:
            for path in parts.paths[:-1]:
                if path.exists():
                    path.rename(taken / path.name)
            parts.put(KEYS[Ticks], message, encode(message))
            parts.flush()
            assert parts.size > 0
    assert len(parts.paths) == 6
    whole = [*sorted(taken.iterdir()), parts.paths[-1]]
    assert held(whole) == [encode(message) for message in messages]
    assert parts.size == sum(path.stat().st_size for path in whole)


def test_a_file_that_is_moved_goes_on_and_one_that_is_deleted_ends_the_recording(tmp_path: Path) -> None:
    with Parts(tmp_path / "drive.mcap", limited()) as parts:
        parts.put(KEYS[Ticks], Ticks(0, 0, 0), encode(Ticks(0, 0, 0)))
        parts.paths[0].rename(tmp_path / "other.mcap")
        parts.flush()
        parts.put(KEYS[Ticks], Ticks(MS, 1, 1), encode(Ticks(MS, 1, 1)))
    assert Recording(tmp_path / "other.mcap").counts == {KEYS[Ticks]: 2}
    with Parts(tmp_path / "drive.mcap", limited()) as parts:
        parts.put(KEYS[Ticks], Ticks(0, 0, 0), encode(Ticks(0, 0, 0)))
        parts.paths[0].unlink()
        with pytest.raises(OSError, match="deleted"):
            parts.flush()
    assert not (tmp_path / "drive.mcap").exists()


# ------------------------------------------------------------------ what is lost


@given(st.lists(st.integers(0, 60), unique=True, min_size=1, max_size=40).map(sorted), st.sampled_from(["one", "two"]))
def test_what_did_not_come_is_counted_by_the_numbers(sequence: Any, publishers: Any) -> None:
    numbers, missing = _Numbers(), 0
    one = Received(TICKS, "k", Ticks(0, 0, 0), 0, False, b"a", b"a", 0)
    for number in sequence:
        missing += numbers.missing_before(replace(one, sequence=number))
        if publishers == "two":
            missing += numbers.missing_before(replace(one, sequence=number, publisher=b"b"))
    assert missing == (1 + (publishers == "two")) * (sequence[-1] - sequence[0] + 1 - len(sequence))


def test_a_number_that_is_out_of_all_reason_tells_of_no_loss() -> None:
    numbers, one = _Numbers(), Received(TICKS, "k", Ticks(0, 0, 0), 0, False, b"a", b"a", 0)
    assert [numbers.missing_before(replace(one, sequence=n)) for n in (3, 2**64 - 1, 5, 6)] == [0, 0, 1, 0]


class Disk:
    """Stands before `Parts.put`: counts what has been written of sensors, and takes nothing while it is slow."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._put, self._changed = Parts.put, threading.Condition()
        self.offered, self.slow = 0, False
        self.written: list[Message] = []
        monkeypatch.setattr(Parts, "put", lambda *given: self._take(*given))

    def _take(self, parts: Parts, key: str, message: Message, data: bytes) -> None:
        with self._changed:
            self.offered += isinstance(message, Frame | Ticks)
            self._changed.notify_all()
            assert self._changed.wait_for(lambda: not self.slow, DEADLINE_S)
            self._put(parts, key, message, data)
            self.written += [message] * isinstance(message, Frame | Ticks)
            self._changed.notify_all()

    def await_until(self, holds: Callable[[], bool], slow: bool = False) -> None:
        with self._changed:
            self.slow = slow
            self._changed.notify_all()
            assert self._changed.wait_for(holds, DEADLINE_S)


@contextmanager
def recording(config: Config, path: Path) -> Iterator[tuple[Bus, list[Recorded]]]:
    """A bridge, and a recorder in a thread; what it has written stands in the list when it has ended."""
    done: list[Recorded] = []
    with Router(config), Bus(config, "bridge", "front") as bridge, Bus(config, "recorder", "test") as bus:
        thread = threading.Thread(target=lambda: done.append(recorder.run(bus, config, path)))
        thread.start()
        try:
            assert bridge.await_presence(lambda: ("recorder", "test") in bridge.present(), DEADLINE_S)
            yield bridge, done
        finally:
            bus.stop()
            thread.join(DEADLINE_S)
            assert not thread.is_alive()


def test_everything_that_was_sent_is_in_the_file_as_it_was_sent(
    config: Config, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One by one: of a burst a busy link may drop some, and ticks may overtake a frame."""
    disk, sent = Disk(monkeypatch), list[Message]()
    with recording(config, folder / "a.mcap") as (bridge, done):
        for message in (*drive([307_200] * 20), Ticks(SECOND, 99, 99)):
            bridge.publish(FRAME if isinstance(message, Frame) else TICKS, message)
            sent.append(message)
            disk.await_until(lambda: len(disk.written) == len(sent))
    assert held([folder / "a.mcap"], "Frame", "Ticks") == list(map(encode, sent))
    assert (done[0].lost, dict(done[0].messages)) == (0, {"frame": 20, "ticks": 21})
    assert done[0].bytes == (folder / "a.mcap").stat().st_size


def test_a_slow_disk_blocks_no_publisher_and_what_it_costs_is_counted(
    config: Config, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, sent = Disk(monkeypatch), 300
    small = config.model_copy(update={"bus": config.bus.model_copy(update={"queue_messages": 16})})
    disk.slow = True
    with recording(small, folder / "a.mcap") as (bridge, done):
        bridge.publish(TICKS, Ticks(0, 0, 0))
        disk.await_until(lambda: disk.offered == 1, slow=True)
        for number in range(1, sent):
            bridge.publish(TICKS, Ticks(number * MS, number, 0))
        await_heard(bridge, sent)  # all of it, and the disk has not taken one yet
        disk.await_until(lambda: any(message.stamp_ns == (sent - 1) * MS for message in disk.written))
    kept = [m.left for _, m in Recording(folder / "a.mcap").messages((Ticks,)) if isinstance(m, Ticks)]
    assert kept == [0, *range(sent - len(kept) + 1, sent)]
    assert 1 < len(kept) <= 17
    assert done[0].lost == sent - len(kept)


def await_heard(bridge: Bus, count: int) -> None:
    """Until the recorder's health says that so many ticks have come to it."""
    for received in bridge.listen(HEALTH, period_s=DEADLINE_S):
        assert received is not None
        health = received.message
        if isinstance(health, Health) and health.service == "recorder" and health.received.get(KEYS[Ticks]) == count:
            return


# ------------------------------------------------------------------ a full disk


def test_a_process_whose_disk_is_full_says_so_and_leaves_a_good_file(config: Config, folder: Path) -> None:
    room = 500_000
    (folder / "config.json").write_text(json.dumps(config.model_dump(mode="json")))
    command = [sys.executable, "-P", "-m", "services.recorder", "--config", str(folder / "config.json")]
    with (
        Router(config),
        Bus(config, "bridge", "front") as bridge,
        subprocess.Popen(
            [*command, "--output", str(folder / "a.mcap")],
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        ) as process,
    ):
        assert bridge.await_presence(lambda: ("recorder", "front") in bridge.present(), DEADLINE_S)
        sent = [replace(message, stamp_ns=100 * message.stamp_ns) for message in drive([50_000] * 40)]
        ticks, frames = ([m for m in sent if isinstance(m, kind)] for kind in (Ticks, Frame))
        for message in ticks:
            bridge.publish(TICKS, message)
        await_heard(bridge, len(ticks))  # before the disk is full: frames may overtake them
        for message in frames:  # a chunk every five
            bridge.publish(FRAME, message)
        told = process.communicate(timeout=DEADLINE_S)[1]
    assert "error[OV304]: " in told
    assert "cannot be written any further" in told
    assert "what was recorded before is good" in told
    recording = Recording(folder / "a.mcap")
    assert recording.cut == ""
    assert 200_000 < (folder / "a.mcap").stat().st_size <= room
    numbers = [m.left for _, m in recording.messages((Ticks,)) if isinstance(m, Ticks)]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= 5
    kept = [encode(m) for _, m in recording.messages((Frame,))]
    assert len(kept) >= 4
    assert kept == [encode(m) for m in frames if encode(m) in kept]
