"""Zenoh with nothing around it, on a bus's own session: the yardstick for what the bus and the services add."""

import threading
import time
from typing import Any

from omnivert.wire.bus import Bus

THERE = "v1/bench/there"
BACK = "v1/bench/back"


def serve_echo(bus: Bus, answer: bytes) -> None:
    """Answer each raw message with these bytes until the bus stops."""
    session = bus._session
    if session is None:
        return
    back = session.declare_publisher(BACK)
    subscriber = session.declare_subscriber(THERE, lambda _: back.put(answer))
    bus.ready()
    while not bus.wait_stopped(3600.0):
        pass
    subscriber.undeclare()  # type: ignore[no-untyped-call]


def raw_rounds(bus: Bus, payload: bytes, count: int, timeout_s: float = 1.0) -> list[float]:
    """Seconds from putting the payload to holding the echo's bytes, one after the other; lost ones are left out."""
    session = bus._session
    if session is None:
        return []
    came = threading.Event()
    arrived = [0.0]

    def hold(sample: Any) -> None:
        sample.payload.to_bytes()  # copied out, as every consumer must
        arrived[0] = time.perf_counter()
        came.set()

    there = session.declare_publisher(THERE)
    subscriber = session.declare_subscriber(BACK, hold)
    rounds = []
    for _ in range(count):
        came.clear()
        began = time.perf_counter()
        there.put(payload)
        if came.wait(timeout_s):
            rounds.append(arrived[0] - began)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return rounds
