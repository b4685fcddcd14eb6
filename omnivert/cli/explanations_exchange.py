"""What the refusals mean of recordings that are merged or exported, of bags of ROS and of files for Foxglove."""

from omnivert.cli.explanation import Explanation

EXCHANGE = {
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
}
