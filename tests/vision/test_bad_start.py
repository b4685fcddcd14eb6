"""A bad picture at the beginning, or of a small camera: what was taken from it does not last."""

import numpy as np
import pytest

from omnivert.bench.score.circle import nearest
from omnivert.config import Camera, Config, MirrorRing
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.frontend import FrontEnd
from tests.vision.drive import Grey, corridor

V, U = np.mgrid[:480, :640]
RADIUS = np.hypot(U - 321.5, V - 239.0)


def _frame(picture: Grey) -> Frame:
    return Frame(0, PixelFormat.GREY8, picture.shape[1], picture.shape[0], picture.astype(np.uint8).ravel())


@pytest.mark.parametrize("factor", [0.94, 0.97, 1.04, 1.06])
def test_a_disc_of_another_size_in_the_first_picture_does_not_cost_the_ring(factor: float) -> None:
    part = corridor(36, 64)
    front = FrontEnd(part.config)
    front.step(_frame(np.where(225.0 * factor > RADIUS, 128, 0)))
    for _ in range(2):
        seen = [front.step(frame) for frame in part.frames]
    last, truth = seen[-1], part.truth[-1]
    assert truth.center_px is not None
    assert last.reasons == ()
    assert last.ring is not None
    assert np.hypot(last.ring.center_u_px - truth.center_px[0], last.ring.center_v_px - truth.center_px[1]) < 0.1
    assert last.track_id.size > 40


def test_stripes_in_the_first_picture_do_not_shift_where_lines_meet() -> None:
    part = corridor(36, 50)
    front, clean = FrontEnd(part.config), FrontEnd(part.config)
    front.step(_frame(np.where(RADIUS < 225.0, ((U // 30) % 2) * 200 + 20, 0)))
    for frame in part.frames:
        after, undisturbed = front.step(frame), clean.step(frame)
    assert after.meeting is not None
    assert not after.meeting.used
    assert after.bearing_rad.size > 0.9 * undisturbed.bearing_rad.size
    assert np.quantile(nearest(undisturbed.bearing_rad, after.bearing_rad), 0.9) < 1e-3


@pytest.mark.parametrize(
    ("size", "ring", "factor"),
    [
        ((1280, 1024), MirrorRing(center_px=(640.0, 512.0), r_min_px=8.0, r_max_px=600.0), 1.0),
        ((640, 480), MirrorRing(r_min_px=207.0, r_max_px=225.0), 0.85),
        ((640, 480), MirrorRing(r_min_px=4.5, r_max_px=225.0), 0.85),
    ],
)
def test_any_ring_that_may_be_configured_is_worked_with(size: tuple[int, int], ring: MirrorRing, factor: float) -> None:
    config = Config(camera=Camera(width_px=size[0], height_px=size[1]), ring=ring)
    v, u = np.mgrid[: size[1], : size[0]]
    inside = np.hypot(u - ring.center_px[0], v - ring.center_px[1]) < factor * ring.r_max_px
    front = FrontEnd(config)
    for _ in range(15):
        seen = front.step(_frame(np.where(inside, 150, 0)))
    assert seen.ring is not None


def test_an_edge_on_the_very_centre_of_a_small_ring_is_no_fault() -> None:
    ring = MirrorRing(center_px=(80.5, 60.0), r_min_px=8.4, r_max_px=30.0)
    config = Config(camera=Camera(width_px=160, height_px=120), ring=ring)
    v, u = np.mgrid[:120, :160]
    picture = np.where(np.hypot(u - 80.5, v - 60.0) < 30.0, 200, 0)
    picture[:, :81] //= 4
    seen = FrontEnd(config).step(_frame(picture))
    assert np.all(np.isfinite(seen.bearing_rad))
