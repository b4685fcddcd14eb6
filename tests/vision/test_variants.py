"""The front end where it was not tuned: each limit holds a margin below what 28 frames measured."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from omnivert.angles import wrap
from omnivert.bench.score.circle import nearest
from omnivert.bench.score.score import score
from omnivert.bench.score.truth import Sighting
from omnivert.messages import PixelFormat
from omnivert.vision.account import Account
from tests.vision.drive import Drive, Float, Run, corridor, run
from tests.vision.lighting import encoded
from tests.vision.limits import Limits
from tests.vision.reframing import resized
from tests.vision.variants import VARIANTS

AS_PLAIN = Limits(
    recall=0.92,
    precision=0.90,
    correct_lines=45.0,
    right_percent=97.8,  # 28 frames have 1600 links, and one mistake makes about three: these figures vary by 0.2
    false_percent=0.8,
    new_percent=1.5,
    repeatability=0.97,
    sigma_mrad=0.6,
    normalised=(0.8, 1.2),
    ring_px=0.02,
)
HELD = {
    "raw": AS_PLAIN,
    "gain 0.6": replace(AS_PLAIN, correct_lines=41.0, false_percent=1.0, normalised=(0.7, 1.2)),
    "gain 0.6, truth of 1": replace(AS_PLAIN, recall=0.90, correct_lines=41.0, false_percent=1.0),
    "gain 1.5": AS_PLAIN,
    "gain 2.0": replace(
        AS_PLAIN, recall=0.77, precision=0.86, correct_lines=35.5, sigma_mrad=1.2, normalised=(0.7, 1.3), ring_px=0.15
    ),
    "gain swelling": AS_PLAIN,
    "gain flickering": replace(AS_PLAIN, correct_lines=43.0),
    "gamma 0.7": replace(AS_PLAIN, sigma_mrad=0.75, normalised=(0.8, 1.35)),
    "noise 4": replace(AS_PLAIN, precision=0.88, sigma_mrad=0.65),
    "blur 1": replace(AS_PLAIN, recall=0.90, correct_lines=38.0, sigma_mrad=0.95, normalised=(0.8, 1.65)),
    "jpeg 60": replace(AS_PLAIN, correct_lines=43.5, sigma_mrad=0.8, normalised=(0.8, 1.35)),
    "mirrored": AS_PLAIN,
    "320 x 240": replace(
        AS_PLAIN, recall=0.895, correct_lines=40.0, new_percent=1.5, sigma_mrad=1.5, normalised=(0.8, 1.75)
    ),
    "1024 x 768": AS_PLAIN,
    "2592 x 1944": replace(AS_PLAIN, false_percent=0.85, ring_px=0.06),
    "tilted 1 deg": replace(AS_PLAIN, sigma_mrad=0.75, normalised=(0.6, 1.2)),
    "tilted 3 deg": replace(AS_PLAIN, false_percent=1.0, sigma_mrad=1.5, normalised=(0.5, 1.2)),
    "stretched 2 %": AS_PLAIN,
    "cut off": replace(AS_PLAIN, new_percent=1.4, sigma_mrad=0.65),
    "glare": replace(AS_PLAIN, recall=0.89, correct_lines=39.5),
    "hand on rim": AS_PLAIN,
    "passing cover": replace(AS_PLAIN, correct_lines=42.0, right_percent=96.5, new_percent=3.0),
    "half rate": replace(AS_PLAIN, right_percent=96.0, false_percent=0.8, new_percent=3.3),
    "third rate": replace(AS_PLAIN, right_percent=83.0, false_percent=1.8, new_percent=15.5),
    "reversed": AS_PLAIN,
    "moving bar": replace(AS_PLAIN, right_percent=97.0, new_percent=2.8),
    "crossing": replace(AS_PLAIN, right_percent=96.6, new_percent=3.0),
}


@pytest.fixture(scope="module")
def part() -> Drive:
    """The end of the straight and the beginning of the turn."""
    return corridor(36, 64)


@pytest.fixture(scope="module")
def plain(part: Drive) -> Run:
    return run(part.picked(slice(0, 8)))


@pytest.mark.parametrize("name", HELD)
def test_the_figures_hold_when_the_conditions_change(part: Drive, name: str) -> None:
    drive = corridor() if name == "2592 x 1944" else part  # it takes its own part: the end of the straight, too
    assert HELD[name].misses(run(VARIANTS[name](drive)).score) == []


def test_lines_that_move_are_told_from_the_static_world() -> None:
    """On the whole straight and most of the turn; a post sways 9 deg to and fro within 16 frames."""
    told = run(VARIANTS["moving bar"](corridor())).moving_told
    assert told is not None
    of_moving, of_static = told
    assert of_moving > 0.6
    assert of_static < 0.01


@pytest.mark.parametrize(
    ("name", "back"),
    [
        ("mirrored", lambda b: wrap(b + np.pi)),
        ("portrait", lambda b: wrap(b - 0.5 * np.pi)),
        ("off centre", lambda b: b),
        ("colour", lambda b: b),
    ],
)
def test_the_same_lines_are_seen_wherever_and_however_the_picture_shows_them(
    part: Drive, plain: Run, name: str, back: Callable[[Float], Float]
) -> None:
    other = run(VARIANTS[name](part.picked(slice(0, 8))))
    lost = lines = 0
    for a, b in zip(plain.seen, other.seen, strict=True):
        apart = nearest(a.bearing_rad, back(b.bearing_rad))
        assert np.median(apart) < 3e-5
        lost, lines = lost + int(np.sum(apart > 2e-3)), lines + apart.size  # of the weakest, the last bit moves some
        assert abs(a.bearing_rad.size - b.bearing_rad.size) <= 2
    assert lost <= 0.01 * lines


def test_files_without_loss_give_the_bytes_of_the_raw_picture(part: Drive, plain: Run) -> None:
    for a, b in zip(plain.seen, run(VARIANTS["png"](part.picked(slice(0, 8)))).seen, strict=True):
        assert a.bearing_rad.tobytes() == b.bearing_rad.tobytes()
        assert a.track_id.tobytes() == b.track_id.tobytes()


def test_tracks_go_on_through_frames_of_another_form(part: Drive, plain: Run) -> None:
    """Raw, PNG, JPEG and colour by turns."""
    short = part.picked(slice(0, 8))
    forms = (
        short,
        encoded(short, PixelFormat.PNG),
        encoded(short, PixelFormat.JPEG, 98),
        encoded(short, PixelFormat.BGR8),
    )
    mixed = replace(short, frames=tuple(forms[k % 4].frames[k] for k in range(8)))
    seen = run(mixed).seen
    assert all(s.reasons == () for s in seen)
    alive = np.intersect1d(plain.seen[0].track_id, plain.seen[-1].track_id).size
    assert np.intersect1d(seen[0].track_id, seen[-1].track_id).size >= 0.9 * alive


def test_frames_of_another_size_are_refused_by_name_and_harm_nothing_after_them(part: Drive, plain: Run) -> None:
    short = part.picked(slice(0, 8))
    frames = list(short.frames)
    frames[4] = resized(short, 240).frames[4]
    seen = run(replace(short, frames=tuple(frames))).seen
    assert seen[4].track_id.size == 0
    assert any("320x240, configured 640x480" in reason for reason in seen[4].reasons)
    assert seen[5].reasons == ()
    alive = np.intersect1d(plain.seen[3].track_id, plain.seen[5].track_id).size
    assert np.intersect1d(seen[3].track_id, seen[5].track_id).size >= 0.9 * alive


@pytest.mark.parametrize("center", [(381.5, 239.0), (275.0, 285.0)])
def test_a_ring_60_pixels_from_where_it_was_told_is_found_all_the_same(
    part: Drive, plain: Run, center: tuple[float, float]
) -> None:
    short = part.picked(slice(0, 8))
    ring = short.config.ring.model_copy(update={"center_px": center})
    seen = run(replace(short, config=short.config.model_copy(update={"ring": ring})))
    assert all(s.reasons == () for s in seen.seen)
    assert seen.score.sharpness.ring_rms_px is not None
    assert seen.score.sharpness.ring_rms_px < 0.1
    assert seen.score.detection.recall > plain.score.detection.recall - 0.01


@pytest.mark.parametrize("factor", [0.82, 0.95, 0.98, 1.02, 1.05, 1.15])
def test_a_ring_of_another_size_than_told_is_found_and_named(part: Drive, factor: float) -> None:
    """Within as many frames as there are sizes to try; never lines about a wrong centre."""
    told = part.config.ring
    ring = told.model_copy(update={"r_min_px": factor * told.r_min_px, "r_max_px": factor * told.r_max_px})
    done = run(replace(part, config=part.config.model_copy(update={"ring": ring})))
    late = [s for s in done.seen if s.ring is None]
    assert all(s.reasons[0] == "ring not in the picture" and s.track_id.size == 0 for s in late)
    assert len(late) <= (0 if 0.97 < factor < 1.06 else 14)
    judged = score([Sighting.of(s) for s in done.seen[len(late) :]], part.truth[len(late) :])
    assert judged is not None
    assert judged.detection.recall > 0.92
    for s, truth in zip(done.seen[len(late) :], part.truth[len(late) :], strict=True):
        assert truth.center_px is not None
        assert s.ring is not None
        assert np.hypot(s.ring.center_u_px - truth.center_px[0], s.ring.center_v_px - truth.center_px[1]) < 0.1
    note = Account.of(done.drive.config, done.seen).notes()["ring"]
    assert f"configured {ring.r_max_px:.1f}" in note
