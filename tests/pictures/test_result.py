"""The result picture is made, has its size, and shows something in each of its parts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from omnivert.messages import Estimate, State
from omnivert.pictures.result import DPI, SIZE_IN, write_result
from omnivert.pictures.words import colour

TRUTH = (-0.34, 0.23, 0.33)
WIDTH, HEIGHT = round(SIZE_IN[0] * DPI), round(SIZE_IN[1] * DPI)


@pytest.fixture
def frame() -> NDArray[np.uint8]:
    return np.random.default_rng(3).integers(0, 255, (480, 640, 3), dtype=np.uint8)


def parts(path: Path) -> dict[str, Any]:
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (HEIGHT, WIDTH, 3)
    half, third = int(0.62 * WIDTH), HEIGHT // 3
    return {
        "phi": picture[:third, :half],
        "rho": picture[third : 2 * third, :half],
        "psi": picture[2 * third :, :half],
        "frame": picture[HEIGHT // 8 : HEIGHT // 2, half:],
        "robot": picture[int(0.55 * HEIGHT) :, half:],
    }


def test_every_part_of_the_picture_is_drawn(tmp_path: Path, drive: list[Estimate], frame: NDArray[np.uint8]) -> None:
    write_result(tmp_path / "r.png", drive, "demo", 0.4, frame, TRUTH)
    for name, part in parts(tmp_path / "r.png").items():
        assert part.std() > 5.0, name


@pytest.mark.parametrize(
    "states", [(State.NOT_YET,), (State.NOT_YET, State.USABLE, State.CALIBRATED), (State.CALIBRATED, State.MOVED)]
)
def test_the_colours_of_the_strip_and_no_others_are_explained_above_it(
    tmp_path: Path, estimate_of: Callable[..., Estimate], states: tuple[State, ...]
) -> None:
    estimates = [estimate_of(number, state) for number, state in enumerate(states, 1)]
    write_result(tmp_path / "r.png", estimates, "demo", 0.4)
    picture = cv2.imread(str(tmp_path / "r.png"))
    assert picture is not None
    above = picture[round(0.09 * HEIGHT) : round(0.112 * HEIGHT), : WIDTH // 2].reshape(-1, 3)

    def shown(state: State) -> bool:
        red_green_blue = bytes.fromhex(colour(state).removeprefix("#"))
        return int((above == np.array(tuple(red_green_blue))[::-1]).all(axis=1).sum()) > 50

    kinds = (State.NOT_YET, State.USABLE, State.CALIBRATED, State.MOVED, State.WAITING)
    assert {state for state in kinds if shown(state)} == set(states)


def test_the_same_drive_gives_the_same_bytes(tmp_path: Path, drive: list[Estimate]) -> None:
    for name in ("a.png", "b.png"):
        write_result(tmp_path / name, drive, "demo", 0.4, None, TRUTH)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize("phi", [3.1, -3.1, 1.6, 0.0])
def test_a_mount_in_any_direction_can_be_drawn(
    tmp_path: Path, estimate_of: Callable[..., Estimate], phi: float
) -> None:
    given = estimate_of(3).mount
    assert given is not None
    turned = [estimate_of(k, mount=type(given)(phi, 0.05, -phi, given.covariance)) for k in (1, 2)]
    write_result(tmp_path / "r.png", turned, "demo", 0.4)
    assert parts(tmp_path / "r.png")["robot"].std() > 5.0


def test_a_drive_without_a_solution_has_a_picture_too(tmp_path: Path, estimate_of: Callable[..., Estimate]) -> None:
    write_result(tmp_path / "r.png", [estimate_of(1, State.NOT_YET, known=False)], "demo", 0.4)
    assert parts(tmp_path / "r.png")["phi"].std() > 1.0


def test_no_estimates_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one"):
        write_result(tmp_path / "r.png", [], "demo", 0.4)
