"""Which robot a command that listens means, where nobody said so: the one that is there."""

from pathlib import Path

from omnivert.cli.settings import PATIENCE_S, settings, with_camera, with_robot
from omnivert.config import Config
from omnivert.errors import UseError

SERVICES = ("bridge", "player", "vision", "calibration", "storage")  # a robot's own; others only listen
WITH_CAMERA = ("bridge", "player", "vision", "calibration")  # their instance is the camera's id
NAMED = 5  # of many robots


def meant(path: Path | None, robot: str | None, connect: str | None, command: str) -> Config:
    """The configuration to listen with; without a file its robot and camera are those that are on the bus.

    raises  UseError when more than one robot is there and none was named
    """
    chosen = settings(path, robot, connect)
    if path is not None:
        return chosen
    from omnivert.wire.robots import alive

    services = [who for who in alive(chosen, PATIENCE_S) if who[1] in SERVICES and _is_id(who[0]) and _is_id(who[2])]
    if robot is None:
        robots = sorted({name for name, _, _ in services})
        if len(robots) > 1:
            more = ", ..." if len(robots) > NAMED else ""
            names = f"{', '.join(robots[:NAMED])}{more}"
            help = f"omnivert {command} --robot {robots[0]}"
            raise UseError("OV211", f"{len(robots)} robots are on this bus: {names}", "", help)
        chosen = with_robot(chosen, robots[0] if robots else None)
    cameras = {camera for name, service, camera in services if name == chosen.robot.id and service in WITH_CAMERA}
    return with_camera(chosen, cameras.pop()) if len(cameras) == 1 else chosen


def _is_id(text: str) -> bool:
    """Whether it can be the id of a robot or a camera: anybody may put anything into a token."""
    try:
        with_robot(Config(), text)
    except UseError:
        return False
    return True
