"""`omnivert drive`: steer a simulated robot with the keys, and see what each manoeuvre makes visible."""

import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, RobotOption
from omnivert.cli.strokes import check_terminal, strokes
from omnivert.cli.whom import meant
from omnivert.messages import Drive, Estimate, Health
from omnivert.pictures.words import mark, printable, quantities, short, word

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus

PERIOD_S = 0.1  # how often the robot is told, and the line is drawn
COLUMNS = 78  # where a terminal does not say how wide it is


@dataclass(frozen=True, slots=True)
class Motion:
    """What a key makes the robot do: shares of the speeds that were asked for."""

    name: str
    forward: float
    turn: float


STOP = Motion("■ stands", 0.0, 0.0)
MOTIONS = {
    "up": Motion("▲ forward", 1.0, 0.0),
    "down": Motion("▼ back", -1.0, 0.0),
    "left": Motion("↺ turns left", 0.0, 1.0),
    "right": Motion("↻ turns right", 0.0, -1.0),
    "q": Motion("⤴ arc left", 1.0, 1.0),
    "e": Motion("⤵ arc right", 1.0, -1.0),
    " ": STOP,
}
MOTIONS |= {letter: MOTIONS[key] for letter, key in (("w", "up"), ("s", "down"), ("a", "left"), ("d", "right"))}
ENDS = ("x", "escape", "end")
KEYS = "↑ ↓ or w s drive · ← → or a d turn · q e arcs · space stops · x ends"


def drive(
    config: ConfigOption = None,
    robot: RobotOption = None,
    connect: ConnectOption = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="Straight ahead and back, m/s.")] = 0.15,
    turn: Annotated[float, typer.Option(min=1.0, max=90.0, help="On the spot, degrees/s.")] = 12.0,
) -> None:
    """Steer a simulated robot with the arrow keys or w a s d; q and e drive arcs, space stops, x ends.

    A motion goes on until the next key. Start the robot with: omnivert up --sim office
    """
    from omnivert.wire.bus import Bus

    check_terminal()
    chosen = meant(config, robot, connect, "drive")
    with Bus(chosen, "drive", f"d{os.getpid()}", patience_s=PATIENCE_S) as bus, _followed(bus) as newest:
        say.story(f"[bold]robot {chosen.robot.id}[/]   {KEYS}")
        if not bus.await_presence(lambda: bool(bus.incarnations("bridge")), PATIENCE_S) and not bus.stopped:
            say.story("[yellow]no robot is here[/]: omnivert up --sim office   # starts a simulated one")
        motion: Motion | None = None  # None: nothing was asked for, so a path goes on
        try:
            with strokes() as keys:
                while not bus.stopped and (key := keys.pressed(PERIOD_S)) not in ENDS:
                    motion = MOTIONS.get(key or "", motion)
                    _steer(bus, motion, speed, turn)
                    _show(motion, newest)
        finally:
            _steer(bus, motion and STOP, speed, turn)
            say.story("")


@dataclass(slots=True)
class _Newest:
    estimate: Estimate | None = None
    blocked: bool = False  # the robot stands before something


@contextmanager
def _followed(bus: "Bus") -> Iterator[_Newest]:
    """The newest estimate, kept by a thread that has ended before the bus closes: in zenoh it would break the exit."""
    newest, over = _Newest(), threading.Event()
    thread = threading.Thread(target=_follow, args=(bus, newest, over), name="estimates", daemon=True)
    thread.start()
    try:
        yield newest
    finally:
        over.set()
        thread.join()


def _follow(bus: "Bus", newest: _Newest, over: threading.Event) -> None:
    from omnivert.wire.channels import ESTIMATE, HEALTH

    for received in bus.listen(ESTIMATE, HEALTH, period_s=PERIOD_S):
        if over.is_set():
            return
        match received.message if received is not None else None:
            case Estimate() as estimate:
                newest.estimate = estimate
            case Health(service="bridge", notes=notes):
                newest.blocked = any(note.startswith("blocked") for note in notes)
            case _:
                pass


def _steer(bus: "Bus", motion: Motion | None, speed: float, turn: float) -> None:
    from omnivert.wire.channels import DRIVE

    if motion is not None:
        command = Drive(time.monotonic_ns(), motion.forward * speed, motion.turn * radians(turn))
        bus.publish(DRIVE, command)


def line(motion: Motion | None, estimate: Estimate | None, columns: int, blocked: bool = False) -> str:
    """What moves, what is known how well, and what to drive next, in so many columns."""
    name = "✗ something is in the way" if blocked else motion.name if motion is not None else "as it goes"
    parts = [f"{name:<13}"]
    if estimate is None:
        parts.append("– waiting")
    else:
        sigmas = ""
        if estimate.mount is not None:
            sigmas = "  " + "  ".join(
                f"{part.name} ±{part.sigma_text} {part.unit}" for part in quantities(estimate.mount)
            )
        parts.append(f"{mark(estimate.state)} {word(estimate.state)}{sigmas}")
        if estimate.next_manoeuvre:
            parts.append(f"next: {printable(estimate.next_manoeuvre)}")
    return short(" │ ".join(parts), columns)


def _show(motion: Motion | None, newest: _Newest) -> None:
    columns = shutil.get_terminal_size((COLUMNS, 24)).columns - 1
    sys.stderr.write(f"\r\x1b[K{line(motion, newest.estimate, columns, newest.blocked)}")
    sys.stderr.flush()
