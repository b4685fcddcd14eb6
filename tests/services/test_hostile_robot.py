"""A robot that tells the real services what no robot should: they stay, they count it, and what is stored stays."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import omnivert
from omnivert.cli.robot.supervisor import Happened
from omnivert.config import Config
from omnivert.messages import Bearings, Estimate, Extrinsics, Health, Message, Mount, State, Ticks
from omnivert.store import Store
from omnivert.wire.bus import Bus, Received
from omnivert.wire.channels import BEARINGS, EXTRINSICS, TICKS
from omnivert.wire.codec import encode
from omnivert.wire.forms import WireError
from tests.calibration.hostile import ENDS, LINES, MOUNT, SECOND, Odd, Part, Teller, Well
from tests.services.test_processes import DEADLINE_S, running

SEED = 7
PARTS = 60
SOUND = 40  # frames at the end
HASTE = 100.0  # what is stamped a third of a second apart is sent within milliseconds: a stream may lag so much more
SERVICES = ("router", "storage", "calibration")


def hostile_stream(config: Config, seed: int) -> list[Ticks | Bearings]:
    """As much of it as can be sent at all; a sound robot at the end."""
    rng = np.random.default_rng(seed)
    parts: list[Part] = []
    for _ in range(PARTS):
        values: list[float | None] = [None if rng.random() < 0.5 else float(v) for v in rng.uniform(-3.0, 3.0, 2)]
        stamps = [None, None, 0, 1, -1, -SECOND, -60 * SECOND, 60 * SECOND, 600 * SECOND, 2**61]
        counts = [None, *ENDS[:5]]
        parts += [
            Well(int(rng.integers(1, 5)), bool(rng.random() < 0.5), bool(rng.random() < 0.3)),
            Odd(
                bool(rng.random() < 0.6),
                stamps[int(rng.integers(len(stamps)))],
                counts[int(rng.integers(len(counts)))],
                values[0],
                values[1],
                None if rng.random() < 0.6 else int(rng.integers(0, 3)),
                int(rng.choice([0, 1, LINES, 3 * LINES])),
            ),
        ]
    parts.append(Well(SOUND, False))
    return [message for message in Teller(config, seed).told(parts) if is_sendable(message)]


def is_sendable(message: Message) -> bool:
    try:
        encode(message)
    except WireError:
        return False
    return True


def mount_stored(config: Config) -> Extrinsics:
    phi, rho, psi = MOUNT.tolist()
    mount = Mount(phi, rho, psi, np.diag([0.003**2, 0.0005**2, 0.003**2]))
    software = f"omnivert {omnivert.__version__}"
    robot, camera = config.robot.id, config.camera.id
    return Extrinsics(5, robot, camera, mount, State.CALIBRATED, 99, (), software, config.rig_digest())


def content(path: Path) -> bytes:
    """All of the file but SQLite's own count of changes, which is kept twice and grows with each opening."""
    data = path.read_bytes()
    return data[:24] + data[28:92] + data[96:]


def test_calibration_and_storage_live_through_it_and_the_store_keeps_its_bytes(config: Config, folder: Path) -> None:
    timeline = config.timeline.model_copy(update={"lateness_s": HASTE * config.timeline.lateness_s})
    config = config.model_copy(update={"timeline": timeline})
    known = mount_stored(config)
    with Store(config.storage.path) as store:
        store.put(known)
    before = content(config.storage.path)
    file = folder / "config.json"
    file.write_text(config.model_dump_json(), encoding="utf-8")
    stream = hostile_stream(config, SEED)
    other = replace(known, stamp_ns=6)
    claims = {
        "extrinsics of nobody who is here as calibration": other,
        "extrinsics of another robot or camera": replace(other, robot="another"),
        "extrinsics of another rig: its digest is not the configuration's": replace(other, rig_digest="another"),
        "extrinsics out of range: rho_m is above calibration.max_rho_m": replace(
            other, mount=replace(known.mount, rho_m=99.0)
        ),
    }
    told = {Ticks: TICKS, Bearings: BEARINGS}
    sent = Counter(told[type(message)].key(config) for message in stream)
    sound = {message.stamp_ns for message in stream[-2 * SOUND :]}
    estimates: list[Estimate] = []
    health: dict[str, Health] = {}

    def has_come(received: Received) -> bool:
        """Whether both services have told of everything that was sent, and no wrong stamp has made one deaf."""
        match received.message:
            case Health() as told_now:
                health[told_now.service] = told_now
            case Estimate() as estimate:
                estimates.append(estimate)
        calibration, storage = health.get("calibration"), health.get("storage")
        return (
            calibration is not None
            and storage is not None
            and sum(storage.refused.values()) >= len(claims)
            and all(calibration.received.get(key, 0) >= count for key, count in sent.items())
            and len(sound.intersection(e.stamp_ns for e in estimates)) > SOUND / 2
        )

    def is_seen(bearings: Bearings, received: Received) -> bool:
        has_come(received)
        return isinstance(received.message, Bearings) and received.message.stamp_ns == bearings.stamp_ns

    with running(file, *SERVICES) as (supervisor, ears, events):
        bus = ears.bus
        assert bus.await_presence(lambda: all(bus.incarnations(name) for name in SERVICES[1:]), DEADLINE_S)
        pids = {service: supervisor.pid(service) for service in SERVICES}
        with Bus(config, "bridge", "bridge") as robot:
            for message in stream:  # no faster than they go: who lags too far behind is not waited for
                robot.publish(told[type(message)], message)
                if isinstance(message, Bearings):
                    ears.until("a frame", partial(is_seen, message))
            for claim in claims.values():
                robot.publish(EXTRINSICS, claim)
            ears.until("the health of both", has_come)
        assert {service: supervisor.pid(service) for service in SERVICES} == pids
    assert {event.happened for event in events} <= {Happened.STARTED, Happened.SAID}
    assert content(config.storage.path) == before
    assert health["storage"].refused == dict.fromkeys(claims, 1)
    refused = health["calibration"].refused
    assert {reason.partition(":")[0] for reason in refused} >= {"Ticks", "Bearings"}
    assert all(count > 0 for count in refused.values())
    assert all(e.mount is not None and np.isfinite(e.mount.covariance).all() for e in estimates)
