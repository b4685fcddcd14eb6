"""The other end of the raw rounds, a process of its own: `python -m omnivert.bench.echo --config FILE`."""

import argparse
import sys
from pathlib import Path

from omnivert.config import load
from omnivert.wire.bus import Bus
from omnivert.wire.raw import serve_echo

ANSWER_BYTES = 2000  # about what the bearings of 30 lines take


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--config", type=Path, required=True)
    with Bus(load(parser.parse_args().config), "echo", "echo") as bus:
        serve_echo(bus, bytes(ANSWER_BYTES))
    return 0


if __name__ == "__main__":
    sys.exit(main())
