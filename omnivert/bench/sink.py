"""Whoever receives the camera's frames, a process of its own: `python -m omnivert.bench.sink --config FILE`."""

import argparse
import sys
from pathlib import Path

from omnivert.config import load
from omnivert.wire.bus import Bus
from omnivert.wire.channels import FRAME


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--config", type=Path, required=True)
    with Bus(load(parser.parse_args().config), "sink", "sink") as bus:
        for _ in bus.listen(FRAME):
            pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
