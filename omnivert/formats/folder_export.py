"""A recording -> a folder of plain files, of which `omnivert import` makes the same messages again.

Of a recording with images meta.json, frames.csv with the images, encoders.csv and scans.csv; of one with bearings alone
meta.json, bearings.csv and wheels.csv. What it carries of the truth stands under truth/; what was seen and calibrated
while it was recorded under results/, which nothing reads again.
"""

import json
import shutil
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from omnivert.config import Config
from omnivert.errors import DataError
from omnivert.formats.bearings_folder import BearingsFolder
from omnivert.formats.exported_tables import (
    BearingsTable,
    EstimatesTable,
    FramesTable,
    ScansTable,
    Table,
    TicksTable,
    WaysTable,
    extrinsics_json,
)
from omnivert.formats.folder import FramesFolder
from omnivert.formats.meta import EXPORTED
from omnivert.formats.written import Progress, hidden_beside
from omnivert.messages import Extrinsics, Scan
from omnivert.wire.channels import BEARINGS, ESTIMATE, EXTRINSICS, FRAME, SCAN, TICKS, channel_from_key
from omnivert.wire.recording import Recording

_META = "meta.json"


@dataclass(slots=True)
class Exported:
    """What came into the folder.

    kind    what `omnivert import` calls it: frames or bearings
    counts  messages by type
    notes   what of the recording is not in it, and why it would be refused when it is read again
    """

    kind: str
    counts: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


def export(recording: Recording, out: Path, progress: Progress = lambda done, of: None) -> Exported:
    """Writes the folder `out`, which appears when it is whole, and not before.

    raises  DataError when the recording holds neither images nor bearings, or the folder cannot be written
    """
    config = recording.config(Config())
    images = FRAME.key(config) in recording.counts
    if not images and BEARINGS.key(config) not in recording.counts:
        because = f"only {', '.join(sorted(recording.counts))}"
        raise DataError("OV313", f"{recording.path} holds neither images nor bearings of its camera", because)
    begun = hidden_beside(out)
    try:
        shutil.rmtree(begun, ignore_errors=True)
        begun.mkdir()
        exported = _Export(recording, config, begun, images).written(progress)
        exported.notes += _attached(recording, begun)
        begun.replace(out)
    except OSError as error:
        raise DataError("OV313", f"cannot write {out}", error.strerror or str(error)) from error
    finally:
        shutil.rmtree(begun, ignore_errors=True)
    try:
        FramesFolder(out, Config()) if images else BearingsFolder(out, Config())
    except DataError as error:
        exported.notes.append(f"omnivert import {exported.kind} will refuse the folder: {error}")
    return exported


