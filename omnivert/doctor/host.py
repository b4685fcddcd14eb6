"""This machine: what is installed, and where the store lies."""

import os
import platform
import shutil
from importlib import metadata
from pathlib import Path

from omnivert import __version__
from omnivert.config import Config
from omnivert.doctor.evidence import Host, Keeping
from omnivert.errors import DataError, OmnivertError
from omnivert.store import Store, StoreError
from omnivert.store_rules import restorable

SHOWN = ("numpy", "opencv-python-headless", "eclipse-zenoh", "filterpy", "mcap")
_CV2 = ("opencv-python", "opencv-python-headless", "opencv-contrib-python", "opencv-contrib-python-headless")


def this_host() -> Host:
    return Host(
        python=platform.python_version(),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        versions={"omnivert": __version__, **{name: _version(name) for name in SHOWN}},
        opencvs=tuple(name for name in _CV2 if _version(name)),
    )


def keeping(config: Config) -> Keeping:
    """Looks at the store without writing to it."""
    path = config.storage.path
    try:
        free = shutil.disk_usage(path.parent).free
    except OSError:
        free = None
    try:
        return Keeping(_held(path, config), _forbidden(path), free)
    except StoreError as error:
        return Keeping("", error, free)


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def _held(path: Path, config: Config) -> str:
    """raises  StoreError when what is there is no store, or cannot be read"""
    if path.is_dir():
        raise StoreError("OV602", f"the store {path} cannot be opened", "it is a folder", "set storage.path to a file")
    if not path.exists():
        return f"{path}: nothing stored yet"
    try:
        with Store(path, writable=False) as store:
            count, entry = len(store.entries()), store.latest(config.robot.id, config.camera.id)
    except StoreError as error:
        if error.code == "OV605":
            return f"{path}: nothing stored yet"
        raise
    if entry is None:
        others = f", {count} of others" if count else ""
        return f"{path}: nothing stored yet for {config.robot.id}/{config.camera.id}{others}"
    fits, why = restorable(entry, config)
    newest = f"{path}: {count} {'entry' if count == 1 else 'entries'}, newest of {entry.saved_at}"
    return f"{newest}, fits this configuration" if fits else f"{newest}, not taken up: {why}"


def _forbidden(path: Path) -> OmnivertError | None:
    """Why nothing can be written there; None when it can."""
    folder, what = path.parent, f"the store {path} cannot be written"
    if not folder.is_dir():
        return DataError("OV602", what, f"there is no folder {folder}", f"mkdir -p {folder}")
    for place in (folder, *([path] if path.exists() else [])):
        if not os.access(place, os.W_OK):
            help = "set storage.path to a file in a folder that you may write"
            return DataError("OV602", what, f"{place} is not yours to write", help)
    return None
