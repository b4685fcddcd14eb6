"""What goes wrong with supervised services, told in one line each; some of it ends the whole."""

import re
import threading
from typing import TYPE_CHECKING

from rich.markup import escape

from omnivert.cli import say
from omnivert.cli.robot.supervisor import Event, Happened
from omnivert.errors import DataError
from omnivert.pictures.words import printable, short

if TYPE_CHECKING:
    from omnivert.wire.bus import Bus

START_S = 30.0  # for all services to come up on a busy machine
COMPILED_S = 180.0  # for those that have to compile their loops the first time
COMPILES = {"vision", "calibration"}
_LONG_S = 5  # then it is said why
_LAST_CHARACTERS = 60  # of what a service said before it died
HOPELESS = ("router",)  # without it nothing can be done, and starting it again will not open its end point
_AGAIN = "run it once more, on a machine that is less busy: what was compiled is kept"
REFUSAL = re.compile(r"error\[(OV\d+)\]: (.*)")


class Troubles:
    """Takes the supervisor's events: says what a person should know, and remembers what ends the whole.

    loud  also what services say themselves, and each start
    """

    def __init__(self, loud: bool = False) -> None:
        self._loud = loud
        self._said: dict[str, str] = {}  # service -> the refusal it printed
        self._last: dict[str, str] = {}  # service -> the line it said last
        self._untold: dict[str, str] = {}  # the same, as long as nobody was told of it
        self.fatal = threading.Event()
        self._reason: DataError | None = None

    def __call__(self, event: Event) -> None:
        match event.happened:
            case Happened.SAID:
                self._last[event.service] = event.text
                if not self._loud:
                    self._untold[event.service] = event.text
                refused = REFUSAL.search(event.text)
                if refused:
                    self._said[event.service] = event.text
                if self._loud:
                    text = escape(printable(event.text))
                    say.story(f"  [yellow]![/] {text}" if refused else f"  [dim]{text}[/]")
            case Happened.DIED if event.service in HOPELESS and event.service in self._said:
                self._end(event)
            case Happened.REFUSED:
                self._end(event)
            case Happened.DIED | Happened.KILLED:
                say.story(f"  [yellow]![/] {escape(str(event))}")
                if last := self._untold.pop(event.service, ""):
                    say.story(f"    [dim]it said last: {escape(short(printable(last), _LAST_CHARACTERS))}[/]")
            case Happened.STARTED | Happened.ENDED:
                pass

    def unresolved(self, service: str) -> str:
        """The refusal that the service said last, if it has said nothing since; "" when there is none."""
        said = REFUSAL.search(self._last.get(service, ""))
        return "" if said is None else said[2]

    def check(self) -> None:
        """raises  DataError when the whole can not go on"""
        if self._reason is not None:
            raise self._reason

    def _end(self, event: Event) -> None:
        said = REFUSAL.search(self._said.get(event.service, event.text))
        if said is None:
            self._reason = DataError("OV423", f"{event.service} does not start", event.text)
        else:
            code, what = said.groups()
            text, _, hint = what.partition(" (try: ")
            self._reason = DataError(code, f"{event.service}: {text}", help=hint.removesuffix(")"))
        self.fatal.set()


def await_services(bus: "Bus", services: set[str], troubles: Troubles) -> None:
    """Wait until all of them are there.

    raises  DataError when one does not come, KeyboardInterrupt when the bus was stopped
    """

    def here() -> bool:
        return services <= {name for name, _ in bus.present()}

    for second in range(int(COMPILED_S)):
        if bus.await_presence(here, 1.0) or bus.stopped:
            break
        troubles.check()
        lacking = services - {name for name, _ in bus.present()}
        if second == _LONG_S and lacking & COMPILES:
            say.story("  [cyan]…[/] compiling  the loops of the vision, once on this machine: half a minute or so")
        if second >= START_S and not lacking <= COMPILES:
            break
    if bus.stopped:
        raise KeyboardInterrupt
    if not here():
        missing = ", ".join(sorted(services - {name for name, _ in bus.present()}))
        raise DataError("OV422", f"{missing} did not come up in time", help=_AGAIN)
