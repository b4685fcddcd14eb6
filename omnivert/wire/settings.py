"""What zenoh is told: a closed door, short waits, room for a burst; and what it says when it cannot go on."""

import re
from typing import Any

from omnivert.config import Config
from omnivert.errors import DataError

CONNECT_MS = 500  # one try; zenoh cannot be interrupted while it connects
LEASE_MS = 3000  # a process that is frozen for longer counts as gone
BATCHES = 16  # of 64 kB, for each priority of a link: zenoh's 2 hold less than one frame
WAIT_US = 20_000  # a publisher waits this long for a full queue before the message is dropped
QUERY_MS = 1500

_OTHER_PLACE = 'endpoint = "tcp/127.0.0.1:7448" under [bus]'
_TAKEN = ("another router listens there already", f"omnivert monitor   # shows it; or {_OTHER_PLACE}")
_LISTEN_ERRORS = (  # what zenoh's error holds, why it is, what helps
    ("Address already in use", *_TAKEN),
    ("EAGAIN", *_TAKEN),
    ("Cannot assign requested address", "this machine has no such address", _OTHER_PLACE),
    ("ermission denied", "this user may not listen there", _OTHER_PLACE),
    ("EACCES", "this user may not listen there", _OTHER_PLACE),
    ("ENOENT", "its folder does not exist", _OTHER_PLACE),
    ("failed to lookup address", "no machine of this name is known", _OTHER_PLACE),
)

_PRIORITIES = (
    *("control", "real_time", "interactive_high", "interactive_low"),
    *("data_high", "data", "data_low", "background"),
)


def client_settings(config: Config) -> dict[str, Any]:
    """A service: connects to the router, listens nowhere, sees its robot only."""
    return {
        **_common_settings(config),
        "mode": "client",
        "connect/endpoints": [config.bus.endpoint],
        "connect/timeout_ms": CONNECT_MS,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "namespace": f"omnivert/{config.robot.id}",
    }


def router_settings(config: Config) -> dict[str, Any]:
    """The router: listens where the configuration says, connects to nobody."""
    return {
        **_common_settings(config),
        "mode": "router",
        "listen/endpoints": [config.bus.endpoint, *config.bus.listen],
    }


def no_router(endpoint: str) -> DataError:
    """What zenoh says of it is a timeout, whatever the cause."""
    because = f"nobody listens at {endpoint}, or it is no router"
    return DataError("OV401", f"no router at {endpoint}", because, "omnivert up --config robot.toml")


def cannot_listen(endpoints: tuple[str, ...], error: Exception) -> DataError:
    """The refusal for what zenoh says when an end point cannot be opened."""
    text = str(error)
    because, help = next((told for sign, *told in _LISTEN_ERRORS if sign in text), (_in_one_line(text), _OTHER_PLACE))
    return DataError("OV403", f"the router cannot listen on {', '.join(endpoints)}", because, help)


def _in_one_line(text: str) -> str:
    """Without the places in zenoh's sources."""
    return re.sub(r" at /\S+", "", text).partition("\n")[0]


def _common_settings(config: Config) -> dict[str, Any]:
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # a router would wait half a second for whom it does not scout
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, BATCHES),
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": WAIT_US,
        "transport/link/rx/max_message_size": config.bus.max_message_bytes + 65536,
        "transport/shared_memory/enabled": config.bus.shared_memory,
        "queries_default_timeout": QUERY_MS,
    }
