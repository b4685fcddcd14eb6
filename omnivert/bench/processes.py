"""Services as processes on a bus of their own, for as long as something is measured."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from omnivert.config import Config, parsed
from omnivert.errors import DataError
from omnivert.wire.bus import Bus

START_S = 20.0  # for a service to come up on a busy machine
_STOP_S = 5.0


def private_bus(config: Config, folder: Path) -> tuple[Config, Path]:
    """The configuration with a bus that nobody else is on, and the file that it stands in, for other processes."""
    given = config.model_dump(mode="json")
    given["bus"]["endpoint"] = f"unixsock-stream/{folder}/bus.sock"
    given["bus"]["listen"] = []
    private, file = parsed(given, "the bench"), folder / "bench.json"
    file.write_text(json.dumps(private.model_dump(mode="json")), encoding="utf-8")
    return private, file


@contextmanager
def process(module: str, config: Path, *more: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A process that ends with the block."""
    command = [sys.executable, "-m", module, "--config", str(config), *more]
    started = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.terminate()
        try:
            started.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            started.kill()
            started.wait()


def await_services(bus: Bus, services: set[str]) -> None:
    """raises DataError when one of them does not come up"""
    if not bus.await_presence(lambda: services <= {name for name, _ in bus.present()}, START_S):
        lacking = ", ".join(sorted(services - {name for name, _ in bus.present()}))
        raise DataError("OV422", f"{lacking} did not come up within {START_S:.0f} s", help="omnivert demo")
