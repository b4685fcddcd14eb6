"""What each refusal means, why it is there, and the way out: one entry for each code."""

from omnivert.cli.explanation import Explanation
from omnivert.cli.explanations_exchange import EXCHANGE

EXPLANATIONS: dict[str, Explanation] = {
    # 1: the drive
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
    # 2: use and configuration
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
        "origin than 0.28 m.",
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
    # 3: recordings and other files
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
    **EXCHANGE,
    # 4: the bus and the services on it
    "OV401": Explanation(
        "no_router",
        "Nothing listens at the end point of the configuration. All services of a robot meet at one router.",
        "On the robot: omnivert up --config robot.toml. From another machine the router must listen on the network "
        "(bus.listen), and omnivert monitor must be told where: --connect tcp/ADDRESS:7447",
    ),
    "OV402": Explanation(
        "not_beside",
        "The bridge and the player publish the same streams, one from the robot and one from a recording. Both at once "
        "would mix two drives into one. The player gives way to the bridge, also when the bridge comes while it plays; "
        "of two players the second refuses to start.",
        "To feed the services with a recording in place of the robot: omnivert up --config robot.toml --play REC. "
        "Otherwise stop the other one first; omnivert monitor shows who is there.",
    ),
    "OV403": Explanation(
        "cannot_listen",
        "The router cannot open its end point: mostly because another router listens there already.",
        "Stop the other one, or set endpoint under [bus] to another port.",
    ),
    "OV404": Explanation(
        "service_missing",
        "The player was asked to wait for a service that did not come.",
        "omnivert monitor shows which services are there.",
    ),
    "OV420": Explanation(
        "silence",
        "The services are there, but none of them has said anything for a while.",
        "Run it again; when it happens again, the machine is probably far too busy.",
    ),
    "OV421": Explanation(
        "nothing_stored",
        "The playback went through, but nothing was calibrated, so nothing was stored.",
        "omnivert calibrate corridor says why.",
    ),
    "OV422": Explanation(
        "not_up",
        "A service was started and did not report on the bus in time.",
        "Run it again on a machine that is less busy.",
    ),
    "OV423": Explanation(
        "service_refused",
        "A service ended at once when it was started, and starting it again would not help.",
        "The message holds what it said.",
    ),
    # 5: devices
    "OV501": Explanation(
        "camera_silent",
        "The camera that the configuration names does not open, or gives no picture: not there, not permitted, or in "
        "use by another program, such as the bridge of a running omnivert up.",
        "Check camera.source, stop what holds the camera, or give pictures that were taken before.",
    ),
    # 6: the store
    "OV601": Explanation(
        "store_locked",
        "Another program has the store locked. Nothing is lost: what is to be stored waits and is tried again.",
        "End the other program; fuser FILE shows which one it is.",
    ),
    "OV602": Explanation(
        "store_unusable",
        "The store cannot be opened, read or written: the folder does not exist, is read-only, or the disk is full.",
        "Set storage.path to a file in a folder that you may write.",
    ),
    "OV603": Explanation(
        "store_damaged",
        "The store's file is damaged. The storage service sets it aside under another name, never overwrites it, and "
        "begins a new one.",
        "omnivert up does so; the old file stays beside the new one.",
    ),
    "OV604": Explanation(
        "not_our_store",
        "The file is a data base of another program, or of a newer omnivert.",
        "Set storage.path to another file.",
    ),
    "OV605": Explanation(
        "no_store",
        "There is no store at that place yet: nothing was calibrated by services that use it.",
        "omnivert demo makes one in ./omnivert-demo; --store names another file.",
    ),
    "OV606": Explanation(
        "store_moved",
        "The store's file was moved or removed while it was open; what would be written to it would be lost.",
        "Put it back, or let the storage service begin a new one.",
    ),
    "OV607": Explanation(
        "not_stored",
        "The store is there, but holds nothing for this robot and camera, or no entry of this number.",
        "omnivert extrinsics list shows what it holds; --robot and --camera choose.",
    ),
}
