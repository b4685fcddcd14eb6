"""Who is on the bus, from the liveliness tokens that come and go."""

import threading
from collections.abc import Callable

from omnivert.wire.channels import presence_key


class Presence:
    """The other services of the robot; asked and told from any thread."""

    def __init__(self, service: str, instance: str, incarnation: bytes) -> None:
        self.key = presence_key(service, instance, incarnation.hex())
        self._changed = threading.Condition()
        self._here: dict[str, tuple[str, str, bytes]] = {}  # token's key -> service, instance, incarnation

    def token(self, key: str, here: bool) -> None:
        """A token has come or gone."""
        who = _who(key)
        if who is None or key == self.key:
            return
        with self._changed:
            if here:
                self._here[key] = who
            else:
                self._here.pop(key, None)
            self._changed.notify_all()

    def services(self) -> frozenset[tuple[str, str]]:
        """(service, instance)"""
        return frozenset((service, instance) for service, instance, _ in self._others())

    def incarnations(self, service: str) -> frozenset[bytes]:
        return frozenset(incarnation for name, _, incarnation in self._others() if name == service)

    def alive(self, incarnation: bytes) -> bool:
        return any(here == incarnation for _, _, here in self._others())

    def wait(self, holds: Callable[[], bool], timeout_s: float) -> bool:
        """Waits until `holds`, which is asked again whenever somebody comes or goes; whether it does."""
        with self._changed:
            return self._changed.wait_for(holds, timeout_s)

    def wake(self) -> None:
        """Whoever waits asks again."""
        with self._changed:
            self._changed.notify_all()

    def _others(self) -> list[tuple[str, str, bytes]]:
        with self._changed:
            return list(self._here.values())


def _who(key: str) -> tuple[str, str, bytes] | None:
    match key.split("/"):
        case [_, "@live", service, instance, incarnation]:
            try:
                return service, instance, bytes.fromhex(incarnation)
            except ValueError:
                return None
    return None
