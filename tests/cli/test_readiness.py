"""When all is ready, and what is said until then, of services that come in any order."""

import pytest

from omnivert.cli.robot.readiness import LONG_S, QUIET_S, Readiness
from omnivert.messages import Health

ROBOT = ("router", "bridge", "vision", "calibration", "storage")
BEGUN = "begins from nothing: nothing is stored for this camera"


def health(service: str, *notes: str, published: tuple[str, ...] = ()) -> Health:
    return Health(1, service, "front", 1.0, published=dict.fromkeys(published, 3), notes=notes)


AT_WORK = {
    "router": health("router"),
    "bridge": health("bridge", published=("v1/camera/front/frame", "v1/encoder/base/ticks")),
    "player": health("player", published=("v1/vision/front/bearings",)),
    "vision": health("vision", "12 lines found"),
    "calibration": health("calibration", BEGUN),
    "storage": health("storage"),
}


def heard(services: tuple[str, ...] = ROBOT, **others: Health) -> Readiness:
    """Services at work, but for these."""
    readiness = Readiness(services, "the sensors")
    for name in services:
        readiness.take(others.get(name, AT_WORK[name]))
    return readiness


@pytest.mark.parametrize("source", ["bridge", "player"])
def test_all_is_ready_when_each_is_there_and_the_calibration_has_begun(source: str) -> None:
    services = tuple(source if name == "bridge" else name for name in ROBOT)
    readiness = heard(services)
    assert readiness.lacking(frozenset(services), 1.0) == []
    assert readiness.begun == BEGUN
    for name in services:
        words = "the sensors" if name == source else name
        assert readiness.lacking(frozenset(services) - {name}, 1.0) == [words]


@pytest.mark.parametrize(
    ("name", "lacks", "missing"),
    [
        ("vision", None, "vision"),
        ("calibration", health("calibration"), "the calibration to begin"),
        ("bridge", health("bridge", published=("v1/camera/front/frame",)), "the first wheel counts"),
        ("bridge", health("bridge", published=("v1/encoder/base/ticks",)), "the first frame"),
        (
            "bridge",
            health("bridge", "encoder: /dev/ttyUSB0 is not there", published=("v1/camera/front/frame",)),
            "the encoder: /dev/ttyUSB0 is not there",
        ),
        ("storage", health("storage", "storage: no folder x; 2 waiting"), "storage: no folder x; 2 waiting"),
    ],
)
def test_one_that_is_there_and_not_at_work_is_waited_for(name: str, lacks: Health | None, missing: str) -> None:
    readiness = Readiness(ROBOT, "the sensors")
    for service in ROBOT:
        if (told := lacks if service == name else AT_WORK[service]) is not None:
            readiness.take(told)
    assert readiness.lacking(frozenset(ROBOT), 1.0) == [missing]
    readiness.take(AT_WORK[name])
    assert readiness.lacking(frozenset(ROBOT), 1.0) == []


def test_a_store_that_was_damaged_and_begun_anew_is_ready() -> None:
    readiness = heard(storage=health("storage", "storage: x.db was damaged; it is kept as x.damaged"))
    assert readiness.lacking(frozenset(ROBOT), 1.0) == []


def test_what_is_missing_is_said_after_a_while_and_once() -> None:
    readiness, present = heard(), frozenset(ROBOT) - {"vision", "calibration"}
    assert readiness.told(present, QUIET_S - 0.1) == ""
    assert readiness.told(present, QUIET_S) == "waiting for vision, calibration"
    assert readiness.told(present, QUIET_S + 0.1) == ""
    long = readiness.told(present, LONG_S)
    assert long.startswith("waiting for vision and calibration (compiling, ")
    assert "half a minute" in long
    assert readiness.told(present, LONG_S + 60.0) == ""
    assert readiness.told(frozenset(ROBOT), LONG_S + 61.0) == ""
