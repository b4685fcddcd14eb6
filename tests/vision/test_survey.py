"""A mirror that nobody has measured: rim and inner end against truth, and no ring where there is none."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.cli.settings import recording_path
from omnivert.messages import Frame
from omnivert.vision.fall import Grid, falls
from omnivert.vision.image import Grey, grey_from_frame
from omnivert.vision.inner import Inner, Told, inner_radius
from omnivert.vision.survey import NoRim, Rim, surveyed
from omnivert.wire.recording import Recording

Scene = Callable[..., Grey]

BY_EYE = {  # centre, Rmax, and the farthest that the camera's own image reaches, px
    "kaidan": ((325.2, 246.6), 223.2, 57.0),
    "static": ((328.0, 253.3), 208.8, 39.0),
    "vmr": ((516.7, 384.1), 452.5, 80.0),
}


def wedges(scene: Scene, rng: np.random.Generator, **given: object) -> Grey:
    """A place of its own: other walls each time."""
    edges = rng.integers(8, 40)
    angles = np.sort(rng.uniform(-3.1, 3.1, edges))
    return scene(angles, rng.uniform(70.0, 240.0, edges), **given, noise=2.0, seed=int(rng.integers(1 << 30)))


def found(pictures: list[Grey]) -> tuple[Rim, Inner]:
    rim = surveyed(pictures)
    assert isinstance(rim, Rim), rim
    return rim, inner_radius(pictures, rim)


# ---------------------------------------------------------------- a known ring


@settings(max_examples=6, deadline=None, phases=(Phase.explicit, Phase.generate))  # to shrink takes minutes
@given(
    seed=st.integers(0, 2**30),
    radius=st.floats(120.0, 235.0),
    off=st.tuples(st.floats(-60.0, 60.0), st.floats(-25.0, 25.0)),
    share=st.floats(0.15, 0.35),
    number=st.integers(1, 3),
    inverted=st.booleans(),
)
@example(seed=5181903, radius=201.0, off=(1.1, -19.4), share=0.35, number=3, inverted=True)
def test_a_ring_of_any_size_and_place_is_found(
    scene: Scene, seed: int, radius: float, off: tuple[float, float], share: float, number: int, inverted: bool
) -> None:
    rng = np.random.default_rng(seed)
    center, r_min = (320.0 + off[0], 240.0 + off[1]), share * radius
    shown = [wedges(scene, rng, center=center, r_min=r_min, r_max=radius) for _ in range(number)]
    rim, inner = found([255 - picture for picture in shown] if inverted else shown)
    assert np.hypot(rim.u_px - center[0], rim.v_px - center[1]) < max(0.3, 4.0 * rim.center_std_px)
    assert abs(rim.radius_px - radius) < 1.0
    assert rim.bright is not inverted
    assert abs(inner.radius_px - r_min) < 5.0
    assert inner.told in (Told.BORDER, Told.BOTH)


def test_a_rim_that_the_picture_cuts_off_is_found(scene: Scene) -> None:
    rng = np.random.default_rng(2)
    rim, inner = found([wedges(scene, rng, center=(330.0, 236.0), r_min=55.0, r_max=283.0)])
    assert np.hypot(rim.u_px - 330.0, rim.v_px - 236.0) < 0.5
    assert abs(rim.radius_px - 283.0) < 1.0
    assert abs(inner.radius_px - 55.0) < 5.0


def test_a_large_picture_is_measured_in_its_own_pixels(scene: Scene) -> None:
    rng = np.random.default_rng(3)
    given = {"center": (803.0, 590.0), "r_min": 190.0, "r_max": 560.0, "size": (1600, 1200)}
    rim, inner = found([wedges(scene, rng, **given)])
    assert np.hypot(rim.u_px - 803.0, rim.v_px - 590.0) < 0.5
    assert abs(rim.radius_px - 560.0) < 1.5
    assert abs(inner.radius_px - 190.0) < 10.0


def test_pictures_that_show_nothing_are_outvoted_and_their_number_is_told(scene: Scene) -> None:
    rng = np.random.default_rng(4)
    shown = [wedges(scene, rng) for _ in range(5)]
    dark = np.zeros((480, 640), dtype=np.uint8)
    rim, inner = found([shown[0], dark, *shown[1:], dark])
    assert rim.used == (0, 2, 3, 4, 5)
    assert abs(rim.radius_px - 225.0) < 1.0
    assert abs(inner.radius_px - 63.0) < 5.0


def test_a_camera_that_was_moved_on_the_robot_between_pictures_is_not_averaged(scene: Scene) -> None:
    rng = np.random.default_rng(5)
    shown = [wedges(scene, rng, center=(321.5 + 12.0 * k, 239.0)) for k in range(4)]
    refused = surveyed(shown)
    assert isinstance(refused, NoRim)
    assert "in one place" in refused.reason


def test_the_claimed_sigma_covers_a_shaking_mount(scene: Scene) -> None:
    rng = np.random.default_rng(6)
    shown = [wedges(scene, rng, center=tuple(rng.normal((321.5, 239.0), 1.0))) for _ in range(6)]
    rim, _ = found(shown)
    assert 0.5 < rim.spread_px < 1.8
    assert np.hypot(rim.u_px - 321.5, rim.v_px - 239.0) < 4.0 * rim.center_std_px


def test_where_the_inner_end_has_no_border_the_change_beyond_it_tells(scene: Scene) -> None:
    """The robot's own image: a square deck, mottled like the world, the same in every picture."""
    rng = np.random.default_rng(7)
    v, u = np.mgrid[:480, :640]
    mottled = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (480, 640)), (0, 0), 5.0)
    deck = np.clip(4.0 * (mottled - 127.5) + 127.5, 0.0, 255.0).astype(np.uint8)
    own = np.maximum(np.abs(u - 321.5), np.abs(v - 239.0)) < 50.0
    shown = [np.where(own, deck, wedges(scene, rng, r_min=10.0)) for _ in range(8)]
    _, inner = found(shown)
    assert inner.told is Told.CHANGE
    assert 50.0 < inner.radius_px < 50.0 * np.sqrt(2.0)  # half of the places are the world's


