import numpy as np

from omnivert.messages import Bearings, Ring
from omnivert.pictures.overlay import overlay, track_color


def _bearings(bearing: float, ring: Ring | None = None, reasons: tuple[str, ...] = ()) -> Bearings:
    return Bearings(
        stamp_ns=0,
        track_id=np.array([3]),
        bearing_rad=np.array([bearing]),
        std_rad=np.array([1e-3]),
        age_frames=np.array([9], dtype=np.int32),
        strength=np.array([0.5], dtype=np.float32),
        ring=ring,
        reasons=reasons,
    )


RING = Ring(100.0, 80.0, 70.0, 1.0)


def test_a_line_is_drawn_in_its_tracks_colour_at_its_bearing_with_either_sign() -> None:
    picture = np.zeros((160, 200), dtype=np.uint8)
    for sign, row in ((1, 40), (-1, 120)):  # image angle pi / 2 is up
        drawn = overlay(picture, _bearings(np.pi / 2.0, RING), sign, 20.0)
        assert drawn.shape == (160, 200, 3)
        assert np.max(np.abs(drawn[row, 100].astype(int) - track_color(3))) < 60  # smoothed at its border
        assert not drawn[160 - row, 100].any()
    assert not picture.any()


def test_without_a_ring_only_the_reasons_are_drawn() -> None:
    picture = np.zeros((160, 200, 3), dtype=np.uint8)
    assert not overlay(picture, _bearings(0.0), 1, 20.0).any()
    assert overlay(picture, _bearings(0.0, reasons=("ring not in the picture",)), 1, 20.0).any()
    assert not picture.any()


def test_tracks_next_to_each_other_differ_in_colour() -> None:
    colors = np.array([track_color(k) for k in range(30)], dtype=float)
    assert np.min(np.abs(np.diff(colors, axis=0)).sum(axis=1)) > 100.0
