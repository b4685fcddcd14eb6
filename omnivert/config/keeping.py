"""What is kept, and played again."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, Strict

from omnivert.config.section import Section


def _nothing_or(least: float) -> AfterValidator:
    """0, or no less: a file for every message would fill a file system with names."""

    def checked(value: float) -> float:
        if 0.0 < value < least:
            raise ValueError(f"0 or at least {least:g} is needed")
        return value

    return AfterValidator(checked)


class Storage(Section):
    """Where calibrated extrinsics are kept."""

    path: Annotated[Path, Strict(False)] = Path("extrinsics.db")
    """The SQLite file; relative to the working directory."""
    locked_s: float = Field(2.0, gt=0.0, le=60.0)
    """How long to wait for another program that has the file locked."""
    waiting_max: int = Field(100, ge=1, le=10_000)
    """Extrinsics kept in memory while the file cannot be written; beyond it the oldest are given up and counted."""


class Recorder(Section):
    """Writing down all that a running system says."""

    compression: Literal["zstd", "lz4", "none"] = "lz4"
    """Of the file's chunks: zstd is the smallest; lz4 takes a quarter of its time; none suits JPEG frames."""
    split_mb: Annotated[float, _nothing_or(0.01)] = Field(0.0, ge=0.0, le=1e7)
    """A part ends before it is larger than this, in 10^6 bytes, and the next begins; 0: no limit."""
    split_s: Annotated[float, _nothing_or(0.1)] = Field(0.0, ge=0.0, le=1e7)
    """A part ends when the drive in it has lasted so long; 0: no limit."""


class Player(Section):
    """Playing a recording in place of the bridge."""

    frames_ahead: int = Field(4, ge=1, le=1000)
    """Frames that may be on their way before the player waits for a result."""
    patience_s: float = Field(30.0, ge=0.1, le=3600.0)
    """Without a result for so long, the frames on their way are counted as lost, and the playback goes on."""
    comeback_s: float = Field(20.0, ge=0.0, le=3600.0)
    """How long a playback waits for a service that has gone."""
    wait_s: float = Field(120.0, ge=0.0, le=3600.0)
    """How long it waits at the start for the services that it was told to wait for."""
