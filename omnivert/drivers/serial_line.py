"""A serial port that may be unplugged and plugged in again: the only module that knows one."""

import os
import termios
from collections.abc import Iterator
from threading import Event

import serial

from omnivert.config import Encoder
from omnivert.drivers.device import Lost, Opened

QUIET_S = 0.1  # how long one read waits; so fast a stop is heard
TROUBLES = (serial.SerialException, OSError, termios.error, ValueError)


def pieces(config: Encoder, stop: Event) -> Iterator[bytes | Opened | Lost]:
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
                yield port.read(1) + port.read(port.in_waiting)
        except TROUBLES as error:
            reason = f"is gone: {_words(error)}"
            yield Lost(reason)
        finally:
            _close(port)
        stop.wait(config.reopen_s)


def _opened(config: Encoder) -> serial.SerialBase:
    # Exclusive: two readers would each get half of the lines.
    port = serial.serial_for_url(config.port, config.baud, timeout=QUIET_S, exclusive=True)
    try:
        port.reset_input_buffer()  # lines from before would be taken for late ones
    except TROUBLES:
        _close(port)
        raise
    return port


def _close(port: serial.SerialBase) -> None:
    try:
        port.close()
    except TROUBLES:
        return  # it went away before; there is nothing left to close


def _words(error: Exception) -> str:
    """The cause without pyserial's wrapping."""
    number = getattr(error, "errno", None)
    if number is not None:
        return os.strerror(number)
    if "returned no data" in str(error):
        return "unplugged"
    return str(error).rpartition("Errno")[0].rstrip(" [:") or str(error)
