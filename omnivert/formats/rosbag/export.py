"""Estimates -> a ROS bag: where the camera sits in the robot's frame, with its covariance, and as a transform."""

from collections import Counter
from collections.abc import Iterable
from math import cos, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnivert.errors import DataError
from omnivert.formats.exported_file import appearing
from omnivert.formats.extrinsics_export import robot_from_camera
from omnivert.formats.rosbag.file import BagWriter
from omnivert.messages import Estimate, Message, Mount, State

_NOT_MEASURED = 1e6  # variance of height, roll and pitch (m^2, rad^2): ROS has no word for it but a large number
_TRUSTED = (State.USABLE, State.CALIBRATED)


def export_rosbag(
    messages: Iterable[Message], camera: str, out: Path, origin_ns: int = 0, parent: str = "base_link"
) -> Counter[str]:
    """Writes a bag: of ROS 1 where the name ends in .bag, else of ROS 2, a folder.

    Every estimate with a mount is a geometry_msgs/PoseWithCovarianceStamped on /omnivert/CAMERA/mount. Those that are
    usable or calibrated are on /tf as well, because a transform cannot say how good it is.

    messages   of which the estimates are taken
    camera     name of the camera's frame
    origin_ns  added to every stamp: where a recording that came from a bag has its origin
    parent     name of the robot's frame
    returns    messages written, by topic
    raises     UseError when `out` is there already, DataError when it cannot be written or there is no mount to write
    """
    written: Counter[str] = Counter()
    pose_topic = f"/omnivert/{camera.replace('-', '_')}/mount"  # no dash in the names of ROS 2
    with appearing(out) as place, BagWriter(place) as bag:
        for estimate in messages:
            if not isinstance(estimate, Estimate) or estimate.mount is None:
                continue
            stamp_ns = estimate.stamp_ns + origin_ns
            header = bag.make("std_msgs/Header", stamp=bag.stamp(stamp_ns), frame_id=parent)
            x, y, yaw = robot_from_camera(estimate.mount)
            turn = bag.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=sin(0.5 * yaw), w=cos(0.5 * yaw))
            place_of = {"x": x, "y": y, "z": 0.0}
            pose = bag.make(
                "geometry_msgs/Pose", position=bag.make("geometry_msgs/Point", **place_of), orientation=turn
            )
            unsure = bag.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=covariance(estimate.mount))
            stamped = bag.make("geometry_msgs/PoseWithCovarianceStamped", header=header, pose=unsure)
            bag.write(pose_topic, stamp_ns, stamped)
            written[pose_topic] += 1
            if estimate.state in _TRUSTED:
                shift = bag.make("geometry_msgs/Vector3", **place_of)
                transform = bag.make("geometry_msgs/Transform", translation=shift, rotation=turn)
                link = bag.make(
                    "geometry_msgs/TransformStamped", header=header, child_frame_id=camera, transform=transform
                )
                bag.write("/tf", stamp_ns, bag.make("tf2_msgs/TFMessage", transforms=[link]))
                written["/tf"] += 1
        if not written:
            because = "none of its estimates has a mount: the drive did not show one, or no calibration was recorded"
            raise DataError("OV334", "there is no mount to write into a bag", because, "omnivert calibrate REC")
    return written


def covariance(mount: Mount) -> NDArray[np.float64]:
    """(36,) of x, y, z, roll, pitch, yaw, row by row, as ROS has it: m, m, m, rad, rad, rad."""
    c, s = cos(mount.phi_rad), sin(mount.phi_rad)
    slope = np.zeros((6, 3))  # by phi, rho, psi
    slope[0] = -mount.rho_m * s, c, 0.0
    slope[1] = mount.rho_m * c, s, 0.0
    slope[5] = 1.0, 0.0, 1.0
    unknown = np.diag([0.0, 0.0, _NOT_MEASURED, _NOT_MEASURED, _NOT_MEASURED, 0.0])
    full: NDArray[np.float64] = slope @ mount.covariance @ slope.T + unknown
    return full.reshape(-1)