def test_one_picture_without_a_border_inside_gives_a_safe_share_and_says_so(scene: Scene) -> None:
    rim, inner = found([wedges(scene, np.random.default_rng(8), r_min=2.0)])
    assert inner.told is Told.NOTHING
    assert inner.radius_px == pytest.approx(0.3 * rim.radius_px)


# ---------------------------------------------------------------- the corridor, and photographs


@pytest.fixture(scope="module")
def corridor() -> list[Grey]:
    frames = [message for _, message in Recording(recording_path("corridor")).messages(types=(Frame,))]
    return [grey_from_frame(frame) for frame in frames[::20] if isinstance(frame, Frame)]


def test_the_corridors_ring_is_found_from_a_shaking_robot(corridor: list[Grey]) -> None:
    rim, inner = found(corridor)
    assert np.hypot(rim.u_px - 321.5, rim.v_px - 239.0) < 1.0
    assert abs(rim.radius_px - 225.0) < 0.5
    assert abs(inner.radius_px - 63.0) < 4.0
    assert inner.told is Told.BOTH
    assert len(rim.used) == len(corridor)


@pytest.mark.parametrize("change", ["dark", "bright", "noisy", "blurred"])
def test_the_corridors_ring_is_found_in_other_light(corridor: list[Grey], change: str) -> None:
    rng = np.random.default_rng(9)
    picture: NDArray[np.float64] = corridor[3].astype(np.float64)
    match change:
        case "dark":
            picture = 0.3 * picture
        case "bright":
            picture = 2.0 * picture
        case "noisy":
            picture = picture + rng.normal(0.0, 10.0, picture.shape)
        case "blurred":
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 2.5), dtype=np.float64)
    rim, _ = found([np.clip(picture, 0.0, 255.0).astype(np.uint8)])
    truth = found([corridor[3]])[0]
    assert np.hypot(rim.u_px - truth.u_px, rim.v_px - truth.v_px) < 0.5
    assert abs(rim.radius_px - 225.0) < 1.5


