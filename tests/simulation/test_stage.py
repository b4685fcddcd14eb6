"""The pictures show what the truth says: lines at their bearings, the ring where it lies, edges as large as seen."""

from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.angles import wrap
from omnivert.bench.score.rules import Rules
from omnivert.bench.score.sharpness import _residuals
from omnivert.bench.score.truth import FrameTruth, Sighting
from omnivert.config import Config, parsed
from omnivert.simulation.place import Place
from omnivert.simulation.stage import Stage, Taken, with_camera
from omnivert.simulation.surfaces import MOVING, SILHOUETTES
from omnivert.simulation.toml_file import loaded
from omnivert.vision.frontend import FrontEnd

Array = NDArray[np.float64]
Pair = tuple[Sighting, FrameTruth]
MIRRORED = parsed({"camera": {"bearing_sign": -1}}, "the test")


def office(**camera: Any) -> Place:
    return with_camera(loaded("office", "worlds", Place), **camera)


def judged(stage: Stage, frames: int) -> list[Pair]:
    """What the vision finds in pictures from here and there, beside the truth."""
    pairs = []
    for index in range(frames):
        front_end = FrontEnd(stage.config)
        pose = np.array([-1.5 + 0.35 * index, 0.1 * index, 0.7 * index])
        taken = stage.taken(stage.shot(index, 2.0 * index, pose, 0.0))
        pairs.append((Sighting.of(front_end.step(taken.frame(index))), frame_truth(stage, taken)))
    return pairs


def frame_truth(stage: Stage, taken: Taken) -> FrameTruth:
    seen = stage.edges_in(taken)
    still = seen.line < SILHOUETTES
    return FrameTruth(
        seen.line[still],
        seen.azimuth[still],
        seen.visible_fraction[still],
        seen.contrast[still],
        seen.azimuth[~still],
        taken.shot.center_px,
    )


@lru_cache(maxsize=1)
def usual() -> list[Pair]:
    return judged(Stage(Config(), office(), 3), 8)


def rms(pairs: list[Pair]) -> tuple[float, int]:
    residual, _ = _residuals(pairs, Rules())
    return float(np.sqrt(np.mean(residual**2))), residual.size


def test_isolated_lines_are_found_within_a_milliradian_rms() -> None:
    off, count = rms(usual())
    assert count > 40
    assert off < 1e-3


def test_a_picture_that_is_a_mirror_image_has_its_lines_there_too() -> None:
    off, count = rms(judged(Stage(MIRRORED, office(), 3), 3))
    assert count > 12
    assert off < 1e-3


def test_the_ring_is_found_where_its_vibration_has_put_it() -> None:
    off = []
    for sighting, truth in usual():
        assert sighting.center_px is not None
        assert truth.center_px is not None
        off.append(np.subtract(sighting.center_px, truth.center_px))
    assert np.sqrt(np.mean(np.square(off))) < 0.05
    centers = np.array([truth.center_px for _, truth in usual()])
    assert np.all(centers.std(axis=0) > 0.1)  # it did move


def test_nearly_all_strong_lines_are_found() -> None:
    rules = Rules()
    found = [
        bool(np.min(np.abs(wrap(sighting.bearing_rad - bearing))) < rules.tolerance_rad)
        for sighting, truth in usual()
        for bearing in truth.bearing_rad[rules.strong(truth)]
    ]
    assert len(found) > 100
    assert np.mean(found) > 0.9


def one_panel(x_m: float, low_m: float, high_m: float) -> Place:
    """A hall so wide that nothing else is near, and a dark panel across the x axis."""
    walls = [
        {"points": [[-50, -50], [50, -50], [50, 50], [-50, 50]], "closed": True},
        {"points": [[x_m, -0.4], [x_m, 0.4]], "high_m": high_m, "brightness": 0.05},
    ]
    given = {
        "wall": walls,
        "camera": {"phi_deg": 0, "rho_m": 0, "psi_deg": 0, "vibration_px": 0},
        "ceiling": {"high_m": 9, "lamps_x_m": 900, "lamps_y_m": 900},
    }
    return Place.model_validate(given)


