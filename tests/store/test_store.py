"""The store: what was acknowledged is there, what was good is never lost, and what cannot be done is said."""

import os
import random
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Store, StoreError
from tests.processes import own

NOBODY = 65534

covariances = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9).map(
    lambda roots: np.reshape(roots, (3, 3)) @ np.reshape(roots, (3, 3)).T
)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
mounts = st.builds(Mount, st.floats(-3.1, 3.1), st.floats(0.0, 2.0), st.floats(-3.1, 3.1), covariances)
any_extrinsics = st.builds(
    Extrinsics,
    stamp_ns=st.integers(0, 2**62),
    robot=st.just("demo"),
    camera=st.sampled_from(("front", "back")),
    mount=mounts,
    state=st.sampled_from(State),
    frames=st.integers(0, 2**62),
    reasons=st.lists(texts, max_size=3).map(tuple),
    software=texts,
    rig_digest=texts,
)


def extrinsics(stamp_ns: int = 1, phi: float = 0.5, camera: str = "front") -> Extrinsics:
    mount = Mount(phi, 0.1, -0.25, np.diag([1e-4, 1e-6, 1e-4]))
    return Extrinsics(stamp_ns, "demo", camera, mount, State.CALIBRATED, 99, ("why",), "omnivert 0.1.0", "0123abcd")


def same(one: Extrinsics, other: Extrinsics) -> bool:
    def flat(extrinsics: Extrinsics) -> tuple[object, ...]:
        mount = extrinsics.mount
        rest = (getattr(extrinsics, field.name) for field in fields(Extrinsics) if field.name != "mount")
        return (mount.phi_rad, mount.rho_m, mount.psi_rad, *mount.covariance.ravel().tolist(), *rest)

    return flat(one) == flat(other)


@settings(max_examples=25)
@given(given=st.lists(any_extrinsics, min_size=1, max_size=5))
def test_what_is_put_comes_back_to_the_last_bit(given: list[Extrinsics]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        with Store(Path(folder) / "x.db") as store:
            entries = [store.put(one) for one in given]
        with Store(Path(folder) / "x.db") as store:
            by_number = {entry.entry: entry.extrinsics for entry in store.entries()}
            assert all(same(by_number[entry], one) for entry, one in zip(entries, given, strict=True))
            latest = store.latest("demo", given[-1].camera)
            assert latest is not None
            assert same(latest.extrinsics, given[-1])


def test_the_latest_of_each_camera_and_the_history_newest_first(tmp_path: Path) -> None:
    store = Store(tmp_path / "x.db")
    assert store.latest("demo", "front") is None
    for stamp, camera in ((5, "front"), (3, "front"), (9, "back")):
        store.put(extrinsics(stamp, camera=camera))
    assert [entry.extrinsics.stamp_ns for entry in store.history("demo", "front")] == [3, 5]
    assert [entry.extrinsics.stamp_ns for entry in store.history("demo", "front", limit=1)] == [3]
    assert [entry.extrinsics.camera for entry in store.newest()] == ["back", "front"]
    assert store.latest("other", "front") is None


def test_the_same_extrinsics_again_keep_their_number_and_are_the_latest_again(tmp_path: Path) -> None:
    store = Store(tmp_path / "x.db")
    first, second = store.put(extrinsics(1)), store.put(extrinsics(2))
    assert store.put(extrinsics(1)) == first != second
    assert [entry.entry for entry in store.history("demo", "front")] == [first, second]
    assert len(store.entries()) == 2


def test_another_result_of_the_same_stamp_is_another_entry(tmp_path: Path) -> None:
    store = Store(tmp_path / "x.db")
    assert store.put(extrinsics(1, phi=0.5)) != store.put(extrinsics(1, phi=0.6))
    assert len(store.entries()) == 2


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    store = Store(tmp_path / "x.db")
    with pytest.raises(ValueError):
        store.put(extrinsics(phi=float("nan")))
    assert store.entries() == []


def test_every_commit_waits_for_the_disk(tmp_path: Path) -> None:
    store = Store(tmp_path / "x.db")
    assert store._connection.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL
    assert store._connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)


WRITER = """
import sys
from dataclasses import fields, replace
from pathlib import Path
import numpy as np
from omnivert.messages import Extrinsics, Mount, State
from omnivert.store import Store
mount = Mount(0.5, 0.1, -0.25, np.diag([1e-4, 1e-6, 1e-4]))
one = Extrinsics(0, "demo", "front", mount, State.CALIBRATED, 99, (), "omnivert 0.1.0", "x")
store = Store(Path(sys.argv[1]))
for stamp in range(int(sys.argv[2]), 10**9):
    print(store.put(replace(one, stamp_ns=stamp)), stamp, flush=True)
"""


