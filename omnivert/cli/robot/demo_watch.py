"""What the demo hears on the bus while the recording is played, and the lines that it tells of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn

from omnivert.errors import DataError
from omnivert.messages import Bearings, Estimate, Extrinsics, Frame, Message, Mount, Playback, Receipt, State
from omnivert.pictures.words import cause, colour, printable, quantities, reasons_of, short, word

if TYPE_CHECKING:
    from omnivert.cli.robot.troubles import Troubles
    from omnivert.wire.bus import Bus

SILENCE_S = 20.0  # nothing at all for so long: something is wrong
ROWS = 10  # of the table of estimates
ROW_COLUMNS = 100
SETTLE_S = 3.0  # after the last message played, for results that are still on their way


@dataclass(slots=True)
class Heard:
    """Everything that came, in order."""

    total_frames: int
    end_ns: int  # of the last frame
    estimates: list[Estimate] = field(default_factory=list)
    last_bearings: Bearings | None = None
    claimed: Extrinsics | None = None
    receipt: Receipt | None = None
    played: Playback | None = None
    last_frame: Frame | None = None
    over: bool = False  # the robot has ended its drive, where it is none that is played

    def step(self, message: Message) -> None:
        match message:
            case Estimate():
                self.estimates.append(message)
            case Bearings():
                self.last_bearings = message
            case Extrinsics():
                self.claimed = message
            case Receipt():
                self.receipt = message
            case Playback():
                self.played = message
            case Frame():
                self.last_frame = message
            case _:
                pass

    def ended(self) -> None:
        """The robot has: the newest frame was the last one."""
        self.over = True
        if self.last_frame is not None:
            self.end_ns = self.last_frame.stamp_ns

    @property
    def complete(self) -> bool:
        """Whether the last frame's estimate is here and what was claimed is stored."""
        if not self.finished or not self.estimates or self.estimates[-1].stamp_ns < self.end_ns:
            return False
        return self._is_stored

    @property
    def _is_stored(self) -> bool:
        """Whether all that is claimed has its receipt."""
        claim: Message | None = self.claimed
        if self.estimates and self.estimates[-1].state is State.CALIBRATED and not self.over:
            claim = self.estimates[-1]  # the final state is claimed, too, and may be on its way
        return claim is None or (self.receipt is not None and self.receipt.stamp_ns >= claim.stamp_ns)

    @property
    def patience_s(self) -> float:
        """How long nothing may come after the end: a playback has waited for its results before, a live robot not.

        What is claimed is on its way to the store, however busy the machine is.
        """
        return SILENCE_S if self.over or not self._is_stored else SETTLE_S

    def why(self) -> str:
        """Why nothing was claimed, as far as the last estimate knows."""
        if not self.estimates:
            return "no estimate came"
        last = self.estimates[-1]
        told = cause((*last.reasons, *reasons_of(last))) or f"the drive ended {word(last.state)}"
        return f"{told}; {last.frame} of {self.total_frames} frames were taken"

    @property
    def finished(self) -> bool:
        return self.over or (self.played is not None and self.played.finished)


def watched(
    bus: "Bus",
    heard: Heard,
    console: Console,
    start_ns: int,
    troubles: "Troubles",
    label: str = "playing",
    over: Callable[[], bool] | None = None,
) -> None:
    """Listen until the last estimate has come and its result is stored; tell it on the way.

    over    whether the robot has ended its drive, where it is none that is played

    raises  DataError when the services fall silent
    """
    from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, FRAME, PLAYBACK, RECEIPT

    channels = (ESTIMATE, BEARINGS, EXTRINSICS, RECEIPT, PLAYBACK, *(() if over is None else (FRAME,)))

    columns = (
        TextColumn("  [cyan]▶ {task.description}[/]"),
        BarColumn(bar_width=30),
        TaskProgressColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[now]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=heard.total_frames, now="")
        rows = Rows(bar.console, heard.total_frames, start_ns)
        last = time.monotonic()
        for received in bus.listen(*channels, period_s=0.2):
            now = time.monotonic()
            troubles.check()
            if received is None:
                if over is not None and over():
                    heard.ended()
                if heard.complete or (heard.finished and now - last > heard.patience_s):
                    break  # nothing has come for a while, so nothing is on its way
                if now - last > SILENCE_S:
                    raise DataError(
                        "OV420", "the services fell silent", f"no message for {SILENCE_S:.0f} s", "omnivert demo"
                    )
                continue
            last = now
            heard.step(received.message)
            if isinstance(received.message, Estimate):
                _shown(bar, task, heard)
                rows.step(received.message)
        rows.close(heard.estimates)
    if bus.stopped:
        raise KeyboardInterrupt


