"""The table of services: who is there, how fast, what was lost, and what a person should know of it."""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from omnivert.config import Config
from omnivert.messages import Estimate, Health, Message, Playback, Receipt
from omnivert.pictures import notes
from omnivert.pictures.plain import plain
from omnivert.pictures.words import counted, printable
from omnivert.wire.channels import BEARINGS, ESTIMATE, FRAME, TICKS, channel_from_key

SOURCES = ("bridge", "player")  # either gives both the camera's row and the encoder's
ORDER = (*SOURCES, "vision", "calibration", "storage", "recorder")
STREAMS = {"camera": FRAME, "encoder": TICKS, "vision": BEARINGS, "calibration": ESTIMATE}  # row -> whose rate
WITH_FRAMES = ("camera", "vision", "calibration")  # they should go at the camera's rate
SILENT_S = 3.0  # health comes once a second
SHORTEST_S = 0.5  # a rate from less would be chance
NOTE_COLUMNS = 40
LONG_NOTES = 2  # that get a line of their own

Beats = deque[tuple[float, Health]]  # when it came, what


@dataclass(frozen=True, slots=True)
class Row:
    """What stands in one row."""

    name: str
    mark: str  # ✓, ! or –
    rate: str = "–"
    expected: str = ""
    gap: str = ""
    lost: str = ""
    note: str = ""

    @property
    def style(self) -> str:
        return {"✓": "green", "!": "yellow"}.get(self.mark, "dim")