def test_a_kill_during_writing_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    path, rng, acknowledged, begin = tmp_path / "x.db", random.Random(7), dict[int, int](), 0
    for _ in range(4):
        command = [sys.executable, "-c", WRITER, str(path), str(begin)]
        with own(subprocess.Popen(command, stdout=subprocess.PIPE, text=True)) as writer:
            assert writer.stdout is not None
            for _ in range(rng.randint(1, 40)):
                entry, stamp = map(int, writer.stdout.readline().split())
                acknowledged[entry] = stamp
            writer.kill()
            for line in writer.stdout:
                if line.endswith("\n"):
                    entry, stamp = map(int, line.split())
                    acknowledged[entry] = stamp
        begin = max(acknowledged.values()) + 2  # the one after the last may have been stored without an answer
        with Store(path) as store:
            assert store.set_aside is None
            there = {entry.entry: entry.extrinsics.stamp_ns for entry in store.entries()}
            assert acknowledged.items() <= there.items()
            assert len(there) <= len(acknowledged) + 4


def test_threads_and_processes_may_write_at_once(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with Store(path) as one, Store(path) as other, ThreadPoolExecutor(4) as pool:
        stores = [one, other] * 20
        entries = list(pool.map(lambda k: stores[k].put(extrinsics(stamp_ns=k)), range(40)))
        assert sorted(entries) == list(range(1, 41))
        assert len(one.entries()) == 40


def test_a_locked_file_is_waited_for_and_then_named(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    store = Store(path, locked_s=0.05)
    store.put(extrinsics(1))
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StoreError, match="locked") as refusal:
        store.put(extrinsics(2))
    assert refusal.value.code == "OV601"
    assert [entry.extrinsics.stamp_ns for entry in store.entries()] == [1]  # reading goes on
    other.execute("COMMIT")
    other.close()
    assert store.put(extrinsics(2)) == 2


def test_a_file_locked_from_the_start_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    Store(path).close()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("PRAGMA locking_mode = EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    with pytest.raises(StoreError) as refusal:
        Store(path, locked_s=0.05)
    assert refusal.value.code == "OV601"
    other.close()


@pytest.mark.parametrize("damage", ["garbage", "header", "middle"])
def test_a_damaged_file_is_kept_under_another_name_and_a_new_one_begun(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "x.db"
    with Store(path) as store:
        for stamp in range(200):
            store.put(extrinsics(stamp))
    bad = bytearray(path.read_bytes())
    match damage:
        case "garbage":
            bad = bytearray(random.Random(1).randbytes(5000))
        case "header":
            bad[:16] = b"SQLite format 2\0"
        case "middle":
            bad[4096 + 8 : -100] = random.Random(2).randbytes(len(bad) - 4096 - 108)
    path.write_bytes(bad)
    for number in range(2):
        path.write_bytes(bad)
        with Store(path) as store:
            assert store.set_aside is not None
            assert store.set_aside.read_bytes() == bytes(bad)
            assert store.put(extrinsics(1)) == 1
        assert len(list(tmp_path.glob("x.db.damaged-*"))) == number + 1
    with Store(path) as store:
        assert store.set_aside is None
        assert len(store.entries()) == 1


def test_two_processes_that_find_the_damage_set_it_aside_once(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    path.write_bytes(b"no data base" * 1000)
    with ThreadPoolExecutor(4) as pool:
        stores = list(pool.map(lambda _: Store(path), range(4)))
    assert [store.put(extrinsics(k)) for k, store in enumerate(stores)] == [1, 2, 3, 4]
    assert len(list(tmp_path.glob("x.db.damaged-*"))) == 1
    assert sum(store.set_aside is not None for store in stores) == 1


def test_a_newer_schema_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with Store(path) as store:
        store._connection.execute("PRAGMA user_version = 2")
    before = path.read_bytes()
    with pytest.raises(StoreError, match="schema 2") as refusal:
        Store(path)
    assert refusal.value.code == "OV604"
    assert path.read_bytes() == before


def test_the_data_base_of_another_program_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE extrinsics (mine)")
    other.commit()
    other.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match="another program"):
        Store(path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["x.db"]


def test_a_file_that_was_taken_away_acknowledges_nothing_more(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    store = Store(path)
    store.put(extrinsics(1))
    path.rename(tmp_path / "moved.db")
    with pytest.raises(StoreError) as refusal:
        store.put(extrinsics(2))
    assert refusal.value.code == "OV606"


@pytest.fixture
def unwritable() -> Iterator[Path]:
    """A folder that this process may read and not write, whoever runs the tests."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        Store(folder / "x.db").close()
        (folder / "x.db").chmod(0o444)
        folder.chmod(0o555)
        user = os.geteuid()
        if user == 0:
            os.seteuid(NOBODY)
        try:
            yield folder
        finally:
            os.seteuid(user)
            folder.chmod(0o755)


def test_a_folder_that_cannot_be_written_is_named_with_the_cure(unwritable: Path) -> None:
    for name in ("x.db", "new.db"):
        with pytest.raises(StoreError) as refusal:
            Store(unwritable / name)
        assert refusal.value.code == "OV602"
        assert "storage.path" in refusal.value.help
    with Store(unwritable / "x.db", writable=False) as store:
        assert store.entries() == []


def test_what_is_wrong_with_a_damaged_file_is_said_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with Store(path) as store:
        for stamp in range(200):
            store.put(extrinsics(stamp))
    bad = bytearray(path.read_bytes())
    bad[2 * 4096 : 3 * 4096] = bytes(4096)
    path.write_bytes(bad)
    with pytest.raises(StoreError) as refusal:
        Store(path, writable=False)
    assert refusal.value.code == "OV603"
    assert "\n" not in str(refusal.value)
    assert "***" not in str(refusal.value)
    assert "page 3" in str(refusal.value).lower()


def test_what_was_taken_away_is_not_told_as_stored(tmp_path: Path) -> None:
    with Store(tmp_path / "x.db") as store:
        store.put(extrinsics(1))
        (tmp_path / "x.db").rename(tmp_path / "moved.db")
        with pytest.raises(StoreError) as refusal:
            store.latest("demo", "front")
    assert refusal.value.code == "OV606"


@pytest.mark.parametrize("name", ["", "folder"])
def test_a_folder_in_place_of_the_file_is_named(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(StoreError, match="it is a folder") as refusal:
        Store(Path(name))
    assert "storage.path" in refusal.value.help


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no folder"):
        Store(tmp_path / "nowhere" / "x.db")


def test_reading_creates_nothing(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="nothing was saved there yet"):
        Store(tmp_path / "x.db", writable=False)
    (tmp_path / "bad.db").write_bytes(b"bad" * 1000)
    with pytest.raises(StoreError) as refusal:
        Store(tmp_path / "bad.db", writable=False)
    assert refusal.value.code == "OV603"
    assert [file.name for file in tmp_path.iterdir()] == ["bad.db"]


def test_a_reader_sees_what_a_writer_has_just_put(tmp_path: Path) -> None:
    with Store(tmp_path / "x.db") as writer, Store(tmp_path / "x.db", writable=False) as reader:
        writer.put(extrinsics(1))
        assert len(reader.entries()) == 1
        with pytest.raises(StoreError):
            reader.put(extrinsics(2))


# ------------------------------------------------------------------ playbacks


@given(puts=st.lists(st.tuples(st.integers(1, 6), st.booleans()), min_size=1, max_size=12))
@settings(max_examples=40, deadline=None)
def test_no_playback_ever_stands_before_what_the_robot_gave(puts: list[tuple[int, bool]]) -> None:
    """Beside the store runs a model: two lists, in each of which what was put last stands first."""
    live: list[int] = []
    replayed: list[int] = []
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder) / "x.db") as store:
        for stamp_ns, is_replay in puts:
            store.put(extrinsics(stamp_ns), is_replay)
            if not is_replay:
                replayed = [stamp for stamp in replayed if stamp != stamp_ns]
                live = [stamp_ns, *(stamp for stamp in live if stamp != stamp_ns)]
            elif stamp_ns not in live:
                replayed = [stamp_ns, *(stamp for stamp in replayed if stamp != stamp_ns)]
            latest = store.latest("demo", "front")
            assert latest is not None
            assert latest.replayed == (not live)
            found = [(entry.extrinsics.stamp_ns, entry.replayed) for entry in store.history("demo", "front")]
            assert found == [(stamp, False) for stamp in live] + [(stamp, True) for stamp in replayed]
            assert [entry.extrinsics.stamp_ns for entry in store.newest()] == [(live + replayed)[0]]
