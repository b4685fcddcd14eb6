"""The services as child processes: started, started again when they die, stopped together, none left behind."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

from omnivert.cli.interrupts import held_back
from omnivert.errors import UseError

_STOP_S = 4.0  # for all that stand on the router, to end by themselves; after 2.5 s they end themselves by force
_ROUTER_S = 0.5  # and then for the router, beside what they have left of theirs
_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 5.0
_HEALTHY_S = 10.0  # who lived for so long begins again with the first pause


class Happened(StrEnum):
    STARTED = "started"
    SAID = "said"  # a line on its standard error
    DIED = "died"  # is started again
    ENDED = "ended"  # by itself, all done
    REFUSED = "refused"  # wrong use: to start it again would not help
    KILLED = "killed"  # did not stop when told to


@dataclass(frozen=True, slots=True)
class Event:
    """What a service did; `text` says it to a person."""

    service: str
    happened: Happened
    text: str

    def __str__(self) -> str:
        return f"{self.service} {self.text}"


@dataclass(slots=True)
class _Child:
    service: str
    command: list[str]
    process: subprocess.Popen[bytes] | None = None
    keeper: threading.Thread | None = None
    over: threading.Event = field(default_factory=threading.Event)  # it is not started again
    last_line: str = ""


class Supervisor:
    """Looks after services; as a context manager it leaves none behind.

    The child's standard input stays open as long as this process lives: when it ends, also by `kill -9`, they stop.

    config  the file that every service is started with
    report  called with each event, from the supervisor's threads, one call at a time
    """

    def __init__(self, config: Path, report: Callable[[Event], None]) -> None:
        self._config = config
        self._report = report
        self._reporting = threading.Lock()
        self._children: dict[str, _Child] = {}
        self._lock = threading.Lock()  # of starting against stopping
        self._stopping = threading.Event()
        self._term: Any = None

    def __enter__(self) -> Self:
        """From here on SIGTERM ends the `with` as ctrl-c does, where nobody else takes it."""
        in_main = threading.current_thread() is threading.main_thread()
        if in_main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            self._term = signal.signal(signal.SIGTERM, _leave)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with held_back():  # cut short, it would leave services behind
            self.stop()
        if self._term is not None:
            signal.signal(signal.SIGTERM, self._term)

    def start(self, service: str, *arguments: str) -> None:
        """Starts `python -m services.<service>`; the one started first carries the others and is stopped last."""
        if service in self._children:
            raise ValueError(f"{service} is started already")
        # -P: a folder called services in the working directory is not ours.
        base = [sys.executable, "-P", "-m", f"services.{service}", "--config", str(self._config), "--supervised"]
        child = _Child(service, [*base, *arguments])
        self._children[service] = child
        child.keeper = threading.Thread(target=self._keep, args=(child,), name=f"keep-{service}", daemon=True)
        child.keeper.start()

    def wait(self, service: str, timeout_s: float | None = None) -> bool:
        """Waits until a service is over: ended by itself, refused, or stopped; whether it is."""
        return self._children[service].over.wait(timeout_s)

    def wait_for_signal(self) -> None:
        """Returns with ctrl-c or SIGTERM, or when every service is over."""
        with suppress(KeyboardInterrupt):
            while not all(child.over.wait(0.2) for child in self._children.values()):
                pass

    def pid(self, service: str) -> int | None:
        """Its process now; None between two."""
        process = self._children[service].process
        return process.pid if process is not None and process.poll() is None else None

    def stop(self) -> None:
        """Stops all within 5 s; who does not stop is killed."""
        with self._lock:
            self._stopping.set()
        children = list(self._children.values())
        deadline = time.monotonic() + _STOP_S
        self._stop(children[1:], deadline)
        self._stop(children[:1], deadline + _ROUTER_S)
        for child in children:
            if child.keeper is not None:
                child.keeper.join()

    # ------------------------------------------------------------------ one child

    def _keep(self, child: _Child) -> None:
        """Starts a child again and again, until it is over."""
        pause_s = _FIRST_PAUSE_S
        try:
            while True:
                with self._lock:
                    if self._stopping.is_set():
                        return
                    child.process = process = subprocess.Popen(
                        child.command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
                    )
                began = time.monotonic()
                self._tell(child, Happened.STARTED, f"started (process {process.pid})")
                code = self._ended(child, process)
                if self._stopping.is_set():
                    return
                if code == 0:
                    self._tell(child, Happened.ENDED, "ended")
                    return
                if code == UseError.exit_code:
                    self._tell(child, Happened.REFUSED, f"refused to start: {child.last_line}")
                    return
                pause_s = _FIRST_PAUSE_S if time.monotonic() - began > _HEALTHY_S else pause_s
                self._tell(child, Happened.DIED, f"died ({_words(code)}); starts again in {pause_s:.1f} s")
                if self._stopping.wait(pause_s):
                    return
                pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)
        finally:
            child.over.set()

    def _ended(self, child: _Child, process: subprocess.Popen[bytes]) -> int:
        """Passes on what it says until it ends; returns its exit code."""
        assert process.stderr is not None
        with process.stderr as lines:
            for line in lines:
                child.last_line = line.decode(errors="replace").rstrip()
                self._tell(child, Happened.SAID, child.last_line)
        code = process.wait()
        if process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
        return code

    def _stop(self, children: list[_Child], deadline: float) -> None:
        processes = [(child, child.process) for child in children if child.process is not None]
        for _, process in processes:
            with suppress(ProcessLookupError):
                process.terminate()
        for child, process in processes:
            try:
                process.wait(max(deadline - time.monotonic(), 0.01))
            except subprocess.TimeoutExpired:
                with suppress(ProcessLookupError):
                    process.kill()
                process.wait()
                self._tell(child, Happened.KILLED, "did not stop and was killed")

    def _tell(self, child: _Child, happened: Happened, text: str) -> None:
        with self._reporting:
            self._report(Event(child.service, happened, text))


def _words(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


def _leave(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
