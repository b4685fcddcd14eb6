"""The corridor under other conditions, each with an exact truth, and the front end's figures on every one.

`python -m tests.vision.variants [NAME ...]` prints the table.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from omnivert.angles import TURN, wrap
from omnivert.messages import PixelFormat
from omnivert.threads import one_thread
from tests.vision.drive import Drive, Grey, Run, as_recorded, corridor, run
from tests.vision.lighting import blur, encoded, flickering_gain, gain, gamma, noise, swelling_gain
from tests.vision.limits import Limits
from tests.vision.painting import Bar, center_of, covered, hidden, painted, polar
from tests.vision.reframing import cut_off, mirrored, off_center, quarter_turned, resized, stretched, tilted


def glare(drive: Drive) -> Drive:
    """Three lamps that burn out what is around them, fixed to the world, and a veil around each."""
    pictures, truths = [], []
    for picture, truth, heading in zip(drive.pictures(), drive.truth, drive.heading_rad, strict=True):
        cu, cv = center_of(truth)
        light = np.zeros(picture.shape)
        v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
        for k, at in enumerate((110.0, 150.0, 180.0)):
            turn = 0.7 + 2.1 * k - heading
            apart = np.hypot(u - cu - at * np.cos(turn), v - cv + at * np.sin(turn))
            light += 900.0 * np.exp(-0.5 * (apart / 12.0) ** 2) + 60.0 * np.exp(-0.5 * (apart / 45.0) ** 2)
        after = np.clip(np.rint(picture + light), 0, 255).astype(np.uint8)
        pictures.append(after)
        truths.append(hidden(picture, truth, drive.config, (after == 255) & (picture < 250)))
    return drive.of(pictures, truths)


def _skin(shape: tuple[int, ...]) -> Grey:
    rough = cv2.GaussianBlur(np.random.default_rng(3).normal(0.0, 1.0, shape), (0, 0), 6.0)
    return np.asarray(np.clip(np.rint(105.0 + 120.0 * rough), 40, 180), dtype=np.uint8)


def hand_on_rim(drive: Drive) -> Drive:
    """A hand around a third of the rim, reaching in by a tenth of the radius, wandering around the mirror."""
    pictures, truths = [], []
    r = drive.config.ring.r_max_px
    for k, (picture, truth) in enumerate(zip(drive.pictures(), drive.truth, strict=True)):
        radius, angle = polar(picture.shape, center_of(truth))
        off = wrap(angle - 0.02 * k)
        fingers = 0.90 + 0.04 * np.cos(9.0 * off)
        mask = (np.abs(off) < TURN / 6.0) & (radius > fingers * r)
        after, left = covered(picture, truth, drive.config, mask, _skin(picture.shape))
        pictures.append(after)
        truths.append(left)
    return drive.of(pictures, truths)


def passing_cover(drive: Drive, every: int = 12, lasts: int = 4) -> Drive:
    """Somebody hides a third of the world, another third each time, for a second or so."""
    pictures, truths = [], []
    for k, (picture, truth) in enumerate(zip(drive.pictures(), drive.truth, strict=True)):
        after, left = picture, truth
        if k % every >= every - lasts:
            radius, angle = polar(picture.shape, center_of(truth))
            off = wrap(angle - 2.4 * (k // every))
            body = TURN / 6.0 + 0.05 * np.sin(radius / 14.0)
            mask = (np.abs(off) < body) & (radius > 0.9 * drive.config.ring.r_min_px)
            after, left = covered(picture, truth, drive.config, mask, _skin(picture.shape))
        pictures.append(after)
        truths.append(left)
    return drive.of(pictures, truths)


def moving_bar(drive: Drive) -> Drive:
    """A post carried to and fro through the world: 9 deg each way within 16 frames."""
    pictures, truths, moving = [], [], []
    for k, (picture, truth) in enumerate(zip(drive.pictures(), drive.truth, strict=True)):
        sway = np.deg2rad(9.0) * np.sin(TURN / 16.0 * k)
        angle = float(wrap(1.2 - drive.heading_rad[k] + sway))
        after, rest, bar = painted(picture, truth, drive.config, [Bar(angle, np.deg2rad(2.5), 80.0, 215.0, 8.0)])
        pictures.append(after)
        truths.append(replace(rest, neither_rad=np.concatenate((rest.neither_rad, bar.bearing_rad))))
        moving.append(bar.bearing_rad)
    return replace(drive.of(pictures, truths), moving_rad=tuple(moving))


def crossing(drive: Drive, posts: int = 12) -> Drive:
    """Posts, dark and bright by turns, that pass each other and the world's lines at 0.5 deg a frame each way."""
    pictures, truths = [], []
    for k, (picture, truth) in enumerate(zip(drive.pictures(), drive.truth, strict=True)):
        bars = [
            Bar(
                float(wrap(TURN * i / posts - drive.heading_rad[k] + np.deg2rad(0.5) * k * (-1) ** i)),
                np.deg2rad(1.5),
                *((70.0, 190.0) if i % 2 else (105.0, 218.0)),
                6.0 if i % 2 else 190.0,
            )
            for i in range(posts)
        ]
        after, rest, edges = painted(picture, truth, drive.config, bars)
        pictures.append(after)
        truths.append(
            replace(
                rest,
                line_id=np.concatenate((rest.line_id, 970_000 + edges.line_id)),
                bearing_rad=np.concatenate((rest.bearing_rad, edges.bearing_rad)),
                visible_fraction=np.concatenate((rest.visible_fraction, edges.visible_fraction)),
                contrast=np.concatenate((rest.contrast, edges.contrast)),
            )
        )
    return drive.of(pictures, truths)


