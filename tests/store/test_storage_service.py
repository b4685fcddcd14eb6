"""The storage service on a real bus: receipts, answers, and troubles that it outlives."""

import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnivert.config import Config, parsed
from omnivert.messages import Extrinsics, Health, Message, Mount, Receipt, State
from omnivert.store import Store
from omnivert.wire.bus import Bus, Received, Router
from omnivert.wire.channels import EXTRINSICS, HEALTH, RECEIPT
from services import storage

MOUNT = Mount(-0.34, 0.23, 0.33, np.diag([1e-4, 1e-6, 1e-4]))
CLAIM = Extrinsics(5, "demo", "front", MOUNT, State.CALIBRATED, 99, (), "omnivert 0.1.0", Config().rig_digest())


@pytest.fixture
def config(tmp_path: Path) -> Config:
    bus = {"endpoint": f"unixsock-stream/{tmp_path / 'z.sock'}"}
    return parsed({"bus": bus, "storage": {"path": str(tmp_path / "x.db"), "locked_s": 0.05}}, "")


@contextmanager
def served(config: Config) -> Iterator[Bus]:
    """A router, the service, and another's door to the bus."""
    with Router(config), Bus(config, "storage", "front") as bus, Bus(config, "calibration", "front") as other:
        thread = threading.Thread(target=storage.run, args=(bus, config))
        thread.start()
        try:
            assert other.await_presence(lambda: ("storage", "front") in other.present(), 10.0)
            yield other
        finally:
            bus.stop()
            thread.join(10.0)
            assert not thread.is_alive()


def heard(
    stream: Iterator[Received | None], is_it: Callable[[Message], bool], again: Callable[[], None] = lambda: None
) -> Message:
    """The first message that is the one waited for; `again` says what leads to it as long as it is not there."""
    deadline = time.monotonic() + 20.0
    for received in stream:
        if received is None:
            again()
        if received is not None and is_it(received.message):
            return received.message
        assert time.monotonic() < deadline, "it has not come"
    raise AssertionError("the bus has stopped")


def stored(other: Bus, stream: Iterator[Received | None], claim: Extrinsics) -> Receipt:
    """Says the claim until it is acknowledged, as calibration does."""

    def say() -> None:
        other.publish(EXTRINSICS, claim)

    say()
    receipt = heard(stream, receipt_for(claim.stamp_ns), say)
    assert isinstance(receipt, Receipt)
    return receipt


def receipt_for(stamp_ns: int) -> Callable[[Message], bool]:
    return lambda message: isinstance(message, Receipt) and message.stamp_ns == stamp_ns


def health_with(text: str) -> Callable[[Message], bool]:
    def is_it(message: Message) -> bool:
        if not (isinstance(message, Health) and message.service == "storage"):
            return False
        return any(text in note for note in message.notes) or any(text in reason for reason in message.refused)

    return is_it


def test_a_claim_is_stored_and_then_acknowledged(config: Config) -> None:
    with served(config) as other:
        receipts = other.listen(RECEIPT, period_s=0.1)
        receipt = stored(other, receipts, CLAIM)
        with Store(config.storage.path, writable=False) as store:
            entry = store.latest("demo", "front")
        assert entry is not None
        assert (entry.entry, entry.extrinsics.stamp_ns) == (receipt.entry, 5)
        assert stored(other, receipts, CLAIM).entry == receipt.entry
        assert stored(other, receipts, replace(CLAIM, stamp_ns=6)).entry == receipt.entry + 1


def test_a_playback_supersedes_nothing_that_the_robot_itself_gave(config: Config) -> None:
    """Said again, too, and also where it was there before."""
    with served(config) as other:
        receipts = other.listen(RECEIPT, period_s=0.1)

        def played(stamp_ns: int) -> None:
            other.publish(EXTRINSICS, replace(CLAIM, stamp_ns=stamp_ns), replay=True)

        def latest() -> int:
            answer = other.ask(EXTRINSICS, timeout_s=5.0)
            assert isinstance(answer, Extrinsics)
            return answer.stamp_ns

        played(5)
        heard(receipts, receipt_for(5), lambda: played(5))
        assert latest() == 5
        stored(other, receipts, replace(CLAIM, stamp_ns=6))
        for stamp_ns in (7, 5):
            played(stamp_ns)
            heard(receipts, receipt_for(stamp_ns))
            assert latest() == 6


def test_whoever_asks_gets_the_latest_also_after_a_restart(config: Config) -> None:
    with served(config) as other:
        receipts = other.listen(RECEIPT, period_s=0.1)
        for stamp_ns in (5, 6):
            stored(other, receipts, replace(CLAIM, stamp_ns=stamp_ns))
    with served(config) as other:
        answer = other.ask(EXTRINSICS, timeout_s=5.0)
        assert isinstance(answer, Extrinsics)
        assert answer.stamp_ns == 6
        assert np.array_equal(answer.mount.covariance, MOUNT.covariance)


def test_nothing_stored_is_no_answer(config: Config) -> None:
    with served(config) as other:
        assert other.ask(EXTRINSICS, timeout_s=0.5) is None


def test_what_calibration_claimed_while_nobody_stored_is_asked_for(config: Config) -> None:
    with Router(config), Bus(config, "calibration", "front") as other, Bus(config, "storage", "front") as bus:
        other.answer(EXTRINSICS, lambda: CLAIM)
        receipts = other.listen(RECEIPT, period_s=0.1)
        thread = threading.Thread(target=storage.run, args=(bus, config))
        thread.start()
        heard(receipts, receipt_for(5))
        bus.stop()
        thread.join(10.0)


