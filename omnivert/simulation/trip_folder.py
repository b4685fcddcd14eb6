"""A simulated drive as a folder of plain files, which `omnivert import frames` reads."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from omnivert.errors import DataError
from omnivert.messages import Frame, Scan, Ticks
from omnivert.simulation.trip import SECOND, Trip

Progress = Callable[[int, int], None]  # told messages written, and how many there are


def write_folder(trip: Trip, out: Path, progress: Progress | None = None) -> None:
    """Writes the drive into the new folder `out`, which appears when it is whole, and not before.

    raises  DataError when the system does not let it be written
    """
    begun = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        (begun / "frames").mkdir(parents=True)
        _write(trip, begun, progress)
        begun.rename(out)
    except OSError as error:
        raise DataError("OV322", f"cannot write {out}", error.strerror or str(error), "choose another place") from error
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _write(trip: Trip, folder: Path, progress: Progress | None) -> None:
    total, index = sum(trip.counts.values()), 0
    with (
        (folder / "frames.csv").open("w") as frames,
        (folder / "encoders.csv").open("w") as encoders,
        (folder / "scans.csv").open("w") as scans,
    ):
        frames.write("index,t_s,file\n")
        encoders.write("t_s,left_ticks,right_ticks\n")
        for done, message in enumerate(trip.messages(), 1):
            at = f"{message.stamp_ns / SECOND:.9f}"
            match message:
                case Frame():
                    name = f"frames/{index:06d}.jpg"
                    (folder / name).write_bytes(message.data.tobytes())
                    frames.write(f"{index},{at},{name}\n")
                    index += 1
                case Ticks():
                    encoders.write(f"{at},{message.left},{message.right}\n")
                case Scan():
                    if index == 0:
                        scans.write(",".join(["t_s", *(f"r{k}" for k in range(message.range_m.size))]) + "\n")
                    scans.write(",".join([at, *(f"{far:.3f}" for far in message.range_m.tolist())]) + "\n")
            if progress is not None:
                progress(done, total)
    (folder / "truth").mkdir()
    for name, data in trip.attachments():
        (folder / name).write_bytes(data)