# --------------------------------------------------------------------------------------------------------------- table

Made = Callable[[Drive], Drive]

LIGHT: dict[str, Made] = {
    "raw": lambda d: d,
    "gain 0.5": lambda d: gain(d, 0.5),
    "gain 0.6": lambda d: gain(d, 0.6),
    "gain 1.5": lambda d: gain(d, 1.5),
    "gain 2.0": lambda d: gain(d, 2.0),
    "gain 0.6, truth of 1": lambda d: replace(gain(d, 0.6), truth=d.truth),
    "gain swelling": swelling_gain,
    "gain flickering": flickering_gain,
    "gamma 0.7": lambda d: gamma(d, 0.7),
    "gamma 1.5": lambda d: gamma(d, 1.5),
    "noise 2": lambda d: noise(d, 2.0),
    "noise 4": lambda d: noise(d, 4.0),
    "blur 1": lambda d: blur(d, 1.0),
    "jpeg 60": lambda d: encoded(d, PixelFormat.JPEG, 60),
    "png": lambda d: encoded(d, PixelFormat.PNG),
    "colour": lambda d: encoded(d, PixelFormat.BGR8),
}
GEOMETRY: dict[str, Made] = {
    "mirrored": mirrored,
    "portrait": quarter_turned,
    "320 x 240": lambda d: resized(d, 240),
    "1024 x 768": lambda d: resized(d, 768),
    "2592 x 1944": lambda d: resized(d.picked(slice(30, 60)), 1944),
    "off centre": off_center,
    "tilted 1 deg": lambda d: tilted(d, 1.0),
    "tilted 3 deg": lambda d: tilted(d, 3.0),
    "stretched 2 %": lambda d: stretched(d, 0.02),
    "cut off": cut_off,
}
WORLD: dict[str, Made] = {
    "glare": glare,
    "hand on rim": hand_on_rim,
    "passing cover": passing_cover,
    "half rate": lambda d: d.picked(slice(None, None, 2)),
    "third rate": lambda d: d.picked(slice(None, None, 3)),
    "reversed": lambda d: d.picked(slice(None, None, -1)),
    "moving bar": moving_bar,
    "crossing": crossing,
}
VARIANTS = LIGHT | GEOMETRY | WORLD

_FEWER = Limits(correct_lines=0.0)  # of the drive's lines fewer can be seen there
_PART = Limits(correct_lines=0.0, ring_px=0.3)  # of the rim, too
TARGETS = {
    "gain 0.5": _FEWER,
    "gain 0.6": _FEWER,
    "gain 0.6, truth of 1": Limits(recall=0.0, correct_lines=0.0, repeatability=0.93),
    "gain 2.0": _FEWER,
    "gain flickering": replace(_FEWER, repeatability=0.93),
    "320 x 240": replace(_FEWER, sigma_mrad=1.2),
    "glare": _FEWER,
    "hand on rim": _PART,
    "passing cover": _PART,
    "cut off": _PART,
    "crossing": Limits(normalised=(0.0, 1.2)),
}
"""Where they are not `Limits()`."""

COLUMNS = (
    ("recall", 7),
    ("prec", 6),
    ("correct", 8),
    ("lines", 6),
    ("links", 6),
    ("right%", 7),
    ("false%", 7),
    ("new%", 6),
    ("repeat", 7),
    ("purity", 7),
    ("mrad", 6),
    ("bias", 6),
    ("norm", 6),
    ("ring px", 8),
    ("ms", 6),
)


def row(name: str, done: Run) -> str:
    d, i, s = done.score.detection, done.score.identity, done.score.sharpness
    ring = "-" if s.ring_rms_px is None else f"{s.ring_rms_px:.3f}"
    honest = "-" if s.normalised_sigma is None else f"{s.normalised_sigma:.2f}"
    values = (
        f"{d.recall:.3f}",
        f"{d.precision:.3f}",
        f"{d.correct_lines_per_frame:.1f}",
        f"{d.lines_per_frame:.1f}",
        f"{i.links}",
        f"{i.correct_percent:.2f}",
        f"{i.false_percent:.2f}",
        f"{i.false_new_percent:.2f}",
        f"{i.repeatability:.3f}",
        f"{i.purity:.3f}",
        f"{s.sigma_mrad:.2f}",
        f"{s.bias_mrad:.2f}",
        honest,
        ring,
        f"{done.step_ms:.1f}",
    )
    notes = []
    if done.meeting_rms_px is not None and name.startswith(("tilted", "stretched")):
        notes.append(f"meeting {done.meeting_rms_px:.2f} px")
    if done.moving_told is not None:
        notes.append("moving told {:.0%}, of static {:.1%}".format(*done.moving_told))
    if sum(bool(b.reasons) for b in done.seen):
        notes.append(f"{sum(bool(b.reasons) for b in done.seen)} frames with reasons")
    missed = TARGETS.get(name, Limits()).misses(done.score)
    if missed:
        notes.append(f"misses {', '.join(miss.partition(',')[0] for miss in missed)}")
    cells = "".join(v.rjust(w) for v, (_, w) in zip(values, COLUMNS, strict=True))
    return f"{name:22}{cells}  {'; '.join(notes)}".rstrip()


def main(names: list[str]) -> None:
    one_thread()
    print(" " * 22 + "".join(head.rjust(w) for head, w in COLUMNS), flush=True)
    if not names or "recorded" in names:
        print(row("recorded", run(as_recorded())), flush=True)
    for name, made in VARIANTS.items():
        if not names or name in names:
            print(row(name, run(made(corridor()))), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
