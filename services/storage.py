"""Extrinsics into the store, a receipt for each, and the latest for whoever asks."""

import sys

from omnivert.config import Config
from omnivert.messages import Extrinsics, Receipt
from omnivert.store import Store, StoreError
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import EXTRINSICS, RECEIPT
from services import _start

RETRY_S = 1.0


def run(bus: Bus, config: Config) -> None:
    """Stores until the bus stops; while the file cannot be written, extrinsics wait and are tried again."""
    desk = Desk(bus, config)
    missed = bus.ask(EXTRINSICS)  # what calibration has claimed while nobody stored
    if isinstance(missed, Extrinsics):
        desk.take(missed, None)
    desk.store()
    bus.answer(EXTRINSICS, desk.latest)
    for received in bus.listen(EXTRINSICS, period_s=RETRY_S):
        if received is not None and isinstance(received.message, Extrinsics):
            desk.take(received.message, received)
        desk.store()


class Desk:
    """What waits to be stored, and the store when it is there."""

    def __init__(self, bus: Bus, config: Config) -> None:
        self._bus = bus
        self._config = config
        self._store: Store | None = None
        self._waiting: tuple[
            tuple[Extrinsics, Received | None], ...
        ] = ()  # replaced as a whole: two threads look at it

    def take(self, extrinsics: Extrinsics, received: Received | None) -> None:
        """Puts extrinsics in the queue, if they are this camera's; what is said again while it waits stays one."""
        whose, ours = (extrinsics.robot, extrinsics.camera), (self._config.robot.id, self._config.camera.id)
        if whose != ours:
            self._bus.refuse("extrinsics of another robot or camera")
            return
        others = [waiting for waiting in self._waiting if not _same(waiting[0], extrinsics)]
        self._waiting = (*others, (extrinsics, received))
        if len(self._waiting) > self._config.storage.waiting_max:
            self._waiting = self._waiting[1:]
            self._bus.refuse("extrinsics given up: the store cannot be written")

    def store(self) -> None:
        """Stores what waits, as far as the file allows it, and says so."""
        try:
            store = self._opened()
            while self._waiting:
                extrinsics, received = self._waiting[0]
                self._put(store, extrinsics, received)
                self._waiting = self._waiting[1:]
        except StoreError as error:
            self._bus.refuse(f"store: {error.code} {error.because}")
            self._bus.note(f"storage: {error}; {len(self._waiting)} waiting", "store")
            if self._store is not None and error.code in ("OV603", "OV606"):  # opening anew puts it right
                self._store.close()
                self._store = None
        else:
            self._bus.note(None, "store")

    def latest(self) -> Extrinsics | None:
        """The newest extrinsics of this camera."""
        waiting, store = self._waiting, self._store
        if waiting:
            return waiting[-1][0]
        entry = store.latest(self._config.robot.id, self._config.camera.id) if store is not None else None
        return entry.extrinsics if entry is not None else None

    def _opened(self) -> Store:
        if self._store is None:
            path = self._config.storage.path
            self._store = Store(path, locked_s=self._config.storage.locked_s)
            if self._store.set_aside is not None:
                self._bus.note(f"storage: {path} was damaged; it is kept as {self._store.set_aside.name}", "set aside")
        return self._store

    def _put(self, store: Store, extrinsics: Extrinsics, received: Received | None) -> None:
        try:
            entry = store.put(extrinsics)
        except ValueError as error:
            self._bus.refuse(str(error))
            return
        receipt = Receipt(extrinsics.stamp_ns, extrinsics.robot, extrinsics.camera, entry)
        self._bus.publish(RECEIPT, receipt, cause=received)
        if received is not None:
            self._bus.done(received)


def _same(one: Extrinsics, other: Extrinsics) -> bool:
    def told(extrinsics: Extrinsics) -> tuple[float, ...]:
        mount = extrinsics.mount
        return (extrinsics.stamp_ns, mount.phi_rad, mount.rho_m, mount.psi_rad, *mount.covariance.ravel().tolist())

    return told(one) == told(other)


def main() -> int:
    return _start.start("storage", lambda bus, config, _: run(bus, config))


if __name__ == "__main__":
    sys.exit(main())
