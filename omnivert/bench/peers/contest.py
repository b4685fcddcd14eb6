"""The peers over the frames that omnivert has left in a folder, each in a process of its own."""

import subprocess
import tempfile
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from omnivert.bench.contender import Contender
from omnivert.bench.score.truth import Sighting
from omnivert.errors import DataError

NAMES = {"edlines": "EDLines + LBD", "lsd": "LSD + LBD", "orb": "ORB", "sift": "SIFT"}
STAGES = ("detecting", "describing", "matching")


def peer_run(name: str, python: Path, folder: Path, moved: Callable[[], None] = lambda: None) -> Contender:
    """One peer over all frames.

    name    a key of NAMES
    folder  with the frames and the job; the peer's result goes there, too
    moved   called after each frame
    raises  DataError when it does not come to an end
    """
    script = Path(__file__).with_name("run.py")
    with tempfile.TemporaryFile("w+") as said:
        command = [str(python), str(script), str(folder), name]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True) as process:
            assert process.stdout is not None
            while process.stdout.read(1):
                moved()
        said.seek(0)
        words = [line.strip() for line in said if line.strip()]
    if process.returncode != 0:
        because = words[-1] if words else f"it ended with {process.returncode}"
        raise DataError("OV221", f"{NAMES[name]} did not run to its end", because, "omnivert bench vision --no-peers")
    return _contender(folder / f"{name}.npz")


def _contender(file: Path) -> Contender:
    try:
        with np.load(file) as result:
            seconds, sobel = result["seconds"], result["sobel_s"]
            frame, track, bearing = result["frame"], result["track_id"], result["bearing_rad"]
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise DataError(
            "OV221", f"{file.name} of a peer cannot be read", str(error), "omnivert bench vision"
        ) from error
    bounds = np.searchsorted(frame, np.arange(sobel.size + 1))
    sightings = [Sighting(track[a:b], bearing[a:b]) for a, b in pairwise(bounds.tolist())]
    stages = {stage: seconds[:, k].tolist() for k, stage in enumerate(STAGES)}
    return Contender.of_seconds(sobel.tolist(), np.sum(seconds, axis=1).tolist(), stages, sightings)
