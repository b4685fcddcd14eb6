"""What a check says: how it stands, what was seen, why that is so, and what to type or change."""

from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    FINE = "fine"
    WORSE = "worse"  # the calibration goes on, with a worse result
    STOPS = "stops"  # there is no calibration until it is mended
    UNCHECKED = "unchecked"  # the facts do not tell


@dataclass(frozen=True, slots=True)
class Finding:
    """
    fact    what was seen, with its numbers; of what was not checked, why
    reason  why it is so, or what it does to the result; may be empty
    help    a command to type, a line to change, a thing to do; empty when nothing is wrong
    blocks  checks that need this one can not be asked
    """

    status: Status
    fact: str
    reason: str = ""
    help: str = ""
    blocks: bool = False


def fine(fact: str) -> Finding:
    return Finding(Status.FINE, fact)


def worse(fact: str, reason: str, help: str) -> Finding:
    return Finding(Status.WORSE, fact, reason, help)


def stops(fact: str, reason: str, help: str) -> Finding:
    return Finding(Status.STOPS, fact, reason, help, blocks=True)


def unchecked(why: str) -> Finding:
    return Finding(Status.UNCHECKED, why)


def nothing(why: str) -> Finding:
    """There is nothing to look at, for those neither that need it."""
    return Finding(Status.UNCHECKED, why, blocks=True)
