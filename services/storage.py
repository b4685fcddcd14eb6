"""Extrinsics of this robot's calibration into the store, a receipt for each, and the latest for whoever asks."""

import logging
import sys
from collections import deque

from omnivert.config import Config
from omnivert.messages import Extrinsics, Receipt
from omnivert.store import Entry, Store, StoreError
from omnivert.store_rules import storable
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import EXTRINSICS, RECEIPT
from services import _start

RETRY_S = 1.0
KNOWN_S = 1.0  # for the token of whoever has answered to come

_log = logging.getLogger("omnivert.storage")


def run(bus: Bus, config: Config) -> None:
    """Stores until the bus stops; while the file cannot be written, extrinsics wait and are tried again."""
    desk = Desk(bus, config)
    desk.store()
    bus.answer(EXTRINSICS, desk.latest)
    bus.answer(RECEIPT, desk.receipt)
    missed = bus.ask(EXTRINSICS)  # what calibration has claimed while nobody stored
    if isinstance(missed, Extrinsics):
        bus.await_presence(lambda: bool(bus.incarnations("calibration")), KNOWN_S)
        desk.take(missed, None)
    desk.store()
    for received in bus.listen(EXTRINSICS, period_s=RETRY_S):
        if received is not None and isinstance(received.message, Extrinsics):
            desk.take(received.message, received)
        desk.store()
    desk.close()


class Desk:
    """What waits to be stored, and the store when it is there."""

    def __init__(self, bus: Bus, config: Config) -> None:
        self._bus = bus
        self._config = config
        self._store: Store | None = None
        self._waiting: list[tuple[Extrinsics, Received | None]] = []
        self._calibrations: deque[bytes] = deque(maxlen=16)  # that were here: the last claim comes from one that ends
        self._trouble: StoreError | None = None

    def take(self, extrinsics: Extrinsics, received: Received | None) -> None:
        """Puts extrinsics in the queue, if they are this camera's; what is said again while it waits stays one."""
        reason = storable(extrinsics, self._config)
        if not reason and not self._is_of_a_calibration(received):
            reason = "extrinsics of nobody who is here as calibration"
        if reason:
            self._bus.refuse(reason)
            return
        self._waiting = [waiting for waiting in self._waiting if not _same(waiting[0], extrinsics)]
        self._waiting.append((extrinsics, received))
        if len(self._waiting) > self._config.storage.waiting_max:
            del self._waiting[0]
            self._bus.refuse("extrinsics given up: the store cannot be written")

    def store(self) -> None:
        """Stores what waits, as far as the file allows it, and says so."""
        self._look_around()
        try:
            store = self._opened()
            while self._waiting:
                self._put(store, *self._waiting[0])
                del self._waiting[0]
        except StoreError as error:
            self._bus.refuse(f"store: {error.code} {error.because}")
            self._bus.note(f"storage: {error}; {len(self._waiting)} waiting", "store")
            if self._trouble is None or str(self._trouble) != str(error):
                self._tell(error, "what is to be stored waits")
            self._trouble = error
            if self._store is not None and error.code in ("OV603", "OV606"):  # opening anew puts it right
                self._store.close()
                self._store = None
        else:
            self._bus.note(None, "store")
            if self._trouble is not None:
                _log.info("the store %s can be written again", self._config.storage.path)
            self._trouble = None

    def latest(self) -> Extrinsics | None:
        """The newest extrinsics of this camera that would survive a power loss."""
        entry = self._latest()
        return entry.extrinsics if entry is not None else None

    def receipt(self) -> Receipt | None:
        """The receipt for them."""
        entry = self._latest()
        return _receipt(entry.entry, entry.extrinsics) if entry is not None else None

    def close(self) -> None:
        """The service ends: what still waits is lost."""
        if self._trouble is not None:
            count = len(self._waiting)
            self._tell(self._trouble, f"{count} extrinsics are lost" if count else "nothing waited to be stored")

    def _latest(self) -> Entry | None:
        try:
            store = self._store
            return None if store is None else store.latest(self._config.robot.id, self._config.camera.id)
        except StoreError:  # said when it is tried again
            return None

    def _look_around(self) -> None:
        for incarnation in self._bus.incarnations("calibration"):
            if incarnation not in self._calibrations:
                self._calibrations.append(incarnation)

    def _is_of_a_calibration(self, received: Received | None) -> bool:
        self._look_around()
        return bool(self._calibrations) if received is None else received.publisher in self._calibrations

    def _tell(self, error: StoreError, then: str) -> None:
        """On standard error, for whoever has started this."""
        _log.warning("error[%s]: %s; %s", error.code, error, then)

    def _opened(self) -> Store:
        if self._store is None:
            path = self._config.storage.path
            self._store = Store(path, locked_s=self._config.storage.locked_s)
            if self._store.set_aside is not None:
                text = f"{path} was damaged; it is kept as {self._store.set_aside.name}"
                self._bus.note(f"storage: {text}", "set aside")
                _log.warning("%s, and a new one is begun", text)
        return self._store

    def _put(self, store: Store, extrinsics: Extrinsics, received: Received | None) -> None:
        try:
            entry = store.put(extrinsics, replayed=received is not None and received.replay)
        except ValueError as error:
            self._bus.refuse(str(error))
            return
        self._bus.publish(RECEIPT, _receipt(entry, extrinsics), cause=received)
        if received is not None:
            self._bus.done(received)


def _receipt(entry: int, extrinsics: Extrinsics) -> Receipt:
    return Receipt(extrinsics.stamp_ns, extrinsics.robot, extrinsics.camera, entry)


def _same(one: Extrinsics, other: Extrinsics) -> bool:
    def told(extrinsics: Extrinsics) -> tuple[float, ...]:
        mount = extrinsics.mount
        return (extrinsics.stamp_ns, mount.phi_rad, mount.rho_m, mount.psi_rad, *mount.covariance.ravel().tolist())

    return told(one) == told(other)


def main() -> int:
    return _start.start("storage", lambda bus, config, _: run(bus, config))


if __name__ == "__main__":
    sys.exit(main())
