"""What the checks have found, as lines for people and as plain values."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from omnivert import __version__
from omnivert.doctor.evidence import Evidence
from omnivert.doctor.finding import Status
from omnivert.doctor.table import Checked
from omnivert.pictures.words import printable

MARKS = {Status.FINE: "✓", Status.WORSE: "!", Status.STOPS: "✗", Status.UNCHECKED: "–"}
GROUP_COLUMNS, MARK_COLUMNS = 11, 2


@dataclass(frozen=True, slots=True)
class Line:
    """One line: the heading of a group or blanks, a mark or blanks, text.

    status    colours the mark; None where it goes on with the one before
    is_whole  the text alone, from edge to edge
    """

    group: str
    mark: str
    text: str
    status: Status | None = None
    is_whole: bool = False

    def __str__(self) -> str:
        if self.is_whole:
            return self.text
        return f"{self.group:<{GROUP_COLUMNS}}{self.mark:<{MARK_COLUMNS}}{self.text}".rstrip()


@dataclass(frozen=True, slots=True)
class Report:
    """The findings of one look at a robot or a recording."""

    title: tuple[str, ...]
    checks: tuple[Checked, ...]

    @classmethod
    def of(cls, evidence: Evidence, checks: Sequence[Checked]) -> "Report":
        host = evidence.host
        about = f"robot {evidence.config.robot.id}"
        place = evidence.source or "no configuration named"
        parts = (f"omnivert {__version__}", f"Python {host.python}", host.system, about, place)
        return cls(parts, tuple(checks))

    @property
    def first(self) -> Checked | None:
        """The cause: the first check that found something wrong."""
        return next((check for check in self.checks if check.finding.status in (Status.STOPS, Status.WORSE)), None)

    def named(self, status: Status) -> list[str]:
        return [check.name for check in self.checks if check.finding.status is status]

    @property
    def stops(self) -> bool:
        return bool(self.named(Status.STOPS))

    def lines(self, columns: int) -> Iterator[Line]:
        """Title, one line or more for each check, and the sum of it all."""
        yield from map(_whole, _joined(self.title, columns))
        yield _whole("")
        group = ""
        width = max(columns - GROUP_COLUMNS - MARK_COLUMNS, 20)
        for checks in self._together():
            check, found = checks[0], checks[0].finding
            heading, group = (check.group if check.group != group else ""), check.group
            mark, fact = MARKS[found.status], found.fact
            if found.status is Status.UNCHECKED:
                fact = f"{', '.join(c.name for c in checks)} not checked: {fact}"
            for text in _wrapped(fact, width, ""):
                yield Line(heading, mark, text, found.status if mark else None)
                heading = mark = ""
            for text in (*_wrapped(found.reason, width, "  "), *_wrapped(found.help, width, "  ", "help: ")):
                yield Line("", "", text)
        yield _whole("")
        yield from (_whole(part) for part in textwrap.wrap(self.sum, columns))

    def _together(self) -> Iterator[list[Checked]]:
        """Each check alone; those of a group that were not asked for the same reason as one."""
        for _, same in groupby(enumerate(self.checks), key=_likeness):
            yield [check for _, check in same]

    @property
    def sum(self) -> str:
        stops, worse, unchecked = (self.named(s) for s in (Status.STOPS, Status.WORSE, Status.UNCHECKED))
        parts = []
        if stops:
            parts.append(f"{_count(len(stops), 'problem')} {'stops' if len(stops) == 1 else 'stop'} the calibration")
            parts[-1] += f" ({', '.join(stops)})"
        if worse:
            verb = "makes" if len(worse) == 1 else "make"
            what = str(len(worse)) if stops else _count(len(worse), "thing")
            parts.append(f"{what} {verb} it worse ({', '.join(worse)})")
        if not parts:
            parts.append("nothing stands in the way of a calibration")
        if unchecked:
            parts.append(f"{len(unchecked)} not checked")
        text = ", ".join(parts) + "."
        return text[0].upper() + text[1:]

    def json(self) -> dict[str, Any]:
        return {
            "omnivert": __version__,
            "title": " · ".join(self.title),
            "healthy": self.first is None,
            "first": None if self.first is None else self.first.name,
            "stops": self.named(Status.STOPS),
            "worse": self.named(Status.WORSE),
            "unchecked": self.named(Status.UNCHECKED),
            "checks": [
                {
                    "name": check.name,
                    "group": check.group,
                    "status": check.finding.status.value,
                    "fact": check.finding.fact,
                    "reason": check.finding.reason,
                    "help": check.finding.help,
                }
                for check in self.checks
            ],
        }


def _wrapped(text: str, width: int, indent: str, first: str = "") -> list[str]:
    if not text:
        return []
    rest = " " * len(first)
    return textwrap.wrap(
        printable(text),
        width,
        initial_indent=indent + first,
        subsequent_indent=indent + rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _joined(parts: tuple[str, ...], columns: int) -> list[str]:
    """As many parts on a line as it holds."""
    lines = [parts[0]]
    for part in parts[1:]:
        if len(lines[-1]) + len(part) + 3 <= columns:
            lines[-1] += f" · {part}"
        else:
            lines.append(part)
    return lines


def _whole(text: str) -> Line:
    return Line("", "", text, is_whole=True)


def _likeness(numbered: tuple[int, Checked]) -> tuple[str, str | int]:
    """Alike for neighbours that are told as one."""
    number, check = numbered
    found = check.finding
    return check.group, found.fact if found.status is Status.UNCHECKED else number


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
