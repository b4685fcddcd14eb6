"""Which robots are on a bus: the liveliness tokens of all of them, above any one robot's namespace."""

from omnivert.config import Config
from omnivert.wire.bus import Bus

Alive = tuple[str, str, str]  # robot, service, instance
ASK_S = 1.0


def alive(config: Config, patience_s: float) -> frozenset[Alive]:
    """Every service of every robot at the configuration's end point, as the router knows them.

    raises  DataError when there is no router
    """
    bus = Bus(config, "lookout", "all", patience_s)
    del bus._settings["namespace"]
    with bus:
        if bus._session is None:
            return frozenset()
        replies = bus._session.liveliness().get("omnivert/*/v1/@live/**", timeout=ASK_S)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok]
    return frozenset(who for token in tokens if (who := alive_from_key(token)))


def alive_from_key(key: str) -> Alive | None:
    """Whose token it is; None for a key of another form."""
    match key.split("/"):
        case ["omnivert", robot, _, "@live", service, instance, _]:
            return robot, service, instance
    return None
