"""What is said of the bus, the services, the devices and the store."""

from omnivert.cli.explain.explanation import Explanation

RUNNING = {
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
        "of two players, of a bridge and a simulated robot, and of two bridges with the same camera the second refuses "
        "to start. So does a second omnivert drive: each would undo what the other asks of the robot.",
        "To feed the services with a recording in place of the robot: omnivert up --config robot.toml --play REC. "
        "To have a simulated robot beside the real one: a configuration with another robot.id. "
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
    "OV608": Explanation(
        "moved_since",
        "The camera was knocked after this mount had been found: it no longer sits there. Whoever used the numbers "
        "would place every line wrongly, without a sign of it.",
        "Drive until it is calibrated anew; an older state is exported when it is asked for by its --entry.",
    ),
}
