"""What zenoh is told: a closed door, short waits, room for a burst; and what it says when it cannot go on."""

from typing import Any

from omnivert.config import Config

CONNECT_MS = 500  # one try; zenoh cannot be interrupted while it connects
LEASE_MS = 3000  # a process that is frozen for longer counts as gone
BATCHES = 16  # of 64 kB, for each priority of a link: zenoh's 2 hold less than one frame
WAIT_US = 20_000  # a publisher waits this long for a full queue before the message is dropped
QUERY_MS = 1500

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


def reason_from_error(error: Exception) -> str:
    """Zenoh's reason in one line, without the place in its sources."""
    return str(error).partition("\n")[0].partition(" at /")[0]


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
