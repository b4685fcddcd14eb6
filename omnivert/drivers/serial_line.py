"""A serial port that may be unplugged and plugged in again: the only module that knows one."""

import errno
import os
import socket
import termios
import time
from collections.abc import Iterator
from contextlib import suppress
from threading import Event
from typing import Protocol

import serial
import serial.rfc2217
from serial.urlhandler import protocol_socket

from omnivert.config import Encoder
from omnivert.drivers.device import Lost, Opened

QUIET_S = 0.1  # how long one read waits; so fast a stop is heard
WRITE_S = 1.0  # a port that takes nothing for so long is gone
LARGEST = 4096  # bytes in one piece
TROUBLES = (serial.SerialException, OSError, termios.error, ValueError, NotImplementedError)


class Asker(Protocol):
    """Knows what a device must be told."""

    def question(self, now_ns: int) -> bytes:
        """What to send now; mostly nothing."""

    def idle_s(self, now_ns: int) -> float:
        """For so long nothing comes and nothing is to be sent."""


class _Socket(protocol_socket.Serial):  # type: ignore[misc]  # pyserial has no types
    """Tells how much is waiting; pyserial's own says only that something is, and so gives one byte at a time."""

    @property
    def in_waiting(self) -> int:
        return len(self._socket.recv(LARGEST, socket.MSG_PEEK)) if super().in_waiting else 0


class _Rfc2217(serial.rfc2217.Serial):  # type: ignore[misc]  # pyserial has no types
    """Its thread ends without a traceback on what is not of the protocol; whoever reads then hears of it."""

    def _telnet_read_loop(self) -> None:
        with suppress(Exception):
            super()._telnet_read_loop()


_KINDS = {"socket": _Socket, "rfc2217": _Rfc2217}


def pieces(config: Encoder, stop: Event, asker: Asker) -> Iterator[bytes | Opened | Lost]:
    """What the port sends, as it comes, until `stop`; b"" after a quiet moment.

    A port that does not open or goes away is Lost, once for each new reason, and is tried again every `reopen_s`.
    """
    reason = ""
    while not stop.is_set():
        try:
            port = _opened(config)
        except TROUBLES as error:
            why = f"does not open: {_words(error)}"
            if why != reason:
                reason = why
                yield Lost(reason)
            stop.wait(config.reopen_s)
            continue
        reason = ""
        try:
            yield Opened()
            while not stop.is_set():
                if idle_s := asker.idle_s(time.monotonic_ns()):
                    stop.wait(min(idle_s, QUIET_S))
                if not port.in_waiting:  # else it is no answer to what is asked now
                    _ask(port, asker)
                yield _piece(port)
        except TROUBLES as error:
            reason = f"is gone: {_words(error)}"
            yield Lost(reason)
        finally:
            _close(port)
        stop.wait(config.reopen_s)


def _opened(config: Encoder) -> serial.SerialBase:
    # Exclusive: two readers would each get half of the lines.
    quiet_s = min(QUIET_S, 1.0 / config.poll_rate_hz)
    write_s = None if "://" in config.port else WRITE_S  # not every URL's port knows it
    kind = _KINDS.get(config.port.partition("://")[0].lower(), serial.serial_for_url)
    port = kind(config.port, config.baud, timeout=quiet_s, write_timeout=write_s, exclusive=True)
    with suppress(*TROUBLES, AttributeError):
        port.set_low_latency_mode(True)  # a USB adapter may keep what it has for 16 ms
    try:
        port.reset_input_buffer()  # lines from before would be taken for late ones
    except TROUBLES:
        _close(port)
        raise
    return port


def _ask(port: serial.SerialBase, asker: Asker) -> None:
    question = asker.question(time.monotonic_ns())
    if question:
        port.write(question)


def _piece(port: serial.SerialBase) -> bytes:
    """What is there, or comes within a moment."""
    piece: bytes = port.read(1)
    while piece and len(piece) < LARGEST and (waiting := port.in_waiting):
        piece += port.read(waiting)
    return piece


def _close(port: serial.SerialBase) -> None:
    try:
        port.close()
    except TROUBLES:
        return  # it went away before; there is nothing left to close


def _words(error: Exception) -> str:
    """The cause without pyserial's wrapping."""
    number, text = getattr(error, "errno", None), str(error)
    if number == errno.EAGAIN:
        return "another program reads it"
    if number is not None:
        return os.strerror(number)
    if "returned no data" in text:
        return "unplugged"
    if "Inappropriate ioctl" in text:
        return "it is no serial port"
    if text.startswith("Could not open port") and "[Errno" not in text:  # what is wrong with an URL it does not say
        return "it is no address like socket://HOST:PORT"
    return text.rpartition("[Errno")[2].partition("] ")[2] or text.partition(" [")[0]
