"""What is said of recordings and other files."""

from omnivert.cli.explain.explanation import Explanation

DATA = {
    "OV301": Explanation(
        "recording_unreadable",
        "The recording is there but cannot be read: not permitted, or the disk fails.",
        "Copy it to another place and try again.",
    ),
    "OV302": Explanation(
        "not_a_recording",
        "The file does not begin as an MCAP file does, so it is no recording of omnivert's.",
        "A folder of images becomes a recording by omnivert import frames DIR -o OUT.mcap",
    ),
    "OV303": Explanation(
        "recording_empty",
        "The file is a recording, but there is not one readable message in it.",
        "Record again: omnivert record drive.mcap",
    ),
    "OV304": Explanation(
        "recording_stopped",
        "The recorder cannot write any further, mostly because the disk is full. What was written before is good.",
        "Free some space, or record to another disk.",
    ),
    "OV305": Explanation(
        "nothing_to_play",
        "The recording, or the part of it between --from and --to, holds no images, wheel counts or bearings, so there "
        "is nothing to play.",
        "omnivert play REC --info shows what is in it.",
    ),
    "OV306": Explanation(
        "attachment_damaged",
        "A file that the recording carries beside its messages (the truth, for one) is damaged. The messages are read "
        "independently of it.",
        "Copy the recording again, or import its folder again.",
    ),
    "OV307": Explanation(
        "rig_damaged",
        "A recording carries the geometry of the robot that made it. Here a value of it is out of its range, or has a "
        "name that is not known. Wheels or ring of another robot would give a wrong mount, so nothing is guessed.",
        "Record the drive again, or take a copy of the recording that is whole.",
    ),
    "OV308": Explanation(
        "nothing_recorded",
        "Neither a sensor nor a result said anything while this was recorded, so no file was kept.",
        "omnivert monitor shows which services of which robot are there; --robot and --connect choose.",
    ),
    "OV309": Explanation(
        "rig_changed",
        "A recording carries the geometry of the robot that made it, and a digest of that. They do not fit each other, "
        "or the geometry can not be found any more: bits of the file have changed. A wheel that is a little larger "
        "would give a wrong mount that looks right, so nothing is calibrated.",
        "Take a copy of the recording that is whole, or import its folder again.",
    ),
    "OV310": Explanation(
        "import_refused",
        "The folder does not have the form that is read. omnivert import frames reads meta.json, frames.csv "
        "(index,t_s,file) and encoders.csv (t_s,left_ticks,right_ticks); omnivert import bearings reads meta.json, "
        "bearings.csv (t_s,track_id,bearing_rad) and wheels.csv (t_s,left_m,right_m). The message names the file and "
        "the row: a missing file or column, a number that is none or out of its range, times that run backwards or "
        "jump by more than an hour, streams that have no time in common, an image that cannot be read or lies outside "
        "the folder, a track that comes twice at one time.",
        "Mend that row and import again; no half-written recording was left.",
    ),
    "OV311": Explanation(
        "import_not_written",
        "The recording could not be written: the folder does not exist, is read-only, or the disk is full.",
        "Choose another place for -o.",
    ),
    "OV320": Explanation(
        "packaged_recording_missing",
        "The recording that comes with omnivert is not where the package should have it; the installation is broken.",
        "Install the package again.",
    ),
    "OV321": Explanation(
        "no_such_recording",
        "There is no file of that name, or what has the name is a folder or a device. The word corridor stands for the "
        "recording that comes with omnivert.",
        "omnivert calibrate corridor",
    ),
    "OV322": Explanation(
        "cannot_write",
        "The output could not be written: the folder does not exist, is read-only, or the disk is full.",
        "Choose another place.",
    ),
    "OV312": Explanation(
        "not_one_drive",
        "omnivert rec merge makes one recording of several that follow each other: parts of one that was split or "
        "cut. These were made by different rigs, or a sensor was recorded at the same time in both, so that they are "
        "no one drive: two robots, two cameras, or a part that is there twice.",
        "omnivert rec info shows rig and times of each; omnivert rec cut takes a part of one.",
    ),
    "OV313": Explanation(
        "not_exported",
        "The recording holds neither images nor bearings under the names of its own rig, so there is no folder format "
        "for it; or the folder could not be written: its place does not exist, is read-only, or the disk is full.",
        "omnivert rec info shows what it holds; choose another place for -o.",
    ),
    "OV330": Explanation(
        "extra_missing",
        "Bags of ROS are read and written by the library rosbags, files for Foxglove by foxglove-sdk. Who calibrates "
        "with omnivert alone needs neither, so they are installed only on demand.",
        "pip install 'omnivert[ros]', or pip install 'omnivert[foxglove]'; the message says which.",
    ),
    "OV331": Explanation(
        "bag_unreadable",
        "The bag cannot be read: it is none, its end is missing because the recorder was killed or the disk was full, "
        "a part of it is damaged, or it is compressed or encrypted in a way that the library rosbags does not know. "
        "omnivert import rosbag reads a .bag file of ROS 1 (version 2.0), a folder of them that were recorded in one "
        "go, a folder of ROS 2 with metadata.yaml, and a single .db3 or .mcap of it.",
        "Mend it with the tools of ROS: rosbag reindex (ROS 1), ros2 bag reindex (ROS 2), mcap recover (.mcap).",
    ),
    "OV332": Explanation(
        "topics_unclear",
        "A recording needs pictures and wheels, and it is not clear which topics of the bag they are. Pictures are an "
        "Image or a CompressedImage. Wheels are, the rawest first: a message with a whole number for left and one for "
        "right, two topics with a whole number each (std_msgs/Int32 and the like), a JointState with the angles of "
        "both wheels, or an Odometry. What is left and what is right is read from the names. A kind of which there is "
        "exactly one is taken and said.",
        "Name what is meant: --image-topic, --ticks-topic, --left-topic and --right-topic, --joint-topic, "
        "--left-joint, --right-joint, --odom-topic, --scan-topic. omnivert import rosbag --help explains them.",
    ),
    "OV333": Explanation(
        "bag_refused",
        "The bag can be read, but a message in it cannot be used; the refusal names topic and message. Its stamp is "
        "zero, runs backwards or jumps by more than an hour; wheels and pictures have no time in common, which "
        "happens when they were stamped by different clocks; a picture has an encoding that is no picture of light, "
        "does not fit its size, or has another size than the first one; a number is none.",
        "Where only the stamps are wrong, --bag-times of omnivert import rosbag takes the time of recording in their "
        "place. Otherwise record again; no half-written recording was left.",
    ),
    "OV334": Explanation(
        "no_mount_to_export",
        "A bag for ROS holds the mounts that the calibration found while the robot drove. This recording has none: the "
        "drive did not show the mount, or only the sensors were recorded.",
        "omnivert calibrate says what the drive is missing; a recording made beside a calibration holds its estimates.",
    ),
}
