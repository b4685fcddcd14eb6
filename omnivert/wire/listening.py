"""The way of a message from zenoh's callback to the service's loop, and of a question to its answer.

Knows zenoh's samples and queries by what they offer, not by name.
"""

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

from omnivert.messages import Message
from omnivert.wire.channels import Channel
from omnivert.wire.codec import encode
from omnivert.wire.envelope import Envelope
from omnivert.wire.forms import WireError
from omnivert.wire.inbox import Inbox, Parcel
from omnivert.wire.meter import Meter
from omnivert.wire.once import Once
from omnivert.wire.received import Received, message_of, opened

T = TypeVar("T")


def lasting(declare: Callable[[], T]) -> T:
    """What `declare` returns or raises, from a thread that is no daemon.

    zenoh's thread for the callbacks is a daemon where the one that declares is, and closing the session waits for no
    callback. Python waits for other threads when it ends; a daemon it ends in the midst of zenoh, whose Rust then
    aborts the whole process (SIGABRT).
    """
    if not threading.current_thread().daemon:
        return declare()
    declared: Future[T] = Future()

    def run() -> None:
        try:
            declared.set_result(declare())
        except BaseException as error:  # noqa: BLE001 - raised again where it was asked for
            declared.set_exception(error)

    threading.Thread(target=run, name="declare", daemon=False).start()
    return declared.result()


def posted(channel: Channel, pattern: str, inbox: Inbox, meter: Meter, max_bytes: int) -> Callable[[Any], None]:
    """The callback of a subscriber: copies the bytes out, and leaves."""

    def post(sample: Any) -> None:
        key = str(sample.key_expr)
        name = key if len(key) <= 64 and key.isprintable() else pattern
        try:
            if "*" in key:  # a message to all who listen to one of many keys is nobody's
                meter.refused(f"{pattern}: sent to a pattern of keys")
                return
            attachment = sample.attachment
            envelope = Envelope.unpacked(attachment.to_bytes()) if attachment is not None else None
            if len(sample.payload) > max_bytes:
                meter.refused(f"{name}: too large")
            elif envelope is None:
                meter.refused(f"{name}: no envelope")
            else:
                meter.received(name, envelope)
                for displaced in inbox.put(Parcel(channel, name, envelope, sample.payload.to_bytes())):
                    meter.dropped(displaced.key)
        except Exception as error:  # noqa: BLE001 - zenoh would only log it
            meter.refused(f"{name}: {type(error).__name__} in the callback")

    return post


def taken(inbox: Inbox, meter: Meter, period_s: float) -> Iterator[Received | None]:
    """The messages of an inbox until it is closed; None when nothing was given for `period_s`."""
    due_s = time.monotonic() + period_s
    once = Once()
    while not inbox.closed:
        parcel = inbox.take(max(due_s - time.monotonic(), 0.0))
        received = _opened(parcel, meter, once) if parcel is not None else None
        if received is not None or (time.monotonic() >= due_s and not inbox.closed):
            yield received
            due_s = time.monotonic() + period_s


def _opened(parcel: Parcel, meter: Meter, once: Once) -> Received | None:
    try:
        if once.has_taken(parcel.key, parcel.envelope):
            raise WireError("the same sequence number again")
        received = opened(parcel)
    except WireError as error:
        meter.refused(f"{parcel.key}: {error.reason}")
        return None
    once.take(parcel.key, parcel.envelope)  # not before: what is no message must not keep out the one that is
    return received


def answered(key: str, answerer: Callable[[], Message | None], meter: Meter) -> Callable[[Any], None]:
    """The callback of a queryable."""

    def answer(query: Any) -> None:
        with query:
            try:
                message = answerer()
                if message is not None:
                    query.reply(key, encode(message))
            except Exception as error:  # noqa: BLE001 - the asker must hear of it, and zenoh would only log it
                meter.refused(f"{key}: {type(error).__name__} in the answer")
                query.reply_err(type(error).__name__)

    return answer


def newest_answer(replies: Any, key: str, channel: Channel, meter: Meter) -> Message | None:
    """Of the replies to a question the one with the newest stamp."""
    answers: list[Message] = []
    for reply in replies:
        try:
            if reply.ok is None:
                raise WireError("an answer failed")
            answers.append(message_of(channel, reply.ok.payload.to_bytes()))
        except WireError as error:
            meter.refused(f"{key}: {error.reason}")
    return max(answers, key=lambda answer: answer.stamp_ns, default=None)
