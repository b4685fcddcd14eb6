"""The peers' own environment: their OpenCV would replace ours, so it is made once, in the user's cache."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from omnivert.errors import DataError

PACKAGES = ("opencv-contrib-python-headless>=5.0,<6", "numpy>=2.1,<3")
PROBE = "import cv2, numpy; cv2.line_descriptor.BinaryDescriptor.createBinaryDescriptor(); cv2.SIFT_create()"
PROBE_S = 60.0
INSTALL_S = 600.0
HELP = "omnivert bench vision --no-peers   # or --peers-python PATH, an environment that has them"


def peers_python(given: Path | None, story: Callable[[str], None] = lambda _: None) -> Path:
    """The interpreter that the peers run on; makes their environment where there is none yet.

    given   an interpreter that has what they need already
    story   told what takes long
    raises  DataError when the one given lacks something, or none can be made
    """
    if given is not None:
        given = given.absolute()  # a bare name would be sought on the path
        because = _lacking(given)
        if because:
            raise DataError("OV220", f"the peers cannot run on {given}", because, f"pip install {PACKAGES[0]!r}")
        return given
    folder = cache_folder() / f"peers-py{sys.version_info.major}{sys.version_info.minor}"
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    if python.exists() and not _lacking(python):
        return python
    story(f"making an environment for the peers in {folder}, once (about 100 MB)")
    _ran([sys.executable, "-m", "venv", "--clear", str(folder)], folder)
    quiet = ("--quiet", "--disable-pip-version-check", "--no-input")
    _ran([str(python), "-m", "pip", "install", *quiet, *PACKAGES], folder)
    because = _lacking(python)
    if because:
        raise DataError("OV220", f"the peers cannot run on {python}", because, HELP)
    return python


def cache_folder() -> Path:
    """Where this user's programs keep what can be made again."""
    home = Path.home()
    match sys.platform:
        case "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData/Local")
        case "darwin":
            base = home / "Library/Caches"
        case _:
            base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "omnivert"


def _lacking(python: Path) -> str:
    """Why the peers cannot run on this interpreter; empty when they can."""
    try:
        ran = subprocess.run([python, "-c", PROBE], capture_output=True, text=True, timeout=PROBE_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return _why(error)
    return "" if ran.returncode == 0 else _last_line(ran.stderr) or f"it ends with {ran.returncode}"


def _ran(command: Sequence[str], folder: Path) -> None:
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DataError("OV220", f"the peers' environment in {folder} cannot be made", _why(error), HELP) from error
    if ran.returncode != 0:
        because = _last_line(ran.stderr or ran.stdout) or f"{command[2]} ends with {ran.returncode}"
        raise DataError("OV220", f"the peers' environment in {folder} cannot be made", because, HELP)


def _why(error: OSError | subprocess.TimeoutExpired) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""
