"""What a device's stream tells between its readings."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Opened:
    """The device is there, for the first time or again."""


@dataclass(frozen=True, slots=True)
class Lost:
    """The device is not there; it is tried again and again."""

    reason: str


@dataclass(frozen=True, slots=True)
class Finished:
    """The source has come to its end; nothing more will come."""


@dataclass(frozen=True, slots=True)
class Refused:
    """One reading could not be used."""

    reason: str
