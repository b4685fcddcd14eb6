"""What is said of a drive that does not show the mount."""

from omnivert.cli.explain.explanation import Explanation

DRIVE = {
    "OV101": Explanation(
        "no_frames",
        "The recording holds no images (and no bearings of another sensor). The calibration compares how the vertical "
        "lines around the camera move with how the wheels say the robot moves, so it needs both.",
        "Record with the camera running: omnivert up --record drive.mcap, then look at the rates in omnivert monitor.",
    ),
    "OV102": Explanation(
        "no_ticks",
        "The recording holds no wheel encoder counts. Without them nothing gives the scale of the world, and the place "
        "of the camera relative to the wheels is not seen at all.",
        "Check encoder.port and encoder.baud in the configuration; omnivert monitor shows the rate of the ticks.",
    ),
    "OV103": Explanation(
        "never_meet",
        "There are frames and there are ticks, but no frame lies between two ticks in time. Usually the two streams "
        "were stamped by different clocks.",
        "Stamp both with one monotonic clock, as the bridge does, and import or record again.",
    ),
    "OV104": Explanation(
        "not_turned",
        "phi says where the camera sits, psi how it is turned against that. Driving straight ahead shows only where "
        "the camera looks, and that is phi + psi. Only a turn moves the camera sideways, by rho, in a direction that "
        "depends on phi alone; below about 45 degrees of turning that is drowned by the wheels' noise.",
        "Turn by 90 degrees or more on the spot, drive 0.7 m straight, and repeat. omnivert monitor says when it is "
        "enough.",
    ),
    "OV105": Explanation(
        "not_driven",
        "Turning on the spot moves the camera on a circle of radius rho, and the lines with it; but a camera twice as "
        "far out among lines twice as far away sees the very same. Only a way driven straight gives the scale.",
        "Drive at least 0.7 m straight between two turns.",
    ),
    "OV106": Explanation(
        "contradiction",
        "No place of the camera explains what was seen. In nearly all cases a sign is wrong: the mirror image turns "
        "the sense of the image angle (camera.bearing_sign), a wheel counts backwards (encoder.left_sign, "
        "encoder.right_sign), or the wheels are swapped. A wrong wheel_base_m or ticks_per_rev does it, too.",
        "Turn the robot counter-clockwise on the spot: the bearings must fall and the right wheel must count up.",
    ),
    "OV107": Explanation(
        "moved",
        "The lines fit one mount in the first part of the drive and another one later: the camera was knocked. The "
        "value stored before is kept.",
        "Fasten the camera and drive again; omnivert extrinsics history shows the earlier values.",
    ),
    "OV108": Explanation(
        "standing",
        "The robot hardly moved while this was recorded. A camera that stands still learns nothing of its place.",
        "Drive 0.7 m straight, turn by 90 degrees, and repeat a few times.",
    ),
    "OV109": Explanation(
        "not_enough",
        "The drive shows all three parameters, but at least one of them not well enough: its sigma is above the limit "
        "(calibration.sigma_limit_deg, calibration.sigma_limit_m), or too few lines were followed long enough.",
        "Drive on: more turns of 90 degrees with straight ways between them, near walls with vertical edges.",
    ),
    "OV110": Explanation(
        "no_usable_frame",
        "There are frames, but not one of them gave a line: the mirror's rim was not found, or the pictures are dark, "
        "covered or broken. Lines are only believed around a rim.",
        "omnivert track REC --draw DIR shows what is seen, and dashed the ring that was told. A recording carries its "
        "own [ring]: correct it in meta.json, or in the configuration that it is recorded with, and make it again.",
    ),
    "OV120": Explanation(
        "no_ring",
        "A mirror shows as a disc whose border parts bright from dark nearly all around, at least two fifths of the "
        "picture's shorter side across and at least half of it in the picture. Nothing like it is in these pictures.",
        "Light the room, aim the camera at the mirror, focus on its rim, and try again: omnivert setup ring PICTURES.",
    ),
    "OV121": Explanation(
        "no_pictures",
        "The pictures given cannot be measured together: none can be read, or they are not all of one size.",
        "Give JPEG or PNG files, a folder of them, or a recording, of one camera in one of its modes.",
    ),
}
