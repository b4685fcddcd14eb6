"""How the command line speaks: the result on stdout, the story on stderr, every refusal in one form."""

import codecs
import json
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from omnivert.errors import OmnivertError

T = TypeVar("T")

COLUMNS = 100  # of what is told in sentences, and of tables
MUCH_BYTES = 5_000_000

PLAIN = {
    "±": "+-", "✓": "v", "✗": "x", "–": "-", "·": "|", "─": "-", "━": "-", "▶": ">", "°": " deg", "φ": "phi",
    "ρ": "rho", "ψ": "psi", "…": "...", "→": "->",
    "▁": "_", "▂": ".", "▃": ":", "▄": "-", "▅": "=", "▆": "+", "▇": "*", "█": "#",
}  # fmt: skip


def _plainly(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(character, "?") for character in text), error.end


def streams_in_place() -> None:
    """Before the first word: streams that were closed lead nowhere, and who knows no UTF-8 gets plain letters."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: else the next file that is opened would stand there, and be written into
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
    codecs.register_error("omnivert-plain", _plainly)
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="omnivert-plain")


def out() -> Console:
    """Where results go."""
    return Console(highlight=False, soft_wrap=True)


def err() -> Console:
    """Where the story goes."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def story(text: str) -> None:
    """One line of what is being done; may hold rich markup."""
    sys.stdout.flush()  # where both go to one place, they keep their order
    err().print(text)


def folded(text: str, indent: int = 0, columns: int = COLUMNS) -> list[str]:
    """Lines of at most so many columns; those after the first begin so far in. A word that is longer stays whole."""
    rest = " " * indent
    return textwrap.wrap(text, columns, subsequent_indent=rest, break_long_words=False, break_on_hyphens=False)


def note(text: str) -> None:
    """What somebody should know of what was done, in as many lines as it takes."""
    first, *more = folded(f"note    {text}", 8)
    for line in (f"[yellow]note[/]{escape(first.removeprefix('note'))}", *map(escape, more)):
        story(line)


def following(command: str) -> None:
    """The command to type next, as a shell takes it."""
    story(f"next    {escape(command)}")


def wrote(path: Path) -> None:
    """A file or a folder, and how large it is where that is much."""
    size = sum(file.stat().st_size for file in ([path] if path.is_file() else path.glob("*")))
    told = f"   {size / 1e6:.0f} MB" if size >= MUCH_BYTES else ""
    story(f"wrote   {escape(f'{path}{told}')}")


def result(text: str) -> None:
    """A line of the result, as it is."""
    out().print(text, markup=False)


def json_result(value: dict[str, Any]) -> None:
    """The whole result as one JSON object; numbers that are not finite become null."""
    sys.stdout.write(json.dumps(_finite(value), ensure_ascii=True) + "\n")
    sys.stdout.flush()


def _finite(value: Any) -> Any:
    match value:
        case dict():
            return {str(key): _finite(item) for key, item in value.items()}
        case list() | tuple():
            return [_finite(item) for item in value]
        case float():
            return value if abs(value) <= sys.float_info.max else None
        case _:
            return value


def refusal_json(error: OmnivertError) -> dict[str, str]:
    return {"code": error.code, "what": error.what, "because": error.because, "help": error.help}


def refuse(error: OmnivertError, known: str = "", also: str = "") -> None:
    """Code and sentence, why, what is known all the same, and what to type next; on stderr.

    also  a second line under help
    """
    console = err()
    console.print(f"[bold red]error[/][bold]\\[{error.code}][/]: [bold]{escape(error.what)}[/]")
    rows = (("because", error.because), ("known", known), ("help", error.help), ("", also))
    for name, text in rows:
        if text:
            first, *rest = text.splitlines()
            console.print(f"  [cyan]{name:<8}[/] {escape(first)}")
            for line in rest:
                console.print(f"           {escape(line)}")


@contextmanager
def progress(label: str, total: int | None) -> Iterator["Bar"]:
    """A bar with an estimate of the rest on a terminal; nothing in a pipe."""
    console = err()
    if not console.is_terminal:
        yield Bar(total, lambda *_: None)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=40),
        TaskProgressColumn(),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(label, total=total)
        yield Bar(
            total,
            lambda done, of: bar.update(task, completed=done, total=of),
            lambda text: bar.update(task, description=escape(text)),
        )


@contextmanager
def status() -> Iterator[Callable[[str], None]]:
    """A line that is written anew each time, on a terminal; nothing in a pipe."""
    console = err()
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("") as line:
        yield lambda text: line.update(escape(text))


class Bar:
    """How far a long step is."""

    def __init__(
        self,
        total: int | None,
        moved: Callable[[int, int | None], None],
        labelled: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._total = total
        self._moved = moved
        self._labelled = labelled
        self._done = 0

    def step(self) -> None:
        """One more is done."""
        self.reach(self._done + 1, self._total)

    def label(self, text: str) -> None:
        """What is being done now."""
        self._labelled(text)

    def reach(self, done: int, total: int | None) -> None:
        """So many of so many are done."""
        self._done, self._total = done, total
        self._moved(done, total)


def counted(items: Iterable[T], label: str, total: int | None) -> Iterator[T]:
    """The items, with a progress bar."""
    with progress(label, total) as bar:
        for item in items:
            yield item
            bar.step()
