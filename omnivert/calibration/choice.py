"""Which lines of a frame are taken, where there are more than the calibration takes: so a frame's cost has a bound."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN
from omnivert.calibration.sighting import Sighting

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SECTORS = 36  # of the circle: new lines are taken where the fewest are
UNSEEN = 3  # frames in a row without a sight after which a track is another one


class Choice:
    """Takes a frame's lines and gives those that go on.

    A line that was taken is worth more the longer it is followed, so the same lines go on while they are seen. Places
    that are free go to the part of the circle that has the fewest; there to the track that was seen most often, then to
    the most precise one. Frames of few lines go on whole.

    most  lines of a frame that go on
    """

    def __init__(self, most: int) -> None:
        self.left_out = 0  # lines so far
        self._most = most
        self._name = np.zeros(0, dtype=np.int64)  # tracks seen of late, rising; the next three beside it
        self._taken = np.zeros(0, dtype=np.int64)  # sights that went on
        self._seen = np.zeros(0, dtype=np.int64)  # sights in all
        self._gone = np.zeros(0, dtype=np.int64)  # frames since the last one

    def step(self, sighting: Sighting) -> Sighting:
        """The sighting, or the part of it that goes on; with the reason where it is a part."""
        names = np.union1d(self._name, sighting.track)
        before, here = np.searchsorted(names, self._name), np.searchsorted(names, sighting.track)
        taken, seen, gone = (np.zeros(names.size, dtype=np.int64) for _ in range(3))
        taken[before], seen[before], gone[before] = self._taken, self._seen, self._gone + 1
        seen[here] += 1
        gone[here] = 0
        on = sighting
        if here.size > self._most:
            on = _part(sighting, _best(taken[here], seen[here], sighting, self._most))
            self.left_out += here.size - self._most
        taken[np.searchsorted(names, on.track)] += 1
        stays = gone <= UNSEEN
        self._name, self._taken, self._seen, self._gone = names[stays], taken[stays], seen[stays], gone[stays]
        return on


def _best(taken: Index, seen: Index, sighting: Sighting, most: int) -> Index:
    """Which lines (K,) of a sighting go on, rising."""
    order = np.lexsort((sighting.track, sighting.std, -seen, -taken))  # the last key counts most
    known = order[taken[order] > 0][:most]
    fresh = order[taken[order] == 0]
    sector = np.floor((sighting.beta + 0.5 * TURN) / TURN * SECTORS).astype(np.int64) % SECTORS
    crowd = np.bincount(sector[known], minlength=SECTORS)
    # The first new line of a sector stands behind those that it has, the second behind that one, and so on.
    by_sector = np.argsort(sector[fresh], kind="stable")
    own = sector[fresh[by_sector]]
    level = crowd[own] + np.arange(own.size) - np.searchsorted(own, own)
    spread = fresh[by_sector][np.argsort(level, kind="stable")]
    return np.sort(np.concatenate([known, spread[: most - known.size]]))


def _part(sighting: Sighting, lines: Index) -> Sighting:
    reason = f"{sighting.track.size} lines in a frame, {lines.size} of them taken"
    return replace(
        sighting,
        track=sighting.track[lines],
        beta=sighting.beta[lines],
        std=sighting.std[lines],
        reasons=(*sighting.reasons, reason),
    )
