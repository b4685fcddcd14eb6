"""How every service starts and ends.

`python -m services.NAME --config FILE [--instance ID] [--supervised] ...`. SIGTERM, SIGINT and, when supervised, the
end of standard input (the supervisor is gone) stop it; what has not stopped after 2.5 s is ended by force.
"""

import argparse
import logging
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from omnivert.config import Config, load
from omnivert.errors import OmnivertError
from omnivert.threads import one_thread
from omnivert.wire.bus import Bus
from omnivert.wire.endings import FORCED

_GRACE_S = 2.5
_SWITCH_S = 0.0005  # a busy thread must let the bus's threads in: 5 ms would be felt in every latency

Run = Callable[[Bus, Config, argparse.Namespace], None]


def start(service: str, run: Run, add_arguments: Callable[[argparse.ArgumentParser], None] | None = None) -> int:
    """Runs a service until it ends or is stopped; returns its exit code."""
    arguments, config = arguments_and_config(service, add_arguments)
    prepare()
    try:
        bus = Bus(config, service, arguments.instance or config.camera.id)
        if arguments.supervised:
            stop_with_stdin(bus.stop)
        with bus:
            force_exit_after_stop(bus)
            run(bus, config, arguments)
    except OmnivertError as error:
        return refusal(service, error)
    return 0


def arguments_and_config(
    service: str, add_arguments: Callable[[argparse.ArgumentParser], None] | None = None
) -> tuple[argparse.Namespace, Config]:
    """The command line and the configuration that it names; ends the process when they are wrong."""
    parser = argparse.ArgumentParser(prog=f"services.{service}")
    parser.add_argument("--config", type=Path, required=True, help="TOML or JSON file")
    parser.add_argument("--instance", default="", help="name among the services of this kind; default: the camera's id")
    parser.add_argument("--supervised", action="store_true", help="stop when standard input ends")
    if add_arguments is not None:
        add_arguments(parser)
    arguments = parser.parse_args()
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format=f"{service}: %(message)s")
    try:
        return arguments, load(arguments.config)
    except OmnivertError as error:
        sys.exit(refusal(service, error))


def prepare() -> None:
    """One thread for the algorithms, and short turns between Python's threads."""
    one_thread()
    sys.setswitchinterval(_SWITCH_S)


def stop_with_stdin(stop: Callable[[], None]) -> None:
    """Stops when standard input ends: whoever started this process is gone."""

    def watch() -> None:
        while os.read(0, 4096):
            pass
        stop()

    threading.Thread(target=watch, name="stdin", daemon=True).start()


def force_exit_after_stop(bus: Bus) -> None:
    """A process that was told to stop ends, whatever its loop is stuck in."""

    def watch() -> None:
        while not bus.wait_stopped(3600.0):
            pass
        threading.Event().wait(_GRACE_S)
        logging.getLogger("omnivert").error("did not stop within %.1f s; ended by force", _GRACE_S)
        os._exit(FORCED)

    threading.Thread(target=watch, name="force-exit", daemon=True).start()


def refusal(service: str, error: OmnivertError) -> int:
    """Says in one line why a service cannot go on; returns the exit code."""
    help_line = f" (try: {error.help})" if error.help else ""
    print(f"{service}: error[{error.code}]: {error}{help_line}", file=sys.stderr, flush=True)  # noqa: T201
    return error.exit_code
