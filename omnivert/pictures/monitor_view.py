"""One screen that says how the calibration stands, what to drive next, and which service is unwell."""

import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from omnivert.config import Config
from omnivert.messages import (
    Bearings,
    Estimate,
    Extrinsics,
    Message,
    Mount,
    ParameterVerdict,
    Receipt,
    State,
)
from omnivert.pictures.monitor_services import Services
from omnivert.pictures.plain import plain
from omnivert.pictures.words import Quantity, bounds, colour, counted, printable, quantities, short, word

BARS = "▁▂▃▄▅▆▇█"
HISTORY_S = 60.0
COLUMNS = 20  # of a sparkline
VERDICT_COLUMNS = 34
ALARM_SIGMAS = 4.0  # filter and smoother differ by more: the verdict says so, too
NEXT_LETTERS = 180  # two lines


class View:
    """What has been heard, and how it looks; asks neither clock nor bus.

    rate_known  whether the configuration says how often this robot's camera gives a frame
    """

    def __init__(self, config: Config, where: str, rate_known: bool = True) -> None:
        self._config = config
        self._where = where
        self._estimate: tuple[float, Estimate] | None = None  # when it came, what
        self._claims: deque[Extrinsics] = deque(maxlen=32)  # not stored before their receipt comes
        self._stored: tuple[float, Extrinsics] | None = None
        self._services = Services(config, rate_known)
        self._sigmas: deque[tuple[float, tuple[float, float, float]]] = deque()
        self._seen: deque[tuple[float, np.ndarray]] = deque(maxlen=64)

    def step(self, message: Message, now_s: float) -> None:
        """Take one message that came at this time."""
        self._services.step(message, now_s)
        while self._sigmas and now_s - self._sigmas[0][0] > HISTORY_S:
            self._sigmas.popleft()
        match message:
            case Estimate():
                self._estimate = (now_s, message)
                if message.mount is not None:
                    phi, rho, psi = quantities(message.mount)
                    self._sigmas.append((now_s, (phi.sigma, rho.sigma, psi.sigma)))
            case Bearings():
                self._seen.append((now_s, message.bearing_rad))
            case Extrinsics():
                self._claims.append(message)
            case Receipt():
                self.acknowledge(message, now_s)
            case _:
                pass

    def acknowledge(self, receipt: Receipt, now_s: float) -> None:
        """Of what was claimed, this is stored."""
        whose = (receipt.stamp_ns, receipt.robot, receipt.camera)
        for claim in self._claims:
            if (claim.stamp_ns, claim.robot, claim.camera) == whose:
                self._stored = (now_s, claim)

    def present(self, services: frozenset[tuple[str, str]]) -> None:
        """Which services are there now, as (service, instance)."""
        self._services.present = services

    def line(self, now_s: float) -> str:
        """The whole state in one line, for a pipe."""
        following = self._following(now_s)[0]
        if self._estimate is None:
            stored = "" if self._stored is None else f" stored {_numbers(self._stored[1].mount)}"
            return f"{now_s:.1f}s {State.WAITING.value}{stored} {following}"
        age, estimate = now_s - self._estimate[0], self._estimate[1]
        numbers = "" if estimate.mount is None else f" {_numbers(estimate.mount)}"
        stale = f" stale={age:.1f}s" if self._stale(age) else ""
        tail = f' next="{following}"' if following else ""
        state = "not_running" if self._is_dead(now_s) else estimate.state.value
        return f"{1e-9 * estimate.stamp_ns:.1f}s {state}{numbers}{stale}{tail}"

    def screen(self, now_s: float, once: bool = False) -> RenderableType:
        """The whole screen, 100 columns.

        once  it stays as it is, so there is nothing to quit
        """
        return Group(
            self._header(now_s),
            Rule(style="dim", characters="─"),
            self._next(now_s),
            Text(""),
            self._numbers(now_s),
            self._drive(),
            Text(""),
            self._lines(),
            Text(""),
            self._services.table(now_s),
            Text(""),
            self._footer(now_s, once),
        )

    def json(self) -> dict[str, Any]:
        """The whole state as plain values."""
        estimate = None if self._estimate is None else self._estimate[1]
        return {
            "robot": self._config.robot.id,
            "camera": self._config.camera.id,
            "state": State.WAITING.value if estimate is None else estimate.state.value,
            "estimate": plain(estimate),
            "stored": None if self._stored is None else plain(self._stored[1]),
            "services": self._services.json(),
        }

    def _stale(self, age_s: float) -> bool:
        return age_s > max(3.0 * self._services.period_s, 1.0)

    def _is_dead(self, now_s: float) -> bool:
        """Whether nothing of the robot runs (any more)."""
        stale = self._estimate is None or self._stale(now_s - self._estimate[0])
        return stale and not self._services.there

    def _header(self, now_s: float) -> RenderableType:
        state = self._state()
        badge, shade = word(state).upper(), colour(state)
        if self._estimate is not None and self._is_dead(now_s):
            badge, shade = "NOT RUNNING", colour(State.WAITING)
        row = Table.grid(expand=True)
        row.add_column(ratio=1)
        row.add_column(justify="center")
        row.add_column(ratio=1, justify="right")
        name = Text.assemble((" omnivert", "bold"), f"  robot {self._config.robot.id}")
        row.add_row(name, Text(f" {badge} ", style=f"bold white on {shade}"), self._age(now_s))
        return row

    def _age(self, now_s: float) -> Text:
        if self._estimate is None:
            return Text("nothing yet ", style="dim")
        age = now_s - self._estimate[0]
        if age > max(10.0 * self._services.period_s, 3.0):
            return Text(f"SILENT  last frame {age:.0f} s ago ", style="bold red")
        if self._stale(age):
            return Text(f"late  {age:.1f} s old ", style="yellow")
        kind = "playing" if self._services.is_playing else "live"
        return Text(f"{kind}  {age:.2f} s old ", style="green")

    def _next(self, now_s: float) -> RenderableType:
        calm = "nothing is missing" if self._state() is State.CALIBRATED else "drive on"
        first, *more = self._following(now_s)
        lines = [Text.assemble((" NEXT  ", "bold"), (short(first or calm, NEXT_LETTERS), "bold"))]
        if self._estimate is not None and not self._is_dead(now_s):
            estimate = self._estimate[1]
            long = [part.reason for part in _parts(estimate) if len(_in_words(part)) > VERDICT_COLUMNS]
            more += [f"{reason[:1].upper()}{reason[1:]}" for reason in dict.fromkeys([*estimate.reasons, *long])]
        for text in more[:2]:
            lines.append(Text(f"       {printable(text)}", style="dim", no_wrap=True, overflow="ellipsis"))
        return Group(*lines)

    def _following(self, now_s: float) -> list[str]:
        """What to do next, the most urgent first: a service to start, a device to connect, a way to drive."""
        estimate = None if self._estimate is None else self._estimate[1]
        lacking = self._estimate is None or self._stale(now_s - self._estimate[0])
        if self._is_dead(now_s):
            return [self._missing()]
        if todo := self._services.todo(now_s):
            return todo
        if lacking and (estimate is None or not self._services.there >= {"vision", "calibration"}):
            return [self._missing()]
        return [printable(estimate.next_manoeuvre) if estimate is not None else ""]

    def _state(self) -> State:
        return State.WAITING if self._estimate is None else self._estimate[1].state

    def _missing(self) -> str:
        """What has to come before anything can be said."""
        there = self._services.there
        if not there:
            return "no service answers; start them with: omnivert up --config robot.toml"
        source = "no camera or player yet" if not there & {"bridge", "player"} else "no frame yet"
        lacking = [name for name in ("vision", "calibration") if name not in there]
        return f"{' and '.join(lacking)} not running" if lacking else source

    def _numbers(self, now_s: float) -> RenderableType:
        table = Table(box=None, padding=(0, 2, 0, 1), header_style="dim", expand=False)
        for heading, justify, width in (
            ("", "left", 4),
            ("estimate", "right", 11),
            ("1 sigma", "right", 7),
            ("best", "right", 6),
        ):
            table.add_column(heading, justify=justify, min_width=width)  # type: ignore[arg-type]
        table.add_column("verdict", width=VERDICT_COLUMNS)
        table.add_column("last 60 s, sigma", width=COLUMNS)
        estimate = None if self._estimate is None else self._estimate[1]
        stale = self._estimate is not None and self._stale(now_s - self._estimate[0])
        mount = None if estimate is None else estimate.mount
        parts: Iterable[Quantity | None] = (None, None, None) if mount is None else quantities(mount)
        best = ("–",) * 3 if estimate is None else bounds(estimate)
        verdicts = (ParameterVerdict(State.WAITING),) * 3 if estimate is None else _parts(estimate)
        for index, (part, verdict) in enumerate(zip(parts, verdicts, strict=True)):
            value = "–" if part is None else f"{part.value_text} {part.unit}"
            sigma = "–" if part is None else part.sigma_text
            words = _in_words(verdict)
            shade = "dim" if stale else colour(verdict.state)
            words = words if len(words) <= VERDICT_COLUMNS else word(verdict.state)  # the reason stands above
            table.add_row(
                ("phi", "rho", "psi")[index],
                Text(value, style="dim" if stale else "bold"),
                Text(sigma, style="dim" if stale else ""),
                Text(best[index], style="dim"),
                Text(words, style=shade),
                Text(self._spark(index, now_s), style="dim"),
            )
        return table

    def _spark(self, index: int, now_s: float) -> str:
        """The last minute's sigma, by its logarithm, newest at the right."""
        slots: list[float | None] = [None] * COLUMNS
        for came_s, sigmas in self._sigmas:
            slot = COLUMNS - 1 - int((now_s - came_s) / HISTORY_S * COLUMNS)
            if 0 <= slot < COLUMNS and sigmas[index] > 0:
                slots[slot] = math.log(sigmas[index])
        known = [slot for slot in slots if slot is not None]
        if not known:
            return ""
        low, span = min(known), max(max(known) - min(known), 0.7)
        return "".join(
            " " if slot is None else BARS[min(int((slot - low) / span * len(BARS)), len(BARS) - 1)] for slot in slots
        )

    def _drive(self) -> RenderableType:
        if self._estimate is None:
            return Text("")
        estimate = self._estimate[1]
        text = f" drive so far: {estimate.driven_m:.1f} m, {math.degrees(estimate.turned_rad):.0f} deg turned"
        text = f"{text}, {estimate.frame} frames"
        if estimate.smoother is not None:
            agree = "agree" if estimate.disagreement < ALARM_SIGMAS else "DIFFER"
            text = f"{text}    filter and smoother {agree} ({estimate.disagreement:.1f} sigma)"
        return Text(text, style="dim", no_wrap=True, overflow="ellipsis")

    def _lines(self) -> RenderableType:
        if self._estimate is None:
            return Text(" lines    –", style="dim")
        e = self._estimate[1]
        used, new, rejected = map(counted, (e.lines_used, e.lines_new, e.lines_rejected))
        text = f" lines    {used} used   {new} new   {rejected} rejected"
        return Text(f"{text:<42}by direction  {self._directions()}")

    def _directions(self) -> str:
        """How many lines were seen lately in each sixteenth, counter-clockwise from ahead of the camera."""
        bearings = [bearing for _, bearing in self._seen]
        if not bearings or not sum(len(b) for b in bearings):
            return "–"
        turn = np.mod(np.concatenate(bearings) + math.pi / 16, math.tau) / math.tau
        counts = np.bincount((turn * 16).astype(int) % 16, minlength=16)
        bars = [BARS[min(int(8 * count / counts.max()), 7)] if count else " " for count in counts]
        return "  ".join(
            f"{name} {''.join(bars[i : i + 4])}" for name, i in (("ahead", 0), ("left", 4), ("back", 8), ("right", 12))
        )

    def _footer(self, now_s: float, once: bool) -> RenderableType:
        stored = "nothing stored yet"
        if self._stored is not None:
            came_s, extrinsics = self._stored
            stored = f"stored: {_numbers(extrinsics.mount)}  {word(extrinsics.state)}, {now_s - came_s:.0f} s ago"
        shown = Text(f" {stored}", style="dim", no_wrap=True, overflow="ellipsis")
        ends = "" if once else "   ctrl-c quits"
        return Group(shown, Text(f" {self._where}{ends}", style="dim", justify="right"))


def _parts(estimate: Estimate) -> tuple[ParameterVerdict, ParameterVerdict, ParameterVerdict]:
    return estimate.phi, estimate.rho, estimate.psi


def _in_words(verdict: ParameterVerdict) -> str:
    return printable(f"{word(verdict.state)}: {verdict.reason}" if verdict.reason else word(verdict.state))


def _numbers(mount: Mount) -> str:
    return "  ".join(f"{q.name} {q}" for q in quantities(mount))
