"""How messages travel, and how the streams are put into order."""

import re
from typing import Annotated

from pydantic import AfterValidator, Field, Strict

from omnivert.config.section import Section


def _end_point(text: str) -> str:
    if not re.fullmatch(r"[a-z][a-z0-9_-]*/[^?#]+(\?[^#]+)?(#.+)?", text):
        raise ValueError("an end point is PROTOCOL/ADDRESS, such as tcp/127.0.0.1:7447")
    return text


EndPoint = Annotated[str, AfterValidator(_end_point)]


class Bus(Section):
    """Zenoh, with the door closed: no scouting, and only the end points named here."""

    endpoint: EndPoint = "tcp/127.0.0.1:7447"
    """Where the router listens and the services connect; unixsock-stream/PATH for a socket of the file system."""
    listen: Annotated[tuple[EndPoint, ...], Strict(False)] = ()
    """More end points for the router, such as tcp/192.168.1.5:7447 for monitors on other machines."""
    shared_memory: bool = True
    """Large messages between processes of one machine go through shared memory."""
    max_message_bytes: int = Field(64 * 2**20, ge=1024, le=2**30)
    """A larger message is refused."""
    queue_messages: int = Field(20_000, ge=16, le=10_000_000)
    """Messages that may wait in a service for its loop; beyond it the oldest are dropped, and counted."""
    queue_bytes: int = Field(256 * 2**20, ge=2**20, le=2**34)
    """The same as a size."""


class Timeline(Section):
    """Putting the streams into the order of their stamps."""

    lateness_s: float = Field(0.25, gt=0.0, le=60.0)
    """Live, how long a message waits for a stream that lags. On a playback every message is waited for."""
    max_jump_s: float = Field(60.0, gt=0.0, le=86400.0)
    """A stamp farther ahead than this of its stream is refused."""
    confirmations: int = Field(5, ge=2, le=1000)
    """Messages in a row that agree with each other, but not with the stream, and mean that the clock has changed."""
    max_held: int = Field(20000, ge=100, le=10_000_000)
    """Messages held back at most; beyond it the oldest go on."""