class Services:
    """
    present  (service, instance) of whoever is there now

    rate_known  whether the configuration says how often this robot's camera gives a frame
    """

    def __init__(self, config: Config, rate_known: bool = True) -> None:
        self.present: frozenset[tuple[str, str]] = frozenset()
        self._rate_hz = config.camera.frame_rate_hz if rate_known else None
        self._health: dict[tuple[str, str], Beats] = {}
        self._arrivals: deque[float] = deque(maxlen=64)  # of estimates
        self._receipt: tuple[float, Receipt] | None = None
        self._playback: Playback | None = None

    @property
    def is_playing(self) -> bool:
        """Whether a recording plays in place of a robot."""
        return self._playback is not None and not self._playback.finished

    @property
    def there(self) -> frozenset[str]:
        """The robot's own services that are there; others only listen."""
        return frozenset(name for name, _ in self.present if name in ORDER)

    @property
    def period_s(self) -> float:
        """Between two estimates: as it should be, or, where nobody says so, as it mostly was."""
        if self._rate_hz is not None:
            return 1.0 / self._rate_hz
        return median(self._gaps()) if len(self._arrivals) > 2 else 1.0

    def step(self, message: Message, now_s: float) -> None:
        """Take one message that came at this time."""
        match message:
            case Estimate():
                self._arrivals.append(now_s)
            case Receipt():
                self._receipt = (now_s, message)
            case Playback():
                self._playback = message
            case Health():
                beats = self._health.setdefault((message.service, message.instance), deque(maxlen=4))
                if beats and message.uptime_s < beats[-1][1].uptime_s:
                    beats.clear()  # it has been started anew
                beats.append((now_s, message))
            case _:
                pass

    def json(self) -> list[dict[str, Any]]:
        """Whoever is there or was heard, each with its newest health message."""
        newest = {name: plain(beats[-1][1]) for name, beats in self._health.items() if beats}
        return [
            {"service": name[0], "instance": name[1], "present": name in self.present, "health": newest.get(name)}
            for name in sorted(self.present | newest.keys())
        ]

    def todo(self, now_s: float) -> list[str]:
        """What a person should do before anything else, as the services' notes have it."""
        fresh = [beats for service in ORDER if (beats := self._newest(service)) and self._is_fresh(beats, now_s)]
        return [printable(text) for beats in fresh for note in beats[-1][1].notes if (text := notes.todo(note))]

    def table(self, now_s: float) -> RenderableType:
        """One row for each service that is there or should be; long troubles below it."""
        table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
        table.add_column(" services", min_width=16)
        for heading, width in (("rate", 8), ("expected", 8), ("longest gap", 11), ("lost", 5)):
            table.add_column(heading, justify="right", min_width=width)
        table.add_column("note", width=NOTE_COLUMNS, no_wrap=True, overflow="ellipsis")
        long: list[Text] = []
        for row in self._rows(now_s):
            note = row.note
            if row.mark == "!" and len(note) > NOTE_COLUMNS and len(long) < LONG_NOTES:
                text = f"   {row.name}: {row.note}"
                long.append(Text(text, style=row.style, no_wrap=True, overflow="ellipsis"))
                note = "see below"
            name = Text(f" {row.mark} {row.name}", style=row.style)
            table.add_row(name, row.rate, row.expected, row.gap, row.lost, Text(note))
        return Group(table, *long)

    def _rows(self, now_s: float) -> list[Row]:
        source = max(SOURCES, key=lambda name: (name in self.there, self._heard_s(name)))
        rows = [self._sensor(name, source, now_s) for name in ("camera", "encoder")]
        heard = {service for service, _ in self._health} | self.there
        for service in ORDER:
            if service != "bridge" and (service in heard or service not in ("player", "recorder")):
                rows.append(self._service(service, now_s))
        return rows

    def _sensor(self, name: str, source: str, now_s: float) -> Row:
        """The row of one of the bridge's devices, or of what a player plays in its place."""
        beats = self._newest(source)
        if beats is None or not self._is_fresh(beats, now_s):
            return self._absent(name, source, beats is None, f"{source} ")
        newest = beats[-1][1]
        rate = _rate(beats, name)
        mine = [note for note in newest.notes if note.startswith(f"{name}:")] if source == "bridge" else []
        refused = {reason: times for reason, times in newest.refused.items() if name in reason}
        finished = source == "player" or any(map(notes.is_of_the_end, mine))
        idle = rate is None and _span_s(beats) >= SHORTEST_S and not finished
        troubled = idle or bool(refused and source == "bridge") or not all(map(notes.is_harmless, mine))
        text = _in_one(mine, refused if source == "bridge" else {})
        return Row(name, "!" if troubled else "✓", _hz(rate), self._expected(name), note=text)

    def _service(self, service: str, now_s: float) -> Row:
        beats = self._newest(service)
        if beats is None or not self._is_fresh(beats, now_s):
            return self._absent(service, service, beats is None)
        newest = beats[-1][1]
        told = [note for note in newest.notes if not (notes.is_of_the_beginning(note) and self._arrivals)]
        lost = sum(newest.gaps.values()) + sum(newest.dropped.values())
        troubled = bool(lost or newest.refused) or not all(map(notes.is_harmless, told))
        return Row(
            service,
            "!" if troubled else "✓",
            _hz(_rate(beats, service)) if service in STREAMS else "",
            self._expected(service),
            self._longest_gap() if service == "calibration" else "",
            counted(lost),
            self._note(service, newest, told, now_s),
        )

    def _absent(self, name: str, service: str, unheard: bool, whose: str = "") -> Row:
        gone = "not running" if service not in self.there else "no health message yet" if unheard else "silent"
        said = f"{whose}{gone}" if gone == "not running" else gone
        return Row(name, "–", note=said)

    def _is_fresh(self, beats: Beats, now_s: float) -> bool:
        return now_s - beats[-1][0] <= SILENT_S

    def _newest(self, service: str) -> Beats | None:
        """The beats of the instance that was heard last."""
        known = [beats for (name, _), beats in self._health.items() if name == service and beats]
        return max(known, key=lambda beats: beats[-1][0], default=None)

    def _heard_s(self, service: str) -> float:
        beats = self._newest(service)
        return float("-inf") if beats is None else beats[-1][0]

    def _expected(self, name: str) -> str:
        if name not in WITH_FRAMES or self._playback is not None:
            return ""
        return "–" if self._rate_hz is None else f"{self._rate_hz:.1f}"

    def _note(self, service: str, health: Health, told: list[str], now_s: float) -> str:
        first: list[str] = []
        if service == "storage" and self._receipt is not None:
            first.append(f"saved {now_s - self._receipt[0]:.0f} s ago (#{counted(self._receipt[1].entry)})")
        if service == "player" and self._playback is not None and self._playback.total:
            done = "finished" if self._playback.finished else "played"
            first.append(f"{100 * min(self._playback.played / self._playback.total, 1.0):.0f} % {done}")
        text = _in_one([*first, *told], health.refused)
        if not text and health.latency_p50_ms is not None:
            return f"{health.latency_p50_ms:.1f} ms a message, p99 {health.latency_p99_ms or 0.0:.1f}"
        return text

    def _gaps(self) -> list[float]:
        return [after - before for before, after in pairwise(self._arrivals)]

    def _longest_gap(self) -> str:
        return f"{counted(1e3 * max(gaps))} ms" if (gaps := self._gaps()) else ""


def _in_one(told: list[str], refused: dict[str, int]) -> str:
    """Notes and the most frequent refusal; troubles first."""
    texts = [*sorted(told, key=notes.is_harmless), notes.counted_reasons(refused)]
    return printable("; ".join(filter(None, texts)))


def _span_s(beats: Beats) -> float:
    return 1e-9 * (beats[-1][1].stamp_ns - beats[0][1].stamp_ns)


def _rate(beats: Beats, row: str) -> float | None:
    """Messages of the row's stream that were published a second, over the last beats."""
    first, last = beats[0][1].published, beats[-1][1].published
    keys = [key for key in last if channel_from_key(key) is STREAMS.get(row)]
    count = sum(last[key] - first.get(key, 0) for key in keys)
    return count / _span_s(beats) if _span_s(beats) >= SHORTEST_S and count > 0 else None


def _hz(rate: float | None) -> str:
    return "–" if rate is None else f"{counted(rate, 1)} Hz"
