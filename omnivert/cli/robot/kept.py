"""What has really come into the store while services ran, told when they have stopped."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from omnivert.config import Config

if TYPE_CHECKING:
    from omnivert.store import Entry


@dataclass(frozen=True, slots=True)
class Before:
    """The store as it was when they started.

    entry    the newest number; None when it could not be read
    damaged  it is set aside then, and its numbers begin anew
    """

    entry: int | None
    damaged: bool = False

    @classmethod
    def of(cls, config: Config) -> Self:
        from omnivert.store import StoreError

        try:
            return cls(max((entry.entry for entry in _entries(config)), default=0))
        except StoreError as error:
            return cls(None if error.code in ("OV601", "OV604") else 0, damaged=error.code == "OV603")

    def told(self, config: Config, trouble: str) -> str:
        """What has been stored since, or that nothing was and why.

        trouble  what keeps storage from storing, as it said last; "" when nothing does
        """
        from omnivert.store import StoreError

        path, why = config.storage.path, f": {trouble}" if trouble else ""
        aside = "; the damaged one is kept beside it" if self.damaged else ""
        try:
            entries = _entries(config)
        except StoreError as error:
            missing = error.code == "OV605"
            return f"nothing was stored{why or (f' in {path}: nothing was calibrated' if missing else f': {error}')}"
        numbers = sorted(entry.entry for entry in entries if self.entry is not None and entry.entry > self.entry)
        if numbers:
            names = f"#{numbers[0]}" if len(numbers) == 1 else f"#{numbers[0]} to #{numbers[-1]}"
            return f"stored {names} in {path}{aside}{why}"
        if not entries:
            return f"nothing was stored in {path}{aside}{why or ': nothing was calibrated'}"
        news = "nothing new was stored" if self.entry is not None else "the store could not be read at the start"
        return f"{news} in {path}{aside}{why}; its latest is #{entries[0].entry}"


def _entries(config: Config) -> "list[Entry]":
    """Of this robot's camera, the latest first; raises StoreError."""
    from omnivert.store import Store

    with Store(config.storage.path, writable=False, locked_s=0.5) as store:
        return store.history(config.robot.id, config.camera.id)
