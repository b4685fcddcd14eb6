"""The bus: zenoh behind a few verbs. The only module that knows zenoh.

A service is a client of one router. Nothing is scouted for, nothing listens; every stream is published so that no
publisher waits for a consumer (DROP), and every message that is lost on the way is counted where it is missed.
"""

import json
import logging
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import Any, Self

import zenoh

from omnivert.config import Config
from omnivert.messages import Message
from omnivert.wire import rivals
from omnivert.wire.channels import HEALTH, Channel, health_key
from omnivert.wire.codec import encode
from omnivert.wire.endings import Signals, ended_by_force_after
from omnivert.wire.envelope import Envelope
from omnivert.wire.inbox import Inbox
from omnivert.wire.listening import answered, lasting, newest_answer, posted, taken
from omnivert.wire.meter import Meter
from omnivert.wire.presence import Presence
from omnivert.wire.received import Received
from omnivert.wire.settings import cannot_listen, client_settings, no_router, router_settings

__all__ = ["Bus", "Received", "Router"]

_log = logging.getLogger("omnivert.bus")
_CLOSE_S = 2.0  # zenoh may hang in close for 10 s, and a session that is not closed hangs the exit


class Bus:
    """One process's door to the robot's bus.

    While it is open, SIGTERM and SIGINT stop it (where nobody else takes them), also while it still connects; a bus
    that was stopped hears and publishes nothing.

    patience_s  how long to try for a router before giving up; None: until it is there
    """

    def __init__(self, config: Config, service: str, instance: str, patience_s: float | None = None) -> None:
        if not all(part and not set(part) & set("/*$?#@ ") for part in (service, instance)):
            raise ValueError(f"{service}/{instance} cannot stand in a key")
        self.config = config
        self.service = service
        self.instance = instance
        self.incarnation = secrets.token_bytes(8)
        self._patience_s = patience_s
        self._settings = client_settings(config)
        self._session: zenoh.Session | None = None
        self._token: Any = None
        self._lock = threading.Lock()  # of the publishers and the token
        self._publishers: dict[str, _Publisher] = {}
        self._declared: list[Any] = []  # zenoh forgets what nobody holds
        self._inboxes: list[Inbox] = []
        self._presence = Presence(service, instance, self.incarnation)
        self._stopped = threading.Event()
        self._meter = Meter(service, instance, time.monotonic_ns())
        self._health = threading.Thread(target=self._tell_health, name="health", daemon=True)
        self._signals = Signals(self.stop)

    def __enter__(self) -> Self:
        self._signals.watch()
        try:
            self._session = self._connected()
            if self._session is not None:
                liveliness = self._session.liveliness()
                declared = partial(liveliness.declare_subscriber, "v1/@live/**", self._seen, history=True)
                self._declared.append(lasting(declared))
                self._health.start()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.stop()
        self._close()

    def stop(self) -> None:
        """Ends every `listen`, from any thread."""
        self._stopped.set()
        for inbox in self._inboxes:
            inbox.close()
        self._presence.wake()

    @property
    def stopped(self) -> bool:
        return self._stopped.is_set()

    def wait_stopped(self, timeout_s: float) -> bool:
        return self._stopped.wait(timeout_s)

    def _connected(self) -> zenoh.Session | None:
        """A session, as soon as the router is there; None when stopped before."""
        config, endpoint = _zenoh_config(self._settings), self.config.bus.endpoint
        began, told_s = time.monotonic(), 5.0
        while not self._stopped.is_set():
            try:
                return zenoh.open(config)
            except zenoh.ZError as error:
                waited_s = time.monotonic() - began
                if self._patience_s is not None and waited_s > self._patience_s:
                    raise no_router(endpoint) from error
                if waited_s > told_s:
                    _log.warning("no router at %s for %.0f s", endpoint, waited_s)
                    told_s *= 4.0
            self._stopped.wait(0.1)
        return None

    def _close(self) -> None:
        if (session := self._session) is not None:
            with ended_by_force_after(_CLOSE_S):
                if self._health.is_alive():
                    self._health.join()
                with suppress(zenoh.ZError):
                    self._publish_health()
                self._session = None
                with suppress(zenoh.ZError):
                    _close(session)
        self._signals.release()

    # ------------------------------------------------------------------ presence

    def ready(self) -> None:
        """Tells the others that this service is here. `listen` does so once it can hear."""
        with self._lock:
            if self._session is not None and self._token is None:
                self._token = self._session.liveliness().declare_token(self._presence.key)

    def present(self) -> frozenset[tuple[str, str]]:
        """(service, instance) of every other service that is here."""
        return self._presence.services()

    def incarnations(self, service: str) -> frozenset[bytes]:
        """Names of the other processes of a service that are here."""
        return self._presence.incarnations(service)

    def alive(self, incarnation: bytes) -> bool:
        """Whether the process of this name is here."""
        return self._presence.alive(incarnation)

    def await_presence(self, holds: Callable[[], bool], timeout_s: float) -> bool:
        """Waits until `holds`, which is asked again whenever somebody comes or goes; whether it does."""
        self._presence.wait(lambda: self._stopped.is_set() or holds(), timeout_s)
        return holds()

    def refuse_beside(self, *services: str, namesakes: tuple[str, ...] = ()) -> None:
        """Says that this service is here, and refuses to be beside others that publish the same; see `rivals`.

        namesakes  services that publish the same where their instance is this one's
        raises     UseError when one of them is here and does not give way
        """
        witness = self._connected()  # a session's own answers run ahead of what it has told the router
        try:
            asked = partial(rivals.tokens, witness, zenoh.ZError)
            known = rivals.Known(self._presence, asked, services, self._stopped.is_set, namesakes)
            if rival := known.settled(self.ready, self._token is not None):
                raise rivals.refusal(self.config.robot.id, self.service, rival)
        finally:
            if witness is not None:
                with suppress(zenoh.ZError):
                    _close(witness)

    def _seen(self, sample: zenoh.Sample) -> None:
        self._presence.token(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    # ------------------------------------------------------------------ publishing

    def publish(self, channel: Channel, message: Message, cause: Received | None = None, replay: bool = False) -> None:
        """Sends a message.

        cause   what arrived and led to it; the message then belongs to the same run
        raises  ValueError when the message is not of the channel, or does not keep its form
        """
        if type(message) is not channel.message:
            raise ValueError(f"{type(message).__name__} does not belong on the channel of {channel.message.__name__}")
        self.ready()
        self._put(channel, channel.key(self.config), message, cause, replay)

    def _put(self, channel: Channel, key: str, message: Message, cause: Received | None, replay: bool) -> None:
        data = encode(message)
        if self._session is None:
            return
        if len(data) > self.config.bus.max_message_bytes:
            self._meter.refused(f"{key}: too large to send")
            return
        run = cause.run if cause is not None else self.incarnation
        try:
            publisher = self._publisher(channel, key)
            publisher.put(data, self.incarnation, run, cause.replay if cause is not None else replay)
        except zenoh.ZError as error:
            self._meter.refused(f"{key}: not sent")
            _log.debug("not sent on %s: %s", key, error)
        else:
            self._meter.published(key)

    def _publisher(self, channel: Channel, key: str) -> "_Publisher":
        with self._lock:
            if key not in self._publishers:
                if self._session is None:
                    raise zenoh.ZError("the bus is closed")
                self._publishers[key] = _Publisher(self._session, channel, key)
            return self._publishers[key]

    # ------------------------------------------------------------------ listening

    def listen(self, *channels: Channel, period_s: float = 1.0, every: bool = False) -> Iterator[Received | None]:
        """What arrives from now on, in order for each key; None when nothing was given for `period_s`.

        Ends when the bus stops.
        every  also every live frame, where a consumer that is late would otherwise take the newest one
        """
        settings = self.config.bus
        inbox = Inbox(settings.queue_messages, settings.queue_bytes, every)
        self._inboxes.append(inbox)
        subscribers: list[Any] = []
        if self._session is None or self._stopped.is_set():
            inbox.close()
        else:
            for channel in channels:
                key = channel.key(self.config)
                post = posted(channel, key, inbox, self._meter, settings.max_message_bytes)
                subscribers.append(lasting(partial(self._session.declare_subscriber, key, post)))
            self.ready()
        return self._taken(inbox, subscribers, period_s)

    def _taken(self, inbox: Inbox, subscribers: list[Any], period_s: float) -> Iterator[Received | None]:
        try:
            yield from taken(inbox, self._meter, period_s)
        finally:
            for subscriber in subscribers:
                with suppress(zenoh.ZError):
                    subscriber.undeclare()

    # ------------------------------------------------------------------ questions

    def answer(self, channel: Channel, answerer: Callable[[], Message | None]) -> None:
        """Answers whoever asks on a channel, in a thread of zenoh's, until the bus closes; None: no answer."""
        key = channel.key(self.config)
        if self._session is not None:
            answer = answered(key, answerer, self._meter)
            self._declared.append(lasting(partial(self._session.declare_queryable, key, answer, complete=True)))
        self.ready()

    def ask(self, channel: Channel, timeout_s: float = 1.0) -> Message | None:
        """The other services' answer of the newest stamp; None when nobody answers."""
        if self._session is None:
            return None
        key = channel.key(self.config)
        with suppress(zenoh.ZError):
            replies = self._session.get(
                key,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                allowed_destination=zenoh.Locality.REMOTE,
                timeout=timeout_s,
            )
            return newest_answer(replies, key, channel, self._meter)
        return None

    # ------------------------------------------------------------------ health

    def refuse(self, reason: str, times: int = 1) -> None:
        """Counts bad input in the health message."""
        self._meter.refused(reason, times)

    def note(self, text: str | None, about: str = "") -> None:
        """Sets what a person should know now, or takes it back; one note for each subject."""
        self._meter.note(text, about)

    def done(self, received: Received) -> None:
        """The result for this message has been published."""
        if received.same_clock:
            self._meter.latency(max(time.monotonic_ns() - received.sent_ns, 0))

    def _tell_health(self) -> None:
        while True:
            with suppress(zenoh.ZError):
                self._publish_health()
            if self._stopped.wait(1.0):
                return

    def _publish_health(self) -> None:
        data = encode(self._meter.health(time.monotonic_ns()))
        publisher = self._publisher(HEALTH, health_key(self.service, self.instance))
        publisher.put(data, self.incarnation, self.incarnation, False)


class _Publisher:
    """A zenoh publisher and its sequence numbers, for any thread."""

    def __init__(self, session: zenoh.Session, channel: Channel, key: str) -> None:
        self._publisher = session.declare_publisher(
            key,
            encoding=zenoh.Encoding("application/msgpack").with_schema(f"omnivert.{channel.message.__name__}.v1"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=getattr(zenoh.Priority, channel.urgency),
            # A message that goes express takes up a whole batch of a busy link's queue: of bursts of 60 ticks half
            # were lost.
            express=False,
        )
        self._lock = threading.Lock()
        self._sequence = 0

    def put(self, data: bytes, incarnation: bytes, run: bytes, replay: bool) -> None:
        with self._lock:
            envelope = Envelope(incarnation, run, self._sequence, time.monotonic_ns(), replay)
            self._sequence += 1
            self._publisher.put(data, attachment=envelope.packed())


class Router:
    """A router of our own, which the services connect to."""

    def __init__(self, config: Config) -> None:
        self.endpoints = (config.bus.endpoint, *config.bus.listen)
        self._config = _zenoh_config(router_settings(config))
        self._session: zenoh.Session | None = None

    def __enter__(self) -> Self:
        """raises DataError when an end point cannot be opened"""
        try:
            self._session = zenoh.open(self._config)
        except zenoh.ZError as error:
            raise cannot_listen(self.endpoints, error) from error
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._session is not None:
            with ended_by_force_after(_CLOSE_S), suppress(zenoh.ZError):
                _close(self._session)


def _zenoh_config(settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _close(session: Any) -> None:  # zenoh's own type for it is incomplete
    session.close()
