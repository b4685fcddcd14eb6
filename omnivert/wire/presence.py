"""Who is on the bus, from the liveliness tokens that come and go."""

import threading
from collections.abc import Callable

from omnivert.wire.channels import presence_key

Who = tuple[str, str, bytes]  # service, instance, incarnation


class Presence:
    """The other services of the robot; asked and told from any thread."""

    def __init__(self, service: str, instance: str, incarnation: bytes) -> None:
        self.me: Who = (service, instance, incarnation)
        self.key = presence_key(service, instance, incarnation.hex())
        self._changed = threading.Condition()
        self._here: dict[str, Who] = {}  # by the token's key

    def token(self, key: str, here: bool) -> None:
        """A token has come or gone."""
        who = who_from_key(key)
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
        return frozenset((service, instance) for service, instance, _ in self._all())

    def others(self, *services: str) -> frozenset[Who]:
        """Those of these services."""
        return frozenset(who for who in self._all() if who[0] in services)

    def incarnations(self, service: str) -> frozenset[bytes]:
        return frozenset(incarnation for name, _, incarnation in self._all() if name == service)

    def alive(self, incarnation: bytes) -> bool:
        return any(here == incarnation for _, _, here in self._all())

    def wait(self, holds: Callable[[], bool], timeout_s: float) -> bool:
        """Waits until `holds`, which is asked again whenever somebody comes or goes; whether it does."""
        with self._changed:
            return self._changed.wait_for(holds, timeout_s)

    def wake(self) -> None:
        """Whoever waits asks again."""
        with self._changed:
            self._changed.notify_all()

    def _all(self) -> list[Who]:
        with self._changed:
            return list(self._here.values())


def who_from_key(key: str) -> Who | None:
    """Whose token it is; None for a key of another form."""
    match key.split("/"):
        case [_, "@live", service, instance, incarnation]:
            try:
                return service, instance, bytes.fromhex(incarnation)
            except ValueError:
                return None
    return None
