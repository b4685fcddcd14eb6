"""A ROS bag -> a recording."""

from pathlib import Path

from omnivert.config import Config
from omnivert.formats.rosbag.drive import RosBag
from omnivert.formats.rosbag.topics import Named
from omnivert.formats.written import Progress, write_recording


def import_rosbag(
    path: Path,
    out: Path,
    base: Config | None = None,
    named: Named | None = None,
    bag_times: bool = False,
    progress: Progress | None = None,
) -> RosBag:
    """Writes the bag into the recording `out`, which appears when it is whole, and not before.

    base       names robot, camera and encoder, and gives the rig, of which a bag says little; the defaults without it
    named      topics and joints that are not to be guessed
    bag_times  stamps by the time of recording in place of the headers' stamps
    progress   told messages read and written, and how many there are; the wheels are read before anything is written
    returns    the bag that was read
    raises     DataError naming topic and message, UseError when what was named is not there
    """
    given = RosBag(path, Config() if base is None else base, named or Named(), bag_times, progress)

    def written(done: int, total: int) -> None:
        if progress is not None:
            progress(given.read + done, given.read + total)

    write_recording(given, out, written)
    return given