@pytest.mark.parametrize(("x_m", "high_m"), [(1.0, 1.2), (2.5, 1.7), (4.0, 0.8)])
def test_an_edge_is_as_visible_as_its_two_ends_say(x_m: float, high_m: float) -> None:
    stage = Stage(Config(), one_panel(x_m, 0.0, high_m), 1)
    seen = stage.edges_in(stage.taken(stage.shot(0, 0.0, np.zeros(3), 0.0)))
    for side in (-0.4, 0.4):
        nearest = int(np.argmin(np.abs(wrap(seen.azimuth - np.arctan2(side, x_m)))))
        assert seen.azimuth[nearest] == pytest.approx(np.arctan2(side, x_m), abs=1e-9)
        # The end of the panel is farther away than its middle, and the column beside it just as far.
        ends = stage.mirror.radius(np.arctan2(np.array([0.0, high_m]) - 0.9, np.hypot(x_m, side)))
        ring = stage.config.ring
        low, high = np.clip(ends, ring.r_min_px, ring.r_max_px)
        assert seen.visible_fraction[nearest] == pytest.approx((high - low) / (ring.r_max_px - ring.r_min_px), abs=0.02)
        assert seen.distance[nearest] == pytest.approx(np.hypot(x_m, side), rel=0.01)
        assert seen.contrast[nearest] > 12.0


def test_a_pixel_across_an_edge_gets_its_share_of_both_sides() -> None:
    place = with_camera(one_panel(2.0, 0.0, 8.0), noise_grey=0.0)
    picture = Stage(Config(), place, 1).taken(Stage(Config(), place, 1).shot(0, 0.0, np.zeros(3), 0.0)).picture
    u, v = Config().ring.center_px
    for radius in (160, 190, 215):
        # Along a circle, the light that lacks beside the brighter wall is as wide as the panel is.
        angle = np.linspace(-0.4, 0.4, 20_001)
        light = (picture.grey / 255.0) ** 2
        x, y = u + radius * np.cos(angle), v - radius * np.sin(angle)
        i, j = x.astype(int), y.astype(int)
        fx, fy = x - i, y - j
        along = (
            light[j, i] * (1 - fx) * (1 - fy)
            + light[j, i + 1] * fx * (1 - fy)
            + light[j + 1, i] * (1 - fx) * fy
            + light[j + 1, i + 1] * fx * fy
        )
        wall, panel = np.median(along[np.abs(angle) > 0.3]), np.median(along[np.abs(angle) < 0.1])
        width = np.sum(wall - along) / (wall - panel) * (angle[1] - angle[0])
        assert width == pytest.approx(2.0 * np.arctan2(0.4, 2.0), abs=0.004)


def test_a_seed_gives_the_same_picture_again_and_another_one_does_not() -> None:
    def data(seed: int) -> bytes:
        stage = Stage(Config(), office(), seed)
        return stage.taken(stage.shot(7, 1.0, np.zeros(3), 0.0)).frame(0).data.tobytes()

    assert data(1) == data(1)
    assert data(1) != data(2)


def test_people_are_moving_lines_and_can_be_sent_away() -> None:
    def moving(people: int | None) -> int:
        stage = Stage(Config(), office(), 1, people)
        return int(np.sum(stage.edges_in(stage.taken(stage.shot(0, 3.0, np.zeros(3), 0.0))).line >= MOVING))

    assert moving(None) > 0
    assert moving(0) == 0
    assert moving(4) > moving(1) > 0


def test_the_laser_measures_the_walls() -> None:
    room = {
        "wall": [{"points": [[-3, -2], [4, -2], [4, 2], [-3, 2]], "closed": True}],
        "laser": {"noise_m": 0.0, "beams": 4},
    }
    stage = Stage(Config(), Place.model_validate(room), 1)
    taken = stage.taken(stage.shot(0, 0.0, np.array([0.5, 0.0, 0.0]), 0.0))
    np.testing.assert_allclose(taken.range_m, [3.5, 2.0, 3.5, 2.0], atol=2e-3)  # behind, right, ahead, left


def test_beyond_the_rim_it_is_dark_and_in_the_middle_the_camera_sees_itself() -> None:
    stage = Stage(Config(), office(vibration_px=0.0), 1)
    grey = stage.taken(stage.shot(0, 0.0, np.zeros(3), 0.0)).picture.grey.astype(float)
    ring = stage.config.ring
    v, u = np.mgrid[: grey.shape[0], : grey.shape[1]]
    r = np.hypot(u - ring.center_px[0], v - ring.center_px[1])
    assert grey[r > ring.r_max_px + 2].mean() < 12
    assert grey[r < ring.r_min_px - 2].mean() < 45
    assert grey[(r > ring.r_min_px + 2) & (r < ring.r_max_px - 2)].mean() > 80
