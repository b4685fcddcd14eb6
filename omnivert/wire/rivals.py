"""Who gives way when two services would publish the same streams, or steer the same robot.

Each says that it is here before it looks who else is, so that at least one of two sees the other. A player gives way
to a bridge at any time. Of two of a kind the one that was here first stays; of two that come at once the one with the
larger incarnation goes. Whoever stays waits until the other has gone.

An answer counts once it knows the asker. It must come from the router: of two who then ask, each after it is known,
at least the later one is told of the other.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from omnivert.errors import UseError
from omnivert.wire.presence import Presence, Who, who_from_key

LEAVE_S = 3.0  # for a rival that has to give way, to be gone
ASK_AGAIN_S = 0.1


def refusal(robot: str, service: str, rival: str) -> UseError:
    does = "steer" if rival == "drive" else "publish the sensors of"
    match (service, rival):
        case (_, "drive"):
            help = "omnivert monitor   # shows what the other one does with it"
        case ("bridge", "bridge"):
            help = "give the second robot, or the simulated one, a robot.id of its own"
        case (_, "bridge"):
            help = "omnivert up --play REC, which starts no bridge"
        case _:
            help = "omnivert monitor"
    because = f"both {does} robot {robot}, and one {rival} is here"
    return UseError("OV402", f"{service} cannot run beside another {rival}", because, help)


def tokens(session: Any, failure: type[Exception]) -> frozenset[str] | None:
    """The presence keys that a zenoh session's router knows; None without a session, or when the router has not
    answered or was not there all the while.

    failure  what the session raises when it is closed
    """
    with suppress(failure):
        if session is not None and (router := session.info.routers_zid()):
            replies = list(session.liveliness().get("v1/@live/**", timeout=1.0))
            if all(reply.ok for reply in replies) and session.info.routers_zid() == router:
                return frozenset(str(reply.ok.key_expr) for reply in replies)
    return None


@dataclass(frozen=True, slots=True)
class Known:
    """Who is here of the services that publish the same, as this service's presence and the router know it.

    asked       the presence keys that the router knows; None when it does not say
    namesakes   services of which only one with this one's own instance publishes the same
    """

    presence: Presence
    asked: Callable[[], frozenset[str] | None]
    services: tuple[str, ...]
    stopped: Callable[[], bool]
    namesakes: tuple[str, ...] = ()

    def settled(self, ready: Callable[[], None], is_ready: bool) -> str:
        """Says by `ready` that this service is here; returns the service to give way to, "" when there is none.

        is_ready  whether that was said before
        """
        if not is_ready and (staying := self._first_here()):
            return staying
        ready()
        began_s = time.monotonic()
        while rivals := self.rivals(shown=True):
            for rival in sorted(rivals):
                if self._gives_way(rival) or time.monotonic() - began_s > LEAVE_S:
                    return rival[0]
            self.presence.wait(lambda: self.stopped() or not self._seen(), ASK_AGAIN_S)
        return ""

    def _first_here(self) -> str:
        """Of those who were here before, the service to give way to; a namesake may be one that has just died."""
        began_s = time.monotonic()
        while staying := [rival for rival in sorted(self.rivals(shown=False)) if not self._outlasts(rival)]:
            if staying[0][0] not in self.namesakes or time.monotonic() - began_s > LEAVE_S:
                return staying[0][0]
            self.presence.wait(lambda: self.stopped() or not self._seen(), ASK_AGAIN_S)
        return ""

    def rivals(self, shown: bool) -> frozenset[Who]:
        """Those who are here, as soon as the router says so; nobody when stopped before.

        shown  this service has said that it is here: an answer that does not know it yet is older than that
        """
        while not self.stopped():
            keys = self.asked()
            if keys is not None and (not shown or self.presence.key in keys):
                known = frozenset(who for key in keys if (who := who_from_key(key)) and self._is_rival(who))
                return (known | self._seen()) - {self.presence.me}
            self.presence.wait(self.stopped, ASK_AGAIN_S)
        return frozenset()

    def _seen(self) -> frozenset[Who]:
        return frozenset(filter(self._is_rival, self.presence.others(*self.services, *self.namesakes)))

    def _is_rival(self, who: Who) -> bool:
        return who[0] in self.services or (who[0] in self.namesakes and who[1] == self.presence.me[1])

    def _outlasts(self, rival: Who) -> bool:
        return (self.presence.me[0], rival[0]) == ("bridge", "player")

    def _gives_way(self, rival: Who) -> bool:
        if self.presence.me[0] == rival[0]:
            return self.presence.me[2] > rival[2]
        return not self._outlasts(rival)
