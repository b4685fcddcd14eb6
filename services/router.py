"""The router: where all services of a robot meet, so that nothing else need be installed."""

import logging
import re
import sys

from omnivert.errors import OmnivertError
from omnivert.wire.bus import Bus, Router
from omnivert.wire.endings import Signals
from services import _start

LOOK_S = 0.2  # a signal that another thread has taken is seen when this one, which acts on it, looks up

_log = logging.getLogger("omnivert.router")


def main() -> int:
    arguments, config = _start.arguments_and_config("router")
    bus = Bus(config, "router", arguments.instance or config.camera.id)  # tells the others that it is here, and how
    Signals(bus.stop).watch()
    if arguments.supervised:
        _start.stop_with_stdin(bus.stop)
    try:
        with Router(config) as router:
            for endpoint in router.endpoints:
                _log.info("listening on %s", endpoint)
                if not is_local(endpoint):
                    _log.warning(
                        "%s is open to the network: whoever reaches it can read and publish on every robot of this "
                        "router, without a password and in clear text",
                        endpoint,
                    )
            with bus:
                bus.ready()
                while not bus.wait_stopped(LOOK_S):
                    pass
    except OmnivertError as error:
        return _start.refusal("router", error)
    return 0


def is_local(endpoint: str) -> bool:
    """Whether only processes of this machine can reach an end point."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    return host == "localhost" or host == "::1" or re.fullmatch(r"127(\.\d{1,3}){3}", host) is not None


if __name__ == "__main__":
    sys.exit(main())