def await_frame(bus: "Bus", troubles: "Troubles") -> int:
    """Stamp of the first frame that a simulated robot sees; the first time on a machine it compiles its loops before.

    raises  DataError when none comes, KeyboardInterrupt when the bus was stopped
    """
    from omnivert.cli.robot.troubles import COMPILED_S
    from omnivert.wire.channels import FRAME

    began = time.monotonic()
    for received in bus.listen(FRAME, period_s=0.2):
        troubles.check()
        if received is not None:
            return received.message.stamp_ns
        if time.monotonic() - began > COMPILED_S:
            because = f"no frame for {COMPILED_S:.0f} s"
            raise DataError("OV420", "the simulated robot is silent", because, "omnivert demo")
    raise KeyboardInterrupt


def _shown(bar: Progress, task: TaskID, heard: Heard) -> None:
    newest = heard.estimates[-1]
    now = _in_words(newest.mount) if newest.mount is not None else word(newest.state)
    bar.update(task, completed=len(heard.estimates), now=now)


def _in_words(mount: Mount) -> str:
    return "  ".join(str(part) for part in quantities(mount))


class Rows:
    """The table of estimates: a row now and then, and one at each change of the verdict."""

    def __init__(self, console: Console, total: int, start_ns: int) -> None:
        self._console = console
        self._every = max(total // ROWS, 1)
        self._start_ns = start_ns
        self._state: State | None = None
        self._count = 0
        self._told = -1
        console.print()
        console.print(f"  {'t, s':>5}  {'phi, deg':<14}  {'rho, m':<15}  {'psi, deg':<14}  verdict", style="dim")

    def step(self, estimate: Estimate) -> None:
        """One more estimate."""
        self._count += 1
        if self._count % self._every == 0 or estimate.state is not self._state:
            self._row(estimate)

    def close(self, estimates: list[Estimate]) -> None:
        """The last one is told in any case."""
        if estimates and self._told != self._count:
            self._row(estimates[-1])
        self._console.print()

    def _row(self, estimate: Estimate) -> None:
        self._told, self._state = self._count, estimate.state
        seconds = 1e-9 * (estimate.stamp_ns - self._start_ns)
        cells = ["–", "–", "–"]
        if estimate.mount is not None:
            phi, rho, psi = quantities(estimate.mount)
            cells = [f"{q.value_text:>6} ± {q.sigma_text}" for q in (phi, rho, psi)]
        numbers = f"  {seconds:5.1f}  {cells[0]:<14}  {cells[1]:<15}  {cells[2]:<14}  "
        state, hint = word(estimate.state), ""
        if estimate.state is not State.CALIBRATED and estimate.next_manoeuvre:
            hint = f": {_in_short(estimate.next_manoeuvre, ROW_COLUMNS - len(numbers) - len(state) - 2)}"
        self._console.print(f"{numbers}[{colour(estimate.state)}]{state}[/]{escape(hint)}")


def _in_short(manoeuvre: str, room: int) -> str:
    """A manoeuvre in the room that a row leaves: in few words, then its first half, then its beginning."""
    said = printable(manoeuvre).replace("about ", "").replace(" on the spot", "").replace(", then", ",")
    return said if len(said) <= room else short(said.partition(", ")[0], room)