def test_another_robots_extrinsics_are_counted_and_not_stored(config: Config) -> None:
    with served(config) as other:
        stream = other.listen(RECEIPT, HEALTH, period_s=0.1)
        stored(other, stream, CLAIM)
        other.publish(EXTRINSICS, replace(CLAIM, robot="other"))
        heard(stream, health_with("another robot or camera"))
        stored(other, stream, replace(CLAIM, stamp_ns=6))
        with Store(config.storage.path, writable=False) as store:
            assert [entry.extrinsics.robot for entry in store.entries()] == ["demo", "demo"]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"rig_digest": "00ff"}, "extrinsics of another rig"),
        ({"mount": replace(MOUNT, rho_m=1.01)}, "extrinsics out of range"),
    ],
)
def test_what_can_be_no_result_of_this_robot_is_counted_and_not_stored(
    config: Config, changes: dict[str, Any], reason: str
) -> None:
    with served(config) as other:
        stream = other.listen(RECEIPT, HEALTH, period_s=0.1)
        heard(stream, health_with(reason), lambda: other.publish(EXTRINSICS, replace(CLAIM, **changes)))
        assert other.ask(EXTRINSICS, timeout_s=5.0) is None
        stored(other, stream, CLAIM)


def test_only_a_calibration_that_is_here_can_have_something_stored(config: Config) -> None:
    with served(config) as calibration:
        stream = calibration.listen(RECEIPT, HEALTH, period_s=0.1)
        with Bus(config, "monitor", "m1") as stranger:
            reason = "extrinsics of nobody who is here as calibration"
            heard(stream, health_with(reason), lambda: stranger.publish(EXTRINSICS, replace(CLAIM, stamp_ns=9)))
        assert calibration.ask(EXTRINSICS, timeout_s=5.0) is None
        stored(calibration, stream, CLAIM)


def test_the_last_claim_of_a_calibration_that_has_gone_is_stored(config: Config) -> None:
    with served(config) as other:
        stream = other.listen(RECEIPT, period_s=0.1)
        with Bus(config, "calibration", "back") as ending:
            stored(ending, stream, replace(CLAIM, stamp_ns=8))
            publisher = ending.incarnation
        assert other.await_presence(lambda: publisher not in other.incarnations("calibration"), 10.0)
        late = replace(CLAIM, stamp_ns=9)
        with Bus(config, "calibration", "back") as other_end:
            other_end.incarnation = publisher  # as if it had been on the way
            stored(other_end, stream, late)


def test_while_the_file_is_locked_claims_wait_and_health_says_so(config: Config) -> None:
    with served(config) as other:
        stream = other.listen(RECEIPT, HEALTH, period_s=0.1)
        stored(other, stream, CLAIM)
        blocker = sqlite3.connect(config.storage.path, isolation_level=None)
        blocker.execute("BEGIN IMMEDIATE")
        for stamp_ns in (6, 6, 7):
            other.publish(EXTRINSICS, replace(CLAIM, stamp_ns=stamp_ns))
        heard(stream, health_with("2 waiting"))
        answer = other.ask(EXTRINSICS, timeout_s=5.0)
        assert isinstance(answer, Extrinsics)
        assert answer.stamp_ns == 5  # what waits is not stored
        receipt = other.ask(RECEIPT, timeout_s=5.0)
        assert isinstance(receipt, Receipt)
        assert (receipt.stamp_ns, receipt.entry) == (5, 1)
        blocker.execute("COMMIT")
        blocker.close()
        heard(stream, receipt_for(6))
        heard(stream, receipt_for(7))
        heard(stream, lambda m: isinstance(m, Health) and m.service == "storage" and not m.notes)


def test_a_store_that_cannot_be_opened_is_tried_again(config: Config, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "omnivert.storage")
    folder = config.storage.path.parent / "later"
    config = config.model_copy(update={"storage": config.storage.model_copy(update={"path": folder / "x.db"})})
    with served(config) as other:
        stream = other.listen(RECEIPT, HEALTH, period_s=0.1)
        heard(stream, health_with("no folder"))
        other.publish(EXTRINSICS, CLAIM)
        heard(stream, health_with("1 waiting"), lambda: other.publish(EXTRINSICS, CLAIM))
        assert other.ask(EXTRINSICS, timeout_s=5.0) is None
        folder.mkdir()
        stored(other, stream, CLAIM)
    said = [record.getMessage() for record in caplog.records if record.name == "omnivert.storage"]
    assert len(said) == 2
    assert said[0].startswith("error[OV602]: the store ")
    assert said[0].endswith("; what is to be stored waits")
    assert said[1].endswith("can be written again")


def test_a_service_that_ends_in_trouble_says_what_is_lost(config: Config, caplog: pytest.LogCaptureFixture) -> None:
    folder = config.storage.path.parent / "never"
    config = config.model_copy(update={"storage": config.storage.model_copy(update={"path": folder / "x.db"})})
    with served(config) as other:
        stream = other.listen(HEALTH, period_s=0.1)
        other.publish(EXTRINSICS, CLAIM)
        heard(stream, health_with("1 waiting"), lambda: other.publish(EXTRINSICS, CLAIM))
    assert caplog.messages[-1].endswith(f"there is no folder {folder}; 1 extrinsics are lost")


def test_a_damaged_store_is_set_aside_and_a_removed_one_begun_anew(config: Config) -> None:
    path = config.storage.path
    path.write_bytes(b"damaged" * 1000)
    with served(config) as other:
        stream = other.listen(RECEIPT, HEALTH, period_s=0.1)
        heard(stream, health_with("was damaged; it is kept as x.db.damaged-"))
        stored(other, stream, CLAIM)
        path.rename(path.with_name("moved.db"))
        stored(other, stream, replace(CLAIM, stamp_ns=6))
        with Store(path, writable=False) as store:
            assert [entry.extrinsics.stamp_ns for entry in store.entries()] == [6]
