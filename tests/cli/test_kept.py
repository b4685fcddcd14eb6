"""At the end it is said what is really in the store, and not what was meant to be."""

from pathlib import Path

import pytest

from omnivert.cli.robot.kept import Before
from omnivert.cli.robot.supervisor import Event, Happened
from omnivert.cli.robot.troubles import Troubles
from omnivert.config import Config, parsed
from omnivert.store import Store

from .conftest import extrinsics


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return parsed({"storage": {"path": str(tmp_path / "x.db")}}, "test")


def put(config: Config, *stamps: int) -> None:
    with Store(config.storage.path) as store:
        for stamp in stamps:
            store.put(extrinsics("demo", "front", stamp, 0.5))


def test_what_has_come_since_is_named(config: Config) -> None:
    path = config.storage.path
    begun = Before.of(config)
    put(config, 1)
    assert begun.told(config, "") == f"stored #1 in {path}"
    again = Before.of(config)
    put(config, 2, 3)
    assert again.told(config, "") == f"stored #2 to #3 in {path}"
    assert again.told(config, "it is full") == f"stored #2 to #3 in {path}: it is full"


def test_nothing_new_is_said_with_the_reason(config: Config) -> None:
    path = config.storage.path
    assert Before.of(config).told(config, "") == f"nothing was stored in {path}: nothing was calibrated"
    assert Before.of(config).told(config, "no folder") == "nothing was stored: no folder"
    put(config, 1)
    same = Before.of(config)
    put(config, 1)
    assert same.told(config, "") == f"nothing new was stored in {path}; its latest is #1"
    assert same.told(config, "locked") == f"nothing new was stored in {path}: locked; its latest is #1"


def test_a_store_that_was_set_aside_is_told(config: Config) -> None:
    path = config.storage.path
    path.write_bytes(b"damaged" * 1000)
    begun = Before.of(config)
    assert begun.told(config, "").startswith(f"nothing was stored: the store {path} cannot be opened: it is damaged")
    put(config, 1)
    assert begun.told(config, "") == f"stored #1 in {path}; the damaged one is kept beside it"


def test_a_trouble_is_over_when_the_service_says_something_else() -> None:
    troubles = Troubles()
    assert troubles.unresolved("storage") == ""
    troubles(Event("storage", Happened.SAID, "storage: error[OV601]: it is locked; what is to be stored waits"))
    assert troubles.unresolved("storage") == "it is locked; what is to be stored waits"
    troubles(Event("storage", Happened.SAID, "storage: the store x.db can be written again"))
    assert troubles.unresolved("storage") == ""
