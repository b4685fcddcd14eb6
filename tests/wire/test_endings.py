"""How a process on the bus ends: waited for by Python, as far as zenoh calls back into it."""

import threading
import time
from collections import defaultdict
from collections.abc import Callable
from itertools import count

import pytest

from omnivert.config import Config
from omnivert.messages import Ticks
from omnivert.wire.bus import Bus, Router
from omnivert.wire.channels import TICKS
from omnivert.wire.meter import Meter
from omnivert.wire.presence import Presence

DEADLINE_S = 30.0


@pytest.mark.parametrize("daemon", [False, True])
def test_no_thread_that_zenoh_calls_back_in_is_a_daemon(
    config: Config, monkeypatch: pytest.MonkeyPatch, daemon: bool
) -> None:
    """Python ends a daemon in the midst of zenoh, which then aborts the process."""
    found: dict[str, set[bool]] = defaultdict(set)
    all_found = threading.Event()

    def watched(name: str, call: Callable[..., None]) -> Callable[..., None]:
        def watch(*arguments: object) -> None:
            found[name].add(threading.current_thread().daemon)
            call(*arguments)
            if len(found) == 3:
                all_found.set()

        return watch

    def listen() -> None:
        with Bus(config, "monitor", "m") as bus:
            bus.answer(TICKS, lambda: answered() or Ticks(1, 0, 0))
            for _ in bus.listen(TICKS, period_s=0.05):
                if all_found.is_set() or time.monotonic() > deadline:
                    return

    deadline = time.monotonic() + DEADLINE_S
    answered = watched("question", lambda: None)
    monkeypatch.setattr(Meter, "received", watched("message", Meter.received))
    monkeypatch.setattr(Presence, "token", watched("token", Presence.token))
    with Router(config), Bus(config, "bridge", "b") as bus:
        bus.ready()
        thread = threading.Thread(target=listen, daemon=daemon)
        thread.start()
        for number in count():  # again and again: it may be here before it hears
            bus.ask(TICKS)
            bus.publish(TICKS, Ticks(number, 0, 0))
            if all_found.wait(0.05) or time.monotonic() > deadline:
                break
        thread.join()
    assert found == {name: {False} for name in ("message", "token", "question")}
