"""What is said of wrong use and of the configuration."""

from omnivert.cli.explain.explanation import Explanation

USE = {
    "OV201": Explanation(
        "config_unreadable",
        "The configuration file could not be read: it is not there, not permitted, or not UTF-8.",
        "Print one to start from: omnivert config > robot.toml",
    ),
    "OV202": Explanation(
        "config_not_toml",
        "The configuration file is not valid TOML (or JSON, by its name). The line and column are in the message.",
        "Compare with: omnivert config",
    ),
    "OV203": Explanation(
        "unknown_key",
        "The configuration holds a key that omnivert does not know. It is refused and not passed over, because a "
        "misspelled wheel_base_m would silently calibrate another robot.",
        "The message names the nearest keys; omnivert config lists all of them with their meaning.",
    ),
    "OV204": Explanation(
        "value_refused",
        "A value has the wrong type or is out of its range. Lengths are in metres, angles named _deg in degrees and "
        "_rad in radians, sizes named _px in pixels.",
        "omnivert config shows every key with its unit and default.",
    ),
    "OV205": Explanation(
        "command_line",
        "The command line was not understood: an unknown command or option, or a missing argument.",
        "omnivert --help",
    ),
    "OV206": Explanation(
        "unknown_mode",
        "There are two modes: default, the best way known to us, and paper, extraction and filter as printed.",
        "Leave --mode out, or say --mode paper.",
    ),
    "OV207": Explanation(
        "unknown_code",
        "omnivert explain knows the codes that its refusals carry, OV101 and up.",
        "omnivert explain lists them.",
    ),
    "OV208": Explanation(
        "would_overwrite",
        "There is a recording of that name already, or the file is one that the command itself reads (recording, "
        "configuration, store) or writes something else to. The drive in a recording may be the only one.",
        "Choose another name.",
    ),
    "OV209": Explanation(
        "no_configuration",
        "omnivert up starts the drivers of a real robot. Which camera, which port, how wide the robot is and how "
        "many counts a turn of the wheel gives can not be guessed.",
        "omnivert config > robot.toml, change what is different on your robot, then omnivert up --config robot.toml",
    ),
    "OV210": Explanation(
        "system_refuses",
        "The operating system refused something that no command of omnivert goes on without: a disk is full, a name is "
        "too long, a device has gone. The message names the file where there is one.",
        "Mend that, then type the same command again.",
    ),
    "OV211": Explanation(
        "several_robots",
        "Services of more than one robot are on this bus. Without --robot or --config it is not known which one is "
        "meant, and what one robot sees says nothing of another.",
        "omnivert monitor --robot ID, with one of the names in the message.",
    ),
    "OV212": Explanation(
        "world_or_path",
        "A simulated drive needs a world and a path: names of those that come with omnivert, or TOML files of your "
        "own. A value in the file is wrong, a key is not known, or there is no such file.",
        "omnivert simulate --show prints the files of world and path; copy one, change it, name it my.toml.",
    ),
    "OV213": Explanation(
        "in_the_way",
        "The simulated robot would drive into a wall or a thing that stands in the room: no wall comes nearer to its "
        "origin than 0.28 m, nor nearer than 0.05 m beyond the camera, whatever way the robot turns.",
        "Begin the path elsewhere: start = [x, y, degrees] in the world's file, or in the path's, which goes first.",
    ),
    "OV214": Explanation(
        "no_terminal",
        "Driving by hand takes single keys, which only a terminal gives; a pipe or a service has none.",
        "Run omnivert drive in a terminal window of its own. Without hands: omnivert up --sim office --path alternate.",
    ),
    "OV220": Explanation(
        "no_peers",
        "The vision is compared with EDLines, LSD, ORB and SIFT. They come with opencv-contrib-python-headless, which "
        "would replace the OpenCV that omnivert runs on, so they have an environment of their own in your cache "
        "folder. It could not be made, mostly because no package index is in reach, or the one named lacks something.",
        "Leave them out: omnivert bench vision --no-peers. Or make an environment by hand, pip install "
        "'opencv-contrib-python-headless>=5.0,<6' 'numpy>=2.1,<3' into it, and name its python by --peers-python.",
    ),
    "OV221": Explanation(
        "peer_stopped",
        "One of the peers that the vision is compared with ended before the last frame, or left no result.",
        "Leave them out: omnivert bench vision --no-peers",
    ),
}