class _Export:
    """One walk through the recording, each message to the table of its stream."""

    def __init__(self, recording: Recording, config: Config, folder: Path, images: bool) -> None:
        self._recording = recording
        self._config = config
        self._folder = folder
        self._images = images
        self._open = ExitStack()
        self._tables: dict[str, Table[Any]] = {}

    def written(self, progress: Progress) -> Exported:
        exported, total = Exported("frames" if self._images else "bearings"), self._recording.counts.total()
        claims: list[Extrinsics] = []
        scan_key = SCAN.key(self._config)
        with self._open:
            self._begin()
            for done, (key, message) in enumerate(self._recording.messages(), 1):
                progress(done, total)
                if key == scan_key and isinstance(message, Scan) and self._images and key not in self._tables:
                    self._add(key, ScansTable(self._folder, message))
                if key in self._tables:
                    self._tables[key].take(message)
                    exported.counts[type(message).__name__] += 1
                elif isinstance(message, Extrinsics):
                    claims.append(message)
        if claims:
            (self._folder / "results").mkdir(exist_ok=True)
            (self._folder / "results" / "extrinsics.json").write_bytes(extrinsics_json(claims))
        (self._folder / _META).write_text(json.dumps(self._meta(), indent=1) + "\n", encoding="utf-8")
        exported.notes += self._notes()
        return exported

    def _begin(self) -> None:
        config, folder = self._config, self._folder
        if self._images:
            self._add(FRAME.key(config), FramesTable(folder))
            self._add(TICKS.key(config), TicksTable(folder))
            if BEARINGS.key(config) in self._recording.counts:
                self._add(BEARINGS.key(config), BearingsTable(folder / "results" / "bearings.csv"))
        else:
            self._add(BEARINGS.key(config), BearingsTable(folder / "bearings.csv"))
            self._add(TICKS.key(config), WaysTable(folder, config.encoder.metres_per_tick))
        if ESTIMATE.key(config) in self._recording.counts:
            self._add(ESTIMATE.key(config), EstimatesTable(folder))

    def _add(self, key: str, table: Table[Any]) -> None:
        self._tables[key] = self._open.enter_context(table)

    def _meta(self) -> dict[str, Any]:
        """What the recording carries of its folder, if it came from one, with the rig as the recording has it."""
        meta, rig = _carried(self._recording), self._config.rig()
        robot, encoder, camera, ring = rig["robot"], rig["encoder"], rig["camera"], rig["ring"]
        told: dict[str, dict[str, Any]] = {"robot": {"wheel_base_m": robot["wheel_base_m"]}}
        if self._images:
            told["robot"] |= {key: encoder[key] for key in ("wheel_diameter_m", "ticks_per_rev")}
            told["image"] = {"width": camera["width_px"], "height": camera["height_px"]}
            told["ring"] = {key: ring[key] for key in ("center_px", "r_min_px", "r_max_px")}
            meta |= {key: camera[key] for key in ("bearing_sign", "frame_rate_hz")}
            scans = self._tables.get(SCAN.key(self._config))
            if isinstance(scans, ScansTable):
                told["laser"] = scans.laser()
        for key, values in told.items():
            before = meta.get(key)
            meta[key] = {**before, **values} if isinstance(before, dict) else values
        return {**meta, EXPORTED: rig}

    def _notes(self) -> list[str]:
        notes = [f"not read: {reason}, {times} times" for reason, times in self._recording.refused.items()]
        for table in self._tables.values():
            if isinstance(table, ScansTable) and table.left_out:
                notes.append(f"scans.csv: {table.left_out} sweeps of another form than the first are left out")
            if isinstance(table, BearingsTable) and table.bare and not self._images:
                notes.append(f"bearings.csv: ring, reasons and looks of {table.bare} frames are left out")
        kept = {FRAME, TICKS, BEARINGS, ESTIMATE, EXTRINSICS} | ({SCAN} if self._images else set())
        sensed = (FRAME.message, TICKS.message, SCAN.message, BEARINGS.message)
        for key, times in sorted(self._recording.counts.items()):
            channel = channel_from_key(key)
            if channel is not None and channel.message in sensed and not (channel in kept and key in self._tables):
                notes.append(f"{key}: {times} messages have no place in this folder")
        return notes


def _carried(recording: Recording) -> dict[str, Any]:
    """meta.json of the folder that it was imported from; empty where there is none that can be read."""
    if _META not in recording.attachments:
        return {}
    try:
        meta = json.loads(recording.attachment(_META).decode("utf-8-sig"))
    except (DataError, ValueError):
        return {}
    return meta if isinstance(meta, dict) else {}


def _attached(recording: Recording, folder: Path) -> list[str]:
    """Writes the other files that it carries; returns what is said of those that are not written."""
    notes = []
    for name in recording.attachments:
        path = PurePosixPath(name)
        target = folder / path
        if name == _META:
            continue
        if path.is_absolute() or ".." in path.parts or not path.name or "\0" in name or target.exists():
            notes.append(f"{name[:100]!r}, a file that it carries, has no place in the folder")
            continue
        try:
            data = recording.attachment(name)
        except DataError as error:
            notes.append(str(error))
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return notes