@pytest.mark.parametrize("number", [1, 8])
@pytest.mark.parametrize("name", BY_EYE)
def test_real_mirrors_are_measured_as_by_eye(shared_data: Path, name: str, number: int) -> None:
    center, r_max, r_min = BY_EYE[name]
    files = sorted((shared_data / "real" / name).glob("*.jpg"))[:number]
    if not files:
        pytest.skip(f"needs the photographs real/{name}, which are not here")
    pictures = [np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), dtype=np.uint8) for file in files]
    rim, inner = found(pictures)
    assert np.hypot(rim.u_px - center[0], rim.v_px - center[1]) < 1.0
    assert abs(rim.radius_px - r_max) < 2.0  # vmr's soft rim is 5 px wide
    if inner.told is Told.NOTHING:
        assert inner.radius_px > r_min
    else:
        assert abs(inner.radius_px - r_min) < 5.0


# ---------------------------------------------------------------- no ring


def face_on(corridor: Grey, azimuth: float) -> Grey:
    """What an ordinary camera would see there: the mirror's picture undone by the mirror's formula."""
    u, v = np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)
    elevation = np.arctan2(-v, np.hypot(u, 650.0))
    radius = 143.57976517604894 * np.cos(elevation) / (0.9662164547513388 - np.sin(elevation))
    angle = azimuth - np.arctan2(u, 650.0)
    at_u, at_v = 321.5 + radius * np.cos(angle), 239.0 - radius * np.sin(angle)
    return np.asarray(
        cv2.remap(corridor, at_u.astype(np.float32), at_v.astype(np.float32), cv2.INTER_LINEAR), dtype=np.uint8
    )


@pytest.mark.parametrize("azimuth", np.arange(0.0, 6.2, 1.0))
def test_a_photograph_of_the_room_shows_no_ring(corridor: list[Grey], azimuth: float) -> None:
    refused = surveyed([face_on(corridor[0], azimuth)])
    assert isinstance(refused, NoRim)
    assert refused.reason


@pytest.mark.parametrize("what", ["black", "grey", "noise", "coarse noise", "slope", "vignette", "clock", "stripes"])
def test_pictures_without_a_mirror_show_no_ring(what: str) -> None:
    rng = np.random.default_rng(10)
    v, u = np.mgrid[:480, :640].astype(np.float64)
    r = np.hypot(u - 320.0, v - 240.0)
    rough = rng.uniform(0.0, 255.0, (480, 640))
    pictures = {
        "black": 0.0 * r,
        "grey": 0.0 * r + 128.0,
        "noise": rough,
        "coarse noise": 128.0 + 25.0 * (cv2.GaussianBlur(rough, (0, 0), 12.0) - 127.5),
        "slope": u * 0.4,
        "vignette": 220.0 * np.cos(np.arctan(r / 400.0)) ** 4,
        "clock": np.where(r < 60.0, 230.0, 90.0),
        "stripes": 128.0 + 100.0 * np.sign(np.sin(u / 9.0)),
    }
    refused = surveyed([np.clip(pictures[what], 0.0, 255.0).astype(np.uint8)])
    assert isinstance(refused, NoRim), refused


def test_one_sidedness_is_the_share_that_falls_less_the_share_that_rises() -> None:
    """Three quarters of a disc, counted by hand."""
    v, u = np.mgrid[:200, :200]
    disc = np.where((np.hypot(u - 100.0, v - 100.0) < 50.0) & ~((u > 100) & (v > 100)), 200, 20).astype(np.uint8)
    net, seen = falls(disc, Grid(np.array([100.0]), np.array([100.0]), np.array([50.0, 90.0, 120.0])), 0.06)
    assert net[0, 0, 0] == pytest.approx(0.75, abs=0.03)
    assert net[0, 0, 1] == 0.0
    assert seen[0, 0].tolist()[:2] == [1.0, 1.0]
    assert 0.1 < seen[0, 0, 2] < 0.5
    assert falls(255 - disc, Grid(np.array([100.0]), np.array([100.0]), np.array([50.0])), 0.06)[0][0, 0, 0] < -0.7
