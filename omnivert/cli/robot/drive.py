"""`omnivert drive`: steer a simulated robot with the keys, and see what each manoeuvre makes visible."""

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import radians
from typing import TYPE_CHECKING, Annotated

import typer

from omnivert.cli import say
from omnivert.cli.keys import DOWN, ESCAPE, HUNG_UP, LEFT, RIGHT, UP, keys
from omnivert.cli.settings import PATIENCE_S, ConfigOption, ConnectOption, RobotOption
from omnivert.cli.whom import meant
from omnivert.errors import UseError
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
    UP: Motion("▲ forward", 1.0, 0.0),
    DOWN: Motion("▼ back", -1.0, 0.0),
    LEFT: Motion("↺ turns left", 0.0, 1.0),
    RIGHT: Motion("↻ turns right", 0.0, -1.0),
    b"q": Motion("⤴ arc left", 1.0, 1.0),
    b"e": Motion("⤵ arc right", 1.0, -1.0),
    b" ": STOP,
}
MOTIONS |= {letter: MOTIONS[key] for letter, key in ((b"w", UP), (b"s", DOWN), (b"a", LEFT), (b"d", RIGHT))}
MOTIONS |= {letter.upper(): motion for letter, motion in MOTIONS.items() if letter.isalpha()}
ENDS = (b"x", b"X", ESCAPE, HUNG_UP)
KEYS = "↑ ↓ w s drive · ← → a d turn · q e arcs · space stops · x ends"


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

    wheel = _Wheel()
    with keys(wheel.actions()) as has_keys:
        if not has_keys:
            raise UseError("OV214", "there is no terminal to take keys from", "standard input is none")
        chosen = meant(config, robot, connect, "drive")
        with Bus(chosen, "drive", f"d{os.getpid()}", patience_s=PATIENCE_S) as bus:
            bus.refuse_beside("drive")  # else each undoes what the other one asks for
            with _followed(bus) as newest:
                _drive(bus, wheel, newest, speed, turn)


def _drive(bus: "Bus", wheel: "_Wheel", newest: "_Newest", speed: float, turn: float) -> None:
    """Until the driver leaves, or the bus stops."""
    say.story(f"[bold]robot {bus.config.robot.id}[/]   {KEYS}")
    if not bus.await_presence(lambda: bool(bus.incarnations("bridge")), PATIENCE_S) and not bus.stopped:
        say.story("[yellow]no robot is here[/]: omnivert up --sim office   # starts a simulated one")
    try:
        while not bus.stopped and not wheel.left:
            _steer(bus, wheel.motion, speed, turn)
            _show(wheel.motion, newest)
            wheel.await_touch(PERIOD_S)
    finally:
        _steer(bus, wheel.motion and STOP, speed, turn)
        say.story("")


class _Wheel:
    """What the keys ask for; they come from a thread of their own."""

    def __init__(self) -> None:
        self.motion: Motion | None = None  # None: nothing was asked for, so a path goes on
        self.left = False
        """Whether the driver has left."""
        self._touched = threading.Event()

    def actions(self) -> dict[bytes, Callable[[], None]]:
        turns = {key: partial(self._turn, motion) for key, motion in MOTIONS.items()}
        return {**turns, **dict.fromkeys(ENDS, self._leave)}

    def await_touch(self, timeout_s: float) -> None:
        self._touched.wait(timeout_s)
        self._touched.clear()

    def _turn(self, motion: Motion) -> None:
        self.motion = motion
        self._touched.set()

    def _leave(self) -> None:
        self.left = True
        self._touched.set()


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
