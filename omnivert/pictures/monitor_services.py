"""The table of services: who is there, how fast, what was lost, and what a person should know of it."""

from collections import deque
from itertools import pairwise
from typing import Any

from rich.table import Table
from rich.text import Text

from omnivert.config import Config
from omnivert.messages import Estimate, Health, Message, Playback, Receipt
from omnivert.pictures.plain import plain

ORDER = ("bridge", "player", "vision", "calibration", "storage", "recorder")
WITH_FRAMES = ("bridge", "vision", "calibration")  # they should go at the camera's rate
SILENT_S = 3.0  # health comes once a second

Beats = deque[tuple[float, Health]]  # when it came, what


class Services:
    """
    present  (service, instance) of whoever is there now
    """

    def __init__(self, config: Config) -> None:
        self.present: frozenset[tuple[str, str]] = frozenset()
        self._rate_hz = config.camera.frame_rate_hz
        self._health: dict[tuple[str, str], Beats] = {}
        self._arrivals: deque[float] = deque(maxlen=64)  # of estimates
        self._receipt: tuple[float, Receipt] | None = None
        self._playback: Playback | None = None

    @property
    def is_playing(self) -> bool:
        """Whether a recording plays in place of a robot."""
        return self._playback is not None and not self._playback.finished

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

    def table(self, now_s: float) -> Table:
        """One row for each service that is there or should be."""
        table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
        table.add_column(" services", min_width=16)
        for heading, width in (("rate", 8), ("expected", 8), ("longest gap", 11), ("lost", 5)):
            table.add_column(heading, justify="right", min_width=width)
        table.add_column("note", width=40, no_wrap=True, overflow="ellipsis")
        heard = {service for service, _ in self._health} | {service for service, _ in self.present}
        for service in ORDER:
            stands_in = service == "bridge" and "player" in heard
            if service in heard or not (stands_in or service in ("player", "recorder")):
                table.add_row(*self._row(service, now_s))
        return table

    def _row(self, service: str, now_s: float) -> tuple[Text, str, str, str, str, Text]:
        beats = self._newest(service)
        here = any(name == service for name, _ in self.present)
        if beats is None or now_s - beats[-1][0] > SILENT_S:
            gone = "not running" if not here else "no health message yet" if beats is None else "silent"
            return (Text(f" – {service}", style="dim"), "–", "", "", "", Text(gone, style="dim"))
        newest = beats[-1][1]
        rate = _rate(beats)
        live = self._playback is None
        expected = f"{self._rate_hz:.1f}" if service in WITH_FRAMES and live else ""
        lost = sum(newest.gaps.values()) + sum(newest.dropped.values())
        gap = self._longest_gap() if service == "calibration" else ""
        idle = service == "bridge" and rate is None and len(beats) > 1
        troubled = bool(lost or newest.refused or idle)
        sign, style = ("!", "yellow") if troubled else ("✓", "green")
        note = self._note(service, newest, now_s)
        shown = "–" if rate is None else f"{rate:.1f} Hz"
        return (Text(f" {sign} {service}", style=style), shown, expected, gap, str(lost), Text(note))

    def _newest(self, service: str) -> Beats | None:
        """The beats of the instance that was heard last."""
        known = [beats for (name, _), beats in self._health.items() if name == service and beats]
        return max(known, key=lambda beats: beats[-1][0], default=None)

    def _note(self, service: str, health: Health, now_s: float) -> str:
        notes = list(health.notes)
        if health.refused:
            reason, count = max(health.refused.items(), key=lambda item: item[1])
            notes.append(f"{count} refused: {reason}")
        if service == "storage" and self._receipt is not None:
            notes.insert(0, f"saved {now_s - self._receipt[0]:.0f} s ago (#{self._receipt[1].entry})")
        if service == "player" and self._playback is not None and self._playback.total:
            done = "finished" if self._playback.finished else "played"
            notes.insert(0, f"{100 * self._playback.played // self._playback.total} % {done}")
        if not notes and health.latency_p50_ms is not None:
            notes.append(f"{health.latency_p50_ms:.1f} ms a message, p99 {health.latency_p99_ms or 0.0:.1f}")
        return "; ".join(notes)

    def _longest_gap(self) -> str:
        gaps = [after - before for before, after in pairwise(self._arrivals)]
        return f"{1e3 * max(gaps):.0f} ms" if gaps else ""


def _rate(beats: Beats) -> float | None:
    """Messages published a second, over the last beats: of the busiest stream."""
    first, last = beats[0][1], beats[-1][1]
    apart = 1e-9 * (last.stamp_ns - first.stamp_ns)
    busiest = max((count - first.published.get(key, 0) for key, count in last.published.items()), default=0)
    return busiest / apart if apart > 0 and busiest > 0 else None
