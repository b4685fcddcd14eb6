"""Shows what the bus brings: a screen on a terminal, a line a second in a pipe; commands nothing, writes nothing."""

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.live import Live

from omnivert.config import Config
from omnivert.messages import Receipt
from omnivert.pictures.monitor_view import View
from omnivert.wire import channels
from omnivert.wire.bus import Bus
from services import _start

SCREEN_S = 0.25
LINE_S = 1.0
ONCE_S = 2.2  # two health messages of every service come within it
HEARD = (
    channels.BEARINGS,
    channels.ESTIMATE,
    channels.EXTRINSICS,
    channels.RECEIPT,
    channels.PLAYBACK,
    channels.HEALTH,
)


def run(
    bus: Bus,
    config: Config,
    once: bool = False,
    tell: Callable[[dict[str, Any]], None] | None = None,
    rate_known: bool = True,
) -> None:
    """Show the state until the bus stops, or once after two seconds.

    tell        is told that one state as plain values; nothing is shown then
    rate_known  whether the configuration is the robot's own, so that its camera's rate can be expected
    """
    once = once or tell is not None
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=100)
    view = View(config, config.bus.endpoint, rate_known)
    claimed = bus.ask(channels.EXTRINSICS, timeout_s=1.0)
    if claimed is not None:
        view.step(claimed, time.monotonic())
    receipt = bus.ask(channels.RECEIPT, timeout_s=1.0)
    if isinstance(receipt, Receipt):
        view.acknowledge(receipt, time.monotonic())
    on_screen = console.is_terminal and not once
    period_s = ONCE_S if once else SCREEN_S if on_screen else LINE_S
    shown = time.monotonic()
    with _live(console, on_screen) as live:
        for received in bus.listen(*HEARD, period_s=SCREEN_S):
            now = time.monotonic()
            if received is not None:
                view.step(received.message, now)
            if now - shown < period_s:
                continue
            shown = now
            view.present(bus.present())
            if tell is not None:
                tell(view.json())
                return
            if once:
                console.print(view.screen(now, once=True))
                return
            if live is not None:
                live.update(view.screen(now), refresh=True)
            else:
                console.print(view.line(now), markup=False, soft_wrap=True)


@contextmanager
def _live(console: Console, on_screen: bool) -> Iterator[Live | None]:
    if not on_screen:
        yield None
        return
    with Live(console=console, screen=True, auto_refresh=False) as live:
        yield live


def main() -> int:
    return _start.start("monitor", lambda bus, config, given: run(bus, config, given.once), _arguments)


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--once", action="store_true", help="show one screen and end")


if __name__ == "__main__":
    sys.exit(main())
